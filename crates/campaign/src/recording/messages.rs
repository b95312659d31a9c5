//! The messages of a recording: standard ROS 2 types, and one of our own for the rest.
//!
//! The fields stand in the order of the `.msg` texts, which are written into every file;
//! CDR has no other way to tell them apart. Names and numbers may be borrowed: a recording says the same ones ten
//! thousand times.

use re_cdr::{BigEndian, CdrBuffer, LittleEndian};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A message type with its name and its text.
pub(super) trait Message: Serialize + DeserializeOwned {
    /// `package/msg/Type`.
    const NAME: &'static str;
    /// Texts of the type and of everything in it: (`package/Type`, text), the type itself first.
    const TEXTS: &'static [(&'static str, &'static str)];
}

/// The `ros2msg` schema: the type's text, then each dependency under a line of `=` and its name.
pub(super) fn schema<M: Message>() -> String {
    let mut schema = String::new();
    for (index, (name, text)) in M::TEXTS.iter().enumerate() {
        if index > 0 {
            schema.push_str(&"=".repeat(80));
            schema.push_str("\nMSG: ");
            schema.push_str(name);
            schema.push('\n');
        }
        schema.push_str(text);
    }
    schema
}

/// The end of a vector of bytes: alignment counts from its start, which is after a message's header.
struct End<'a> {
    bytes: &'a mut Vec<u8>,
    start: usize,
}

impl CdrBuffer for End<'_> {
    fn extend_from_slice(&mut self, data: &[u8]) {
        self.bytes.extend_from_slice(data);
    }

    fn push(&mut self, byte: u8) {
        self.bytes.push(byte);
    }

    fn len(&self) -> usize {
        self.bytes.len() - self.start
    }

    fn clear(&mut self) {
        self.bytes.truncate(self.start);
    }
}

/// Appends a message in CDR, little-endian, with the encapsulation header.
pub(super) fn encode<M: Message>(message: &M, bytes: &mut Vec<u8>) -> Result<(), String> {
    bytes.extend([0, 1, 0, 0]);
    let start = bytes.len();
    re_cdr::to_buffer::<M, LittleEndian, _>(message, &mut End { bytes, start })
        .map_err(|error| error.to_string())
}

/// Reads CDR bytes of either byte order.
pub(super) fn decode<M: Message>(bytes: &[u8]) -> Result<M, String> {
    let decoded = match bytes {
        [0, 1, _, _, body @ ..] => re_cdr::from_bytes::<M, LittleEndian>(body),
        [0, 0, _, _, body @ ..] => re_cdr::from_bytes::<M, BigEndian>(body),
        _ => return Err("bytes without a CDR header; accepted: plain CDR".into()),
    };
    decoded
        .map(|(message, _)| message)
        .map_err(|error| error.to_string())
}

macro_rules! text {
    ($package:literal, $name:literal) => {
        (
            concat!($package, "/", $name),
            include_str!(concat!("msg/", $package, "_", $name, ".msg")),
        )
    };
}

const TIME: (&str, &str) = text!("builtin_interfaces", "Time");
const HEADER: (&str, &str) = text!("std_msgs", "Header");
const POINT: (&str, &str) = text!("geometry_msgs", "Point");
const VECTOR3: (&str, &str) = text!("geometry_msgs", "Vector3");
const QUATERNION: (&str, &str) = text!("geometry_msgs", "Quaternion");

/// Seconds and nanoseconds since the start, or since 1970 if the campaign's times are such.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Time {
    pub(super) sec: i32,
    pub(super) nanosec: u32,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Header<'a> {
    pub(super) stamp: Time,
    pub(super) frame_id: Cow<'a, str>,
}

/// `std_msgs/msg/String`.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Text {
    pub(super) data: String,
}

impl Message for Text {
    const NAME: &'static str = "std_msgs/msg/String";
    const TEXTS: &'static [(&'static str, &'static str)] = &[text!("std_msgs", "String")];
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct JointState<'a> {
    pub(super) header: Header<'a>,
    pub(super) name: Cow<'a, [String]>,
    /// Encoder angles, rad or m.
    pub(super) position: Cow<'a, [f64]>,
    pub(super) velocity: Cow<'a, [f64]>,
    pub(super) effort: Cow<'a, [f64]>,
}

impl Message for JointState<'_> {
    const NAME: &'static str = "sensor_msgs/msg/JointState";
    const TEXTS: &'static [(&'static str, &'static str)] =
        &[text!("sensor_msgs", "JointState"), HEADER, TIME];
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Temperature<'a> {
    pub(super) header: Header<'a>,
    /// °C.
    pub(super) temperature: f64,
    /// Zero: unknown.
    pub(super) variance: f64,
}

impl Message for Temperature<'_> {
    const NAME: &'static str = "sensor_msgs/msg/Temperature";
    const TEXTS: &'static [(&'static str, &'static str)] =
        &[text!("sensor_msgs", "Temperature"), HEADER, TIME];
}

/// Three numbers: `Vector3` and `Point` alike.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Xyz {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Xyzw {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
    pub(super) w: f64,
}

/// Nested structs are flat in CDR, so `Pose` needs no struct of its own.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PoseStamped<'a> {
    pub(super) header: Header<'a>,
    pub(super) position: Xyz,
    pub(super) orientation: Xyzw,
}

impl Message for PoseStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/PoseStamped";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("geometry_msgs", "PoseStamped"),
        HEADER,
        TIME,
        text!("geometry_msgs", "Pose"),
        POINT,
        QUATERNION,
    ];
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct WrenchStamped<'a> {
    pub(super) header: Header<'a>,
    /// N.
    pub(super) force: Xyz,
    /// N·m.
    pub(super) torque: Xyz,
}

impl Message for WrenchStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/WrenchStamped";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("geometry_msgs", "WrenchStamped"),
        HEADER,
        TIME,
        text!("geometry_msgs", "Wrench"),
        VECTOR3,
    ];
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct TransformStamped<'a> {
    pub(super) header: Header<'a>,
    pub(super) child_frame_id: Cow<'a, str>,
    pub(super) translation: Xyz,
    pub(super) rotation: Xyzw,
}

impl Message for TransformStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/TransformStamped";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("geometry_msgs", "TransformStamped"),
        HEADER,
        TIME,
        text!("geometry_msgs", "Transform"),
        VECTOR3,
        QUATERNION,
    ];
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PointStamped<'a> {
    pub(super) header: Header<'a>,
    pub(super) point: Xyz,
}

impl Message for PointStamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/PointStamped";
    const TEXTS: &'static [(&'static str, &'static str)] =
        &[text!("geometry_msgs", "PointStamped"), HEADER, TIME, POINT];
}

/// Transforms of many frames at one time.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Transforms<'a> {
    pub(super) transforms: Vec<TransformStamped<'a>>,
}

impl Message for Transforms<'_> {
    const NAME: &'static str = "tf2_msgs/msg/TFMessage";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("tf2_msgs", "TFMessage"),
        text!("geometry_msgs", "TransformStamped"),
        HEADER,
        TIME,
        text!("geometry_msgs", "Transform"),
        VECTOR3,
        QUATERNION,
    ];
}

/// Points with more numbers each; `data` holds them packed.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PointCloud<'a> {
    pub(super) header: Header<'a>,
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) fields: Vec<PointField>,
    pub(super) is_bigendian: bool,
    pub(super) point_step: u32,
    pub(super) row_step: u32,
    pub(super) data: Vec<u8>,
    pub(super) is_dense: bool,
}

/// Where a number stands in a point.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct PointField {
    pub(super) name: String,
    pub(super) offset: u32,
    pub(super) datatype: u8,
    pub(super) count: u32,
}

impl Message for PointCloud<'_> {
    const NAME: &'static str = "sensor_msgs/msg/PointCloud2";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("sensor_msgs", "PointCloud2"),
        HEADER,
        TIME,
        text!("sensor_msgs", "PointField"),
    ];
}

impl<'a> PointCloud<'a> {
    /// Points one after the other, `step` bytes each.
    pub(super) fn of(
        header: Header<'a>,
        fields: Vec<PointField>,
        step: usize,
        data: Vec<u8>,
    ) -> std::io::Result<Self> {
        let number = |x: usize| u32::try_from(x).map_err(std::io::Error::other);
        Ok(Self {
            header,
            height: 1,
            width: number(data.len() / step)?,
            fields,
            is_bigendian: false,
            point_step: number(step)?,
            row_step: number(data.len())?,
            data,
            is_dense: true,
        })
    }
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Vector3Stamped<'a> {
    pub(super) header: Header<'a>,
    pub(super) vector: Xyz,
}

impl Message for Vector3Stamped<'_> {
    const NAME: &'static str = "geometry_msgs/msg/Vector3Stamped";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("geometry_msgs", "Vector3Stamped"),
        HEADER,
        TIME,
        VECTOR3,
    ];
}

/// Numbers that viewers plot by themselves; the layout's label names them.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Float64MultiArray {
    pub(super) dim: Vec<MultiArrayDimension>,
    pub(super) data_offset: u32,
    pub(super) data: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct MultiArrayDimension {
    pub(super) label: String,
    pub(super) size: u32,
    pub(super) stride: u32,
}

impl Message for Float64MultiArray {
    const NAME: &'static str = "std_msgs/msg/Float64MultiArray";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("std_msgs", "Float64MultiArray"),
        text!("std_msgs", "MultiArrayLayout"),
        text!("std_msgs", "MultiArrayDimension"),
    ];
}

/// One step of a ladder; see `msg/misfit_msgs_Rung.msg`.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Rung<'a> {
    pub(super) header: Header<'a>,
    pub(super) added: Cow<'a, str>,
    pub(super) fitted_rms_m: f64,
    pub(super) heldout_rms_m: Vec<f64>,
    pub(super) position: Xyz,
    pub(super) orientation: Xyzw,
}

impl Message for Rung<'_> {
    const NAME: &'static str = "misfit_msgs/msg/Rung";
    const TEXTS: &'static [(&'static str, &'static str)] = &[
        text!("misfit_msgs", "Rung"),
        HEADER,
        TIME,
        text!("geometry_msgs", "Pose"),
        POINT,
        QUATERNION,
    ];
}

/// One step of the solver; see `msg/misfit_msgs_FitProgress.msg`.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct FitProgress<'a> {
    pub(super) header: Header<'a>,
    pub(super) rung: u32,
    pub(super) iteration: u32,
    pub(super) cost: f64,
}

impl Message for FitProgress<'_> {
    const NAME: &'static str = "misfit_msgs/msg/FitProgress";
    const TEXTS: &'static [(&'static str, &'static str)] =
        &[text!("misfit_msgs", "FitProgress"), HEADER, TIME];
}

/// What the standard types lack; see `msg/misfit_msgs_Reading.msg`.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct ReadingMessage<'a> {
    pub(super) header: Header<'a>,
    pub(super) line: u64,
    pub(super) target: Cow<'a, str>,
    pub(super) pose: Cow<'a, [String]>,
    pub(super) repeat: Cow<'a, [String]>,
    pub(super) heldout: bool,
    pub(super) has_orientation: bool,
    pub(super) has_wrench: bool,
    pub(super) time: Cow<'a, [f64]>,
    pub(super) temperature: Cow<'a, [f64]>,
    pub(super) temperature_links: Vec<String>,
    pub(super) link_temperatures: Vec<f64>,
    pub(super) approach: Vec<i8>,
    pub(super) payload: Vec<f64>,
}

impl Message for ReadingMessage<'_> {
    const NAME: &'static str = "misfit_msgs/msg/Reading";
    const TEXTS: &'static [(&'static str, &'static str)] =
        &[text!("misfit_msgs", "Reading"), HEADER, TIME];
}
