//! Campaigns as MCAP recordings of the `ros2` profile: one file that viewers open and `misfit` reads back.
//!
//! All messages of one reading share its log time. Angles, tracker poses and wrenches stand in
//! standard types on standard topics; `misfit_msgs/msg/Reading` has the rest. What a fit or a ladder found
//! stands beside them: predictions, misfit, rungs, the verdict. The
//! campaign file and the robot file are attached. Only this module speaks to the MCAP library.

mod bag;
mod cloud;
mod colour;
mod description;
mod error;
mod framing;
mod messages;
mod read;
mod recorder;
mod records;
mod results;
mod transforms;
mod write;

pub use bag::{Bag, JointSample, PoseSample, Samples, Stamp, Topic, is_bag, read_bag};
pub use cloud::{Cloud, write_clouds};
pub use error::RecordingError;
pub use read::{Recording, read_campaign, read_recording};
pub use results::{Progress, Results, Step};
pub use write::{Beside, Holds, write_campaign};

/// Name of the attached campaign file.
const CAMPAIGN_FILE: &str = "campaign.toml";
/// Name of the metadata record with what neither file nor messages carry.
const CAMPAIGN_RECORD: &str = "campaign";
/// Name of the metadata record that the caller fills: seed, versions.
const RUN_RECORD: &str = "run";
/// Value of `format` in the campaign record; a reader refuses any other.
const FORMAT: &str = "misfit.campaign/1";
/// The same of joint commands for wanted poses: nothing was measured, so no fit takes them.
const COMMANDS_FORMAT: &str = "misfit.commands/1";
/// Messages of the encoding.
const CDR: &str = "cdr";

const ROBOT_DESCRIPTION: &str = "/robot_description";
const TF_STATIC: &str = "/tf_static";
const TF: &str = "/tf";
const JOINT_STATES: &str = "/joint_states";
const TRACKER_POSE: &str = "/tracker/pose";
const WRENCH: &str = "/wrist_ft/wrench";
const TEMPERATURE: &str = "/temperature";
const READING: &str = "/campaign/reading";
