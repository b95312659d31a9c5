//! Text in whatever encoding, as UTF-8.

#[cfg(feature = "encodings")]
mod any {
    use std::io::Read;

    /// How the bytes of a table are written.
    pub type Encoding = &'static encoding_rs::Encoding;

    /// The encoding with a label of the WHATWG standard.
    pub fn for_label(label: &str) -> Option<Encoding> {
        encoding_rs::Encoding::for_label(label.as_bytes())
    }

    /// A byte order mark says UTF-8 or UTF-16; without one UTF-8 passes as it is, errors and all.
    pub fn decoded<'a>(input: impl Read + 'a, encoding: Option<Encoding>) -> Box<dyn Read + 'a> {
        Box::new(
            encoding_rs_io::DecodeReaderBytesBuilder::new()
                .encoding(encoding)
                .utf8_passthru(true)
                .strip_bom(true)
                .bom_override(true)
                .build(input),
        )
    }
}

#[cfg(not(feature = "encodings"))]
mod any {
    use std::io::{Cursor, Read};

    /// How the bytes of a table are written: UTF-8, for the feature `encodings` is off.
    pub type Encoding = ();

    /// The encoding with a label of the WHATWG standard.
    pub fn for_label(label: &str) -> Option<Encoding> {
        ["utf-8", "utf8"]
            .contains(&label.to_ascii_lowercase().as_str())
            .then_some(())
    }

    /// The input without its byte order mark.
    pub fn decoded<'a>(mut input: impl Read + 'a, _: Option<Encoding>) -> Box<dyn Read + 'a> {
        let mut start = Vec::new();
        // what cannot be read here cannot be read later either, and is said there
        let read = input.by_ref().take(3).read_to_end(&mut start);
        if read.is_ok() && start == b"\xef\xbb\xbf" {
            start.clear();
        }
        Box::new(Cursor::new(start).chain(input))
    }
}

pub(super) use any::{Encoding, decoded, for_label};
