//! A recording being filled: channels, messages, attachments.

use super::CDR;
use super::messages::{Header, Message, Time, encode, schema};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Seek, Write};

/// A file of the profile `ros2` to be filled.
pub(super) fn writer<W: Write + Seek>(file: W) -> io::Result<Writer<W>> {
    WriteOptions::new()
        .profile("ros2")
        .library(concat!("misfit/", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Zstd))
        // One thread and a fixed level: the bytes must not depend on the machine.
        .compression_threads(0)
        .compression_level(1)
        .chunk_size(Some(1 << 20))
        .create(file)
        .map_err(io::Error::other)
}

/// A channel with its schema; a latched one is seen by whoever joins late.
pub(super) fn channel<M: Message, W: Write + Seek>(
    writer: &mut Writer<W>,
    topic: &str,
    latched: bool,
) -> io::Result<u16> {
    // Integers, which old and new versions of rosbag2 read; words fail on the older ones.
    let durability = if latched { 1 } else { 2 };
    let zero = "    sec: 0\n    nsec: 0\n";
    let qos = format!(
        "- history: 1\n  depth: 1\n  reliability: 1\n  durability: {durability}\n  deadline:\n{zero}  lifespan:\n{zero}  liveliness: 1\n  liveliness_lease_duration:\n{zero}  avoid_ros_namespace_conventions: false\n"
    );
    let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), qos)]);
    let schema = writer
        .add_schema(M::NAME, "ros2msg", schema::<M>().as_bytes())
        .map_err(io::Error::other)?;
    writer
        .add_channel(schema, topic, CDR, &metadata)
        .map_err(io::Error::other)
}

/// A file being filled.
pub(super) struct Recorder<W: Write + Seek> {
    pub(super) writer: Writer<W>,
}

impl<W: Write + Seek> Recorder<W> {
    pub(super) fn metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> io::Result<()> {
        self.writer
            .write_metadata(&Metadata {
                name: name.into(),
                metadata,
            })
            .map_err(io::Error::other)
    }

    pub(super) fn attach(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let media_type = match name.rsplit_once('.') {
            Some((_, "toml")) => "application/toml",
            Some((_, "urdf" | "xml")) => "application/xml",
            Some((_, "json")) => "application/json",
            _ => "application/octet-stream",
        };
        self.writer
            .attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: name.into(),
                media_type: media_type.into(),
                data: Cow::Borrowed(bytes),
            })
            .map_err(io::Error::other)
    }

    pub(super) fn message<M: Message>(
        &mut self,
        channel: u16,
        sequence: u32,
        log_time: u64,
        message: &M,
    ) -> io::Result<()> {
        let mut bytes = Vec::new();
        encode(message, &mut bytes).map_err(io::Error::other)?;
        self.bytes(channel, sequence, log_time, &bytes)
    }

    pub(super) fn bytes(
        &mut self,
        channel: u16,
        sequence: u32,
        log_time: u64,
        bytes: &[u8],
    ) -> io::Result<()> {
        let header = MessageHeader {
            channel_id: channel,
            sequence,
            log_time,
            publish_time: log_time,
        };
        self.writer
            .write_to_known_channel(&header, bytes)
            .map_err(io::Error::other)
    }
}

/// Messages of one reading, one behind the other, each with its channel and its end.
#[derive(Default)]
pub(super) struct Encoded {
    pub(super) bytes: Vec<u8>,
    pub(super) ends: Vec<(u16, usize)>,
}

impl Encoded {
    pub(super) fn add<M: Message>(&mut self, channel: u16, message: &M) -> io::Result<()> {
        encode(message, &mut self.bytes).map_err(io::Error::other)?;
        self.ends.push((channel, self.bytes.len()));
        Ok(())
    }
}

pub(super) fn stamp(log_time: u64) -> Time {
    const SECOND: u64 = 1_000_000_000;
    Time {
        // More than 68 years of one-second steps: the stamp stays at its largest.
        sec: i32::try_from(log_time / SECOND).unwrap_or(i32::MAX),
        nanosec: (log_time % SECOND) as u32,
    }
}

pub(super) fn header(log_time: u64, frame_id: &str) -> Header<'_> {
    Header {
        stamp: stamp(log_time),
        frame_id: Cow::Borrowed(frame_id),
    }
}
