//! The outline of a URDF's text: what the XML parser must never see, and where each link and joint begins.
//!
//! The parser behind `urdf-rs` recurses over nested elements, reads `xyz="0 x 1 2"` as three numbers and names no
//! line in its errors. So the text is first cut into tags by a strict grammar; only the links, joints and materials
//! pass, stripped of comments and text, and a part can later be blamed by name and line.

use super::RobotError;
use super::tree::{MAX_LINKS, too_many_links};

/// `robot/link/visual/material/color` is 5 deep; extensions go a little further.
const MAX_DEPTH: usize = 32;
/// Most attributes of a tag: each name is compared with each.
const MAX_ATTRIBUTES: usize = 64;
/// Attributes that hold several numbers.
const VECTORS: [&str; 6] = ["xyz", "rpy", "size", "rgba", "scale", "quat_xyzw"];

/// The parts of a URDF that matter here.
pub(super) struct Outline<'a> {
    /// The `<robot …>` tag.
    pub root: &'a str,
    /// Links, joints and materials directly below it, in file order.
    pub parts: Vec<Part<'a>>,
}

/// One link, joint or material with everything in it.
pub(super) struct Part<'a> {
    kind: &'a str,
    name: Option<&'a str>,
    line: usize,
    opening: &'a str,
    empty: bool,
    /// Tags of the inertial, which `urdf-rs` cannot read between two visuals.
    inertial: String,
    /// The other tags, without comments and text.
    others: String,
}

impl Part<'_> {
    fn append_to(&self, text: &mut String) {
        for piece in [self.opening, &self.inertial, &self.others] {
            text.push_str(piece);
        }
        if !self.empty {
            text.push_str("</");
            text.push_str(self.kind);
            text.push('>');
        }
    }

    /// How a message names it.
    pub fn place(&self) -> String {
        match self.name {
            Some(name) => format!("{} \"{name}\" (line {})", self.kind, self.line),
            None => format!("{} (line {})", self.kind, self.line),
        }
    }
}

impl Outline<'_> {
    /// A URDF of only these parts.
    pub fn document<'b>(&self, parts: impl IntoIterator<Item = &'b Part<'b>>) -> String {
        let mut text = self.root.to_owned();
        for part in parts {
            part.append_to(&mut text);
        }
        text + "</robot>"
    }
}

/// One tag of the text.
pub struct Tag<'a> {
    /// All of it, from `<` to `>`.
    pub text: &'a str,
    /// Name of its element.
    pub name: &'a str,
    /// Names and values, entities as they stand.
    pub attributes: Vec<(&'a str, &'a str)>,
    /// `</…>`.
    pub closing: bool,
    /// `<…/>`.
    pub empty: bool,
}

impl Tag<'_> {
    /// Value of an attribute, with the five entities of XML resolved.
    pub fn value(&self, attribute: &str) -> Option<String> {
        find(self, attribute).map(|value| {
            value
                .replace("&lt;", "<")
                .replace("&gt;", ">")
                .replace("&quot;", "\"")
                .replace("&apos;", "'")
                .replace("&amp;", "&")
        })
    }
}

/// All tags of the text of a URDF that was read, each with the byte where it begins; up to the first that is none.
pub fn tags(text: &str) -> Vec<(usize, Tag<'_>)> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(start) = text[at..].find('<') {
        at += start;
        let rest = &text[at..];
        let length = match (skip(rest), read_tag(rest)) {
            (Ok(Some(length)), _) => length,
            (Ok(None), Some(tag)) => {
                let length = tag.text.len();
                found.push((at, tag));
                length
            }
            _ => break,
        };
        at += length;
    }
    found
}

/// Reads the outline, refusing what is not well-formed.
pub(super) fn outline<'a>(file: &str, text: &'a str) -> Result<Outline<'a>, RobotError> {
    let mut open: Vec<(&str, usize)> = Vec::new();
    let mut root: Option<&str> = None;
    let mut parts: Vec<Part> = Vec::new();
    // Whether the tags now read belong to the last part, and in it to an inertial.
    let mut inside = false;
    let mut inertial = false;
    let (mut links, mut joints) = (0, 0);
    let mut rest = text;
    let mut line = 1;
    while let Some(start) = rest.find('<') {
        line += newlines(&rest[..start]);
        rest = &rest[start..];
        let refuse = |found: String, accepted: &str| {
            RobotError::refused(file, format!("line {line}"), found, accepted)
        };
        if let Some(skipped) = skip(rest).map_err(|(found, accepted)| refuse(found, accepted))? {
            line += newlines(&rest[..skipped]);
            rest = &rest[skipped..];
            continue;
        }
        let tag = read_tag(rest).ok_or_else(|| {
            let shown: String = rest.chars().take(40).take_while(|&c| c != '\n').collect();
            refuse(
                format!("`{shown}` is not a complete XML tag"),
                &format!(
                    "tags look like <link name=\"tool0\"/>, with at most {MAX_ATTRIBUTES} attributes, each once"
                ),
            )
        })?;
        if tag.name.starts_with("xacro:") {
            return Err(refuse(
                format!("<{}> is a xacro macro", tag.name),
                "expand it first: xacro robot.urdf.xacro > robot.urdf",
            ));
        }
        if tag.closing {
            match open.pop() {
                Some((name, _)) if name == tag.name => {}
                Some((name, opened)) => {
                    return Err(refuse(
                        format!("</{}> where </{name}> is due", tag.name),
                        &format!("<{name}> of line {opened} is still open"),
                    ));
                }
                None => {
                    return Err(refuse(
                        format!("</{}> closes nothing", tag.name),
                        "every closing tag needs an opening one",
                    ));
                }
            }
        } else if open.is_empty() {
            if root.is_some() || tag.name != "robot" || tag.empty {
                return Err(refuse(
                    match tag.empty {
                        true => format!("an empty <{}/> at the top", tag.name),
                        false => format!("<{}> at the top", tag.name),
                    },
                    "a URDF is one <robot> element holding links and joints",
                ));
            }
            root = Some(tag.text);
        } else if open.len() == 1 {
            inside = matches!(tag.name, "link" | "joint" | "material");
            if inside {
                links += usize::from(tag.name == "link");
                joints += usize::from(tag.name == "joint");
                // in a tree there is one joint less than there are links
                if links.max(joints) > MAX_LINKS {
                    return Err(too_many_links(file, links, joints));
                }
                parts.push(Part {
                    kind: tag.name,
                    name: find(&tag, "name"),
                    line,
                    opening: tag.text,
                    empty: tag.empty,
                    inertial: String::new(),
                    others: String::new(),
                });
            }
        } else if open.len() == 2 {
            inertial = tag.name == "inertial";
        }
        if inside && let Some(part) = parts.last_mut() {
            if let Some((attribute, value)) = bad_vector(&tag) {
                return Err(RobotError::refused(
                    file,
                    part.place(),
                    format!("{attribute}=\"{value}\" on line {line}"),
                    "only numbers separated by blanks are accepted",
                ));
            }
            let is_part = open.len() == 1;
            match (is_part, inertial) {
                (true, _) => {}
                (false, true) => part.inertial += tag.text,
                (false, false) => part.others += tag.text,
            }
        }
        if !tag.closing && !tag.empty {
            if open.len() == MAX_DEPTH {
                return Err(refuse(
                    format!("<{}> is nested {} deep", tag.name, MAX_DEPTH + 1),
                    &format!("at most {MAX_DEPTH} levels are accepted"),
                ));
            }
            open.push((tag.name, line));
        }
        inside = inside && open.len() > 1;
        line += newlines(tag.text);
        rest = &rest[tag.text.len()..];
    }
    let refuse = |found: String| {
        RobotError::refused(
            file,
            "XML",
            found,
            "a URDF is one <robot> element holding links and joints",
        )
    };
    if let Some((name, opened)) = open.pop() {
        return Err(refuse(format!("<{name}> of line {opened} is never closed")));
    }
    let root = root.ok_or_else(|| refuse("there is no <robot> element".to_owned()))?;
    Ok(Outline { root, parts })
}

/// Length of a comment, processing instruction or CDATA section that begins here.
fn skip(text: &str) -> Result<Option<usize>, (String, &'static str)> {
    for (begin, end) in [("<!--", "-->"), ("<?", "?>"), ("<![CDATA[", "]]>")] {
        if let Some(inner) = text.strip_prefix(begin) {
            return match inner.find(end) {
                Some(length) => Ok(Some(begin.len() + length + end.len())),
                None => Err((
                    format!("{begin} is never closed"),
                    "it ends before the file does",
                )),
            };
        }
    }
    if text.starts_with("<!") {
        // Entities are defined there: a few lines of them can stand for gigabytes.
        return Err((
            "a document type declaration".to_owned(),
            "remove it: a URDF needs none, and entities are not expanded",
        ));
    }
    Ok(None)
}

/// The tag that begins here, or `None` if it is malformed.
fn read_tag(text: &str) -> Option<Tag<'_>> {
    let mut rest = text.strip_prefix('<')?;
    let closing = rest.starts_with('/');
    rest = rest.strip_prefix('/').unwrap_or(rest);
    let name = read_name(&mut rest)?;
    let mut attributes = Vec::new();
    loop {
        rest = rest.trim_start();
        let (end, empty) = match rest.as_bytes() {
            [b'>', ..] => (1, false),
            [b'/', b'>', ..] if !closing => (2, true),
            _ => {
                let attribute = read_name(&mut rest)?;
                rest = rest.trim_start().strip_prefix('=')?.trim_start();
                let quote = rest.chars().next().filter(|&c| c == '"' || c == '\'')?;
                let (value, after) = rest[1..].split_once(quote)?;
                if closing
                    || value.contains('<')
                    || attributes.len() == MAX_ATTRIBUTES
                    || attributes.iter().any(|&(n, _)| n == attribute)
                {
                    return None;
                }
                attributes.push((attribute, value));
                rest = after;
                continue;
            }
        };
        return Some(Tag {
            text: &text[..text.len() - rest.len() + end],
            name,
            attributes,
            closing,
            empty,
        });
    }
}

fn read_name<'a>(rest: &mut &'a str) -> Option<&'a str> {
    let length = rest
        .find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ':')))
        .unwrap_or(rest.len());
    let (name, after) = rest.split_at(length);
    *rest = after;
    (!name.is_empty()).then_some(name)
}

fn find<'a>(tag: &Tag<'a>, attribute: &str) -> Option<&'a str> {
    let found = tag.attributes.iter().find(|(name, _)| *name == attribute);
    found.map(|(_, value)| *value)
}

fn bad_vector<'a>(tag: &Tag<'a>) -> Option<(&'a str, &'a str)> {
    tag.attributes
        .iter()
        .copied()
        .filter(|(name, _)| VECTORS.contains(name))
        .find(|(_, value)| {
            value
                .split_whitespace()
                .any(|word| word.parse::<f64>().is_err())
        })
}

fn newlines(text: &str) -> usize {
    text.bytes().filter(|&b| b == b'\n').count()
}
