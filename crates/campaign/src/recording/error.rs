//! Why a recording could not be read or written.

use crate::campaign::CampaignError;
use crate::input::InputError;
use crate::robot::RobotError;

/// Why a recording could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// No file that is read here: missing, too large, of another kind.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// The recording.
        file: String,
        /// Why.
        source: InputError,
    },
    /// Writing failed; what was there before is untouched.
    #[error("{file}: cannot be written: {source}")]
    Write {
        /// The recording.
        file: String,
        /// What the system or the format's library says.
        source: std::io::Error,
    },
    /// Larger than anything that was ever measured.
    #[error("{file}: found more than {limit}; accepted: at most {limit}")]
    TooLarge {
        /// The recording.
        file: String,
        /// The limit with its unit.
        limit: String,
    },
    /// Not MCAP, cut off, or damaged.
    #[error("{file}: not a whole MCAP file: {problem}")]
    Damaged {
        /// The recording.
        file: String,
        /// What the format's library says.
        problem: String,
    },
    /// MCAP, but not a campaign.
    #[error(
        "{file}: not a recording of a campaign: found {found}; accepted: what `misfit simulate`, `misfit run -o` and --record \
         write (`misfit import` makes a campaign of a ROS 2 bag)"
    )]
    Foreign {
        /// The recording.
        file: String,
        /// What is missing or different.
        found: String,
    },
    /// Another storage than MCAP.
    #[error("{file}: found {found}; accepted: an .mcap file, or a folder of them; {remedy}")]
    Storage {
        /// The bag.
        file: String,
        /// What it is.
        found: String,
        /// How to make of it what is read.
        remedy: String,
    },
    /// A topic that is not there, or of a type that cannot be used.
    #[error("{file}, topic {topic}: found {found}; accepted: {accepted}")]
    Topic {
        /// The bag.
        file: String,
        /// The topic.
        topic: String,
        /// Nothing, or its type.
        found: String,
        /// Types, or the topics there are.
        accepted: String,
    },
    /// A message does not fit the others.
    #[error("{file}, topic {topic}, log time {log_time} ns: {problem}")]
    Message {
        /// The recording.
        file: String,
        /// The topic.
        topic: String,
        /// Log time of the message, ns.
        log_time: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The campaign file inside the recording.
    #[error(transparent)]
    Campaign(Box<CampaignError>),
    /// The robot file inside the recording.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A campaign that does not hold together, read or to be written.
    #[error("{file}: the campaign does not hold together: {problem}")]
    Inconsistent {
        /// The recording.
        file: String,
        /// What does not hold.
        problem: String,
    },
}

impl From<CampaignError> for RecordingError {
    fn from(error: CampaignError) -> Self {
        Self::Campaign(Box::new(error))
    }
}
