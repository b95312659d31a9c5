//! The XML of a URDF, read by `roxmltree`: within limits, and with messages that name lines.
//!
//! The parser neither recurses nor expands entities without a document type. What is left is checked before it: counts
//! that it reserves memory for, attributes and namespaces that it compares each with each, and sections that never end,
//! whose beginning it does not tell.

use std::borrow::Cow;

use roxmltree::{Document, Error, Node, TextPos};

use super::RobotError;
use super::error::short;

/// `robot/link/visual/material/color` is 5 deep; extensions go a little further.
const MAX_DEPTH: usize = 32;
/// Most attributes of a tag: the parser compares each name with each.
const MAX_ATTRIBUTES: usize = 64;
/// Most declarations of namespaces in a file: below each the parser looks through all above it.
const MAX_NAMESPACES: usize = 64;
/// Most `<` and `=` in a file: for each the parser reserves a node or an attribute, about 100 bytes.
const MAX_TAGS_AND_ATTRIBUTES: usize = 1_000_000;
/// Sections that hold no tags: how they begin and end.
const SECTIONS: [(&str, &str); 3] = [("<!--", "-->"), ("<?", "?>"), ("<![CDATA[", "]]>")];

const ONE_ROBOT: &str = "a URDF is one <robot> element holding links and joints";

/// The text for [`parse`], byte for byte as long: without the hyphens in comments that XML forbids and others read.
///
/// # Errors
/// If the text declares entities or nests too deeply.
pub fn clean<'a>(file: &str, text: &'a str) -> Result<Cow<'a, str>, RobotError> {
    let mut clean = Cow::Borrowed(text);
    let mut at = 0;
    while let Some(ahead) = text[at..].find('<') {
        at += ahead;
        let rest = &text[at..];
        let refuse = |found: String, accepted: &str| {
            let place = format!("line {}", line(text, at));
            Err(RobotError::refused(file, place, found, accepted))
        };
        let section = SECTIONS.iter().find(|(begin, _)| rest.starts_with(begin));
        if let Some((begin, end)) = section {
            let from = at + begin.len();
            let Some(length) = text[from..].find(end) else {
                let accepted = format!("it ends with {end}");
                return refuse(format!("{begin} is never closed"), &accepted);
            };
            let inside = &text[from..from + length];
            if *begin == "<!--" && (inside.contains("--") || inside.ends_with('-')) {
                let blank = inside.replace('-', " ");
                clean.to_mut().replace_range(from..from + length, &blank);
            }
            at = from + length + end.len();
            continue;
        }
        if rest.starts_with("<!") {
            return refuse(
                "a document type declaration".to_owned(),
                "remove it: a URDF needs none, and entities are not expanded",
            );
        }
        // No tag goes on behind the next `<`.
        let length = rest[1..].find('<').map_or(rest.len(), |next| 1 + next);
        let values = rest[..length].split('=').skip(1);
        let quoted = values.filter(|value| value.trim_start().starts_with(['"', '\'']));
        let attributes = quoted.count();
        if attributes > MAX_ATTRIBUTES {
            return refuse(
                format!("a tag of {attributes} attributes"),
                &format!("at most {MAX_ATTRIBUTES} attributes are accepted"),
            );
        }
        at += length;
    }
    let marks = text.bytes().filter(|byte| matches!(byte, b'<' | b'='));
    for (what, count, most) in [
        (
            "tags and attributes",
            marks.count(),
            MAX_TAGS_AND_ATTRIBUTES,
        ),
        ("namespaces", text.matches("xmlns").count(), MAX_NAMESPACES),
    ] {
        if count > most {
            return Err(RobotError::refused(
                file,
                "XML",
                format!("{count} {what}"),
                format!("at most {most} are accepted"),
            ));
        }
    }
    Ok(clean)
}

/// Reads a text that is [`clean`].
///
/// # Errors
/// If it is no well-formed XML, or its root is no `<robot>`.
pub fn parse<'a>(file: &str, text: &'a str) -> Result<Document<'a>, RobotError> {
    let document = Document::parse(text).map_err(|error| malformed(file, text, &error))?;
    let refuse = |node: Node<'_, '_>, found: String, accepted: &str| {
        let place = format!("line {}", line(text, node.range().start));
        Err(RobotError::refused(file, place, found, accepted))
    };
    let root = document.root_element();
    let name = short(root.tag_name().name());
    if name != "robot" || is_empty(root) {
        let end = if is_empty(root) { "/" } else { "" };
        return refuse(root, format!("<{name}{end}> at the top"), ONE_ROBOT);
    }
    for node in document.descendants().filter(Node::is_element) {
        if text[node.range().start..].starts_with("<xacro:") {
            return Err(xacro(file, line(text, node.range().start)));
        }
        // The ancestors are the element itself, those around it, and the document.
        if node.ancestors().nth(MAX_DEPTH + 1).is_some() {
            let name = short(node.tag_name().name());
            return refuse(
                node,
                format!("<{name}> is nested {} deep", MAX_DEPTH + 1),
                &format!("at most {MAX_DEPTH} levels are accepted"),
            );
        }
    }
    Ok(document)
}

/// Is an element a single tag, `<…/>`?
pub(super) fn is_empty(element: Node<'_, '_>) -> bool {
    !element.has_children() && source(element).ends_with("/>")
}

/// The text of an element, from its first tag to its last.
pub(super) fn source<'a>(element: Node<'_, 'a>) -> &'a str {
    &element.document().input_text()[element.range()]
}

/// Number of the line of a byte of a text.
pub(super) fn line(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count()
}

fn xacro(file: &str, line: usize) -> RobotError {
    RobotError::refused(
        file,
        format!("line {line}"),
        "a xacro macro",
        "expand it first: xacro robot.urdf.xacro > robot.urdf",
    )
}

/// The parser's message in the words of this program, with the line.
fn malformed(file: &str, text: &str, error: &Error) -> RobotError {
    let refuse = |place: String, found: String, accepted: String| {
        RobotError::refused(file, place, found, accepted)
    };
    match error {
        Error::NoRootNode => refuse(
            "XML".to_owned(),
            "there is no <robot> element".to_owned(),
            ONE_ROBOT.to_owned(),
        ),
        Error::UnknownToken(_) if !text.contains('<') => malformed(file, text, &Error::NoRootNode),
        Error::UnclosedRootNode => {
            let found = match innermost_open(text) {
                Some((name, line)) => format!("<{name}> of line {line} is never closed"),
                None => format!("more than {MAX_DEPTH} elements are never closed"),
            };
            refuse("XML".to_owned(), found, ONE_ROBOT.to_owned())
        }
        Error::UnexpectedCloseTag(due, found, pos) => {
            let (due, found) = (short(due), short(found));
            let accepted = match innermost_open(&text[..offset(text, *pos)]) {
                Some((_, line)) => format!("<{due}> of line {line} is still open"),
                None => format!("<{due}> is still open"),
            };
            let found = format!("</{found}> where </{due}> is due");
            refuse(format!("line {}", pos.row), found, accepted)
        }
        Error::UnknownNamespace(prefix, pos) if prefix == "xacro" => xacro(file, pos.row as usize),
        Error::UnknownNamespace(prefix, pos) => {
            let prefix = short(prefix);
            refuse(
                format!("line {}", pos.row),
                format!("no namespace is declared for the prefix `{prefix}:`"),
                format!("remove it, or write <robot xmlns:{prefix}=\"…\" …>"),
            )
        }
        _ => {
            // An end that comes too early has no position: what it cuts off begins at the last tag.
            let at = match error {
                Error::UnexpectedEndOfStream => text.len(),
                _ => offset(text, error.pos()),
            };
            let next = text[at..].chars().next().map_or(at, |c| at + c.len_utf8());
            let start = text[..next].rfind('<').unwrap_or(at);
            let shown: String = text[start..].chars().take(40).collect();
            let shown = shown.split(['\n', '\r']).next().unwrap_or_default();
            let reason = error
                .to_string()
                .replace(&format!(" at {}", error.pos()), "");
            refuse(
                format!("line {}", line(text, start)),
                format!("`{shown}` is not well-formed XML ({})", short(&reason)),
                "tags look like <link name=\"tool0\"/>, each attribute once and in quotes"
                    .to_owned(),
            )
        }
    }
}

/// The byte of a position.
fn offset(text: &str, pos: TextPos) -> usize {
    let before = text.split_inclusive('\n').take(pos.row as usize - 1);
    let start: usize = before.map(str::len).sum();
    let mut letters = text[start..].char_indices().skip(pos.col as usize - 1);
    letters.next().map_or(text.len(), |(at, _)| start + at)
}

/// Name and line of the innermost element that is open at the end of a text, if at most [`MAX_DEPTH`] are.
///
/// The parser tells neither, but what it expects in place of a wrong end tag: so elements are closed one by one.
fn innermost_open(text: &str) -> Option<(String, usize)> {
    let mut closed = text.to_owned();
    for _ in 0..=MAX_DEPTH {
        match Document::parse(&format!("{closed}</_>")) {
            Err(Error::UnexpectedCloseTag(due, ..)) => closed += &format!("</{due}>"),
            _ => break,
        }
    }
    let document = Document::parse(&closed).ok()?;
    let mut open = document.root_element();
    while let Some(last) = open.last_element_child()
        && last.range().end > text.len()
    {
        open = last;
    }
    let name = short(open.tag_name().name());
    Some((name, line(text, open.range().start)))
}
