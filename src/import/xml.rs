//! A scanner for tags, enough for the headers in XML that volumes come with. It streams: what stands
//! between tags is passed over.

use std::io::BufRead;

use crate::error::{Error, Result};

/// Longer tags are refused.
const TAG_BYTES_MAX: usize = 64 << 10;
/// Text between tags is kept up to here.
const TEXT_BYTES_MAX: usize = 256;

/// One tag and the beginning of the text before it.
#[derive(Debug)]
pub struct Tag {
    /// With a slash in front for an end tag; without the prefix of a namespace.
    pub name: String,
    pub attributes: Vec<(String, String)>,
    /// The text between the tag before and this one: its beginning.
    pub text: String,
}

impl Tag {
    /// The value of an attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }
}

/// The tags of a document, in order.
pub struct Tags<R> {
    reader: R,
    offset: u64,
}

impl<R: BufRead> Tags<R> {
    /// From the document's first byte on.
    pub fn new(reader: R) -> Tags<R> {
        Tags { reader, offset: 0 }
    }

    /// Bytes of the document up to the end of the last tag.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The next tag, `None` at the end. Comments and declarations are passed over.
    pub fn next(&mut self) -> Result<Option<Tag>> {
        loop {
            let Some(text) = self.text()? else { return Ok(None) };
            let inside = self.inside()?;
            if inside.starts_with(b"!") || inside.starts_with(b"?") {
                continue;
            }
            let tag = String::from_utf8_lossy(&inside);
            let (name, rest) = match tag.find(|c: char| c.is_whitespace()) {
                Some(end) => tag.split_at(end),
                None => (tag.as_ref(), ""),
            };
            let slash = if name.starts_with('/') { "/" } else { "" };
            let plain = name.trim_matches('/');
            let plain = plain.rsplit(':').next().unwrap_or(plain);
            return Ok(Some(Tag {
                name: format!("{slash}{plain}"),
                attributes: attributes(rest),
                text: String::from_utf8_lossy(text.trim_ascii()).into_owned(),
            }));
        }
    }

    /// The beginning of the text up to the next `<`, which is consumed.
    fn text(&mut self) -> Result<Option<Vec<u8>>> {
        let mut text = Vec::new();
        loop {
            let piece = self.reader.fill_buf().map_err(unreadable)?;
            if piece.is_empty() {
                return Ok(None);
            }
            let end = piece.iter().position(|byte| *byte == b'<');
            let here = end.unwrap_or(piece.len());
            let keep = here.min(TEXT_BYTES_MAX - text.len());
            text.extend_from_slice(&piece[..keep]);
            let used = here + usize::from(end.is_some());
            self.reader.consume(used);
            self.offset += used as u64;
            if end.is_some() {
                return Ok(Some(text));
            }
        }
    }

    /// What stands between `<` and its `>`.
    fn inside(&mut self) -> Result<Vec<u8>> {
        let mut inside = Vec::new();
        let mut quote = None;
        loop {
            let piece = self.reader.fill_buf().map_err(unreadable)?;
            let Some(&byte) = piece.first() else {
                return Err(Error::input("the XML ends inside a tag"));
            };
            self.reader.consume(1);
            self.offset += 1;
            let comment = inside.starts_with(b"!--");
            match (quote, byte) {
                (None, b'>') if !comment || (inside.len() > 4 && inside.ends_with(b"--")) => {
                    return Ok(inside);
                }
                (None, b'"' | b'\'') if !comment => quote = Some(byte),
                (Some(open), _) if open == byte => quote = None,
                _ => {}
            }
            // Of a comment only its ends matter.
            if comment && inside.len() > 64 {
                inside.drain(4..inside.len() - 2);
            }
            inside.push(byte);
            if inside.len() > TAG_BYTES_MAX {
                return Err(Error::input(format!(
                    "the XML has a tag longer than {TAG_BYTES_MAX} bytes"
                )));
            }
        }
    }
}

fn unreadable(why: std::io::Error) -> Error {
    Error::input(format!("the XML cannot be read: {why}"))
}

fn attributes(mut rest: &str) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    while let Some((name, after)) = rest.split_once('=') {
        let after = after.trim_start();
        let Some(quote) = after.chars().next().filter(|c| "\"'".contains(*c)) else { break };
        let Some((value, after)) = after[1..].split_once(quote) else { break };
        attributes.push((name.trim().to_owned(), unescaped(value)));
        rest = after;
    }
    attributes
}

fn unescaped(value: &str) -> String {
    let mut out = String::new();
    let mut rest = value;
    while let Some((before, after)) = rest.split_once('&') {
        out += before;
        let Some((entity, after)) = after.split_once(';').filter(|(entity, _)| entity.len() < 10)
        else {
            out.push('&');
            rest = after;
            continue;
        };
        let code = match entity.strip_prefix('#') {
            Some(number) => match number.strip_prefix('x') {
                Some(hex) => u32::from_str_radix(hex, 16).ok(),
                None => number.parse().ok(),
            },
            None => match entity {
                "amp" => Some(u32::from('&')),
                "lt" => Some(u32::from('<')),
                "gt" => Some(u32::from('>')),
                "quot" => Some(u32::from('"')),
                "apos" => Some(u32::from('\'')),
                _ => None,
            },
        };
        out.push(code.and_then(char::from_u32).unwrap_or(char::REPLACEMENT_CHARACTER));
        rest = after;
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_attributes_entities_comments() {
        let text = "<?xml version='1.0'?><!-- a > b <c> --><o:A x='1 > 0' y=\"&#181;m &amp;\"/>\n text</o:A>";
        let mut tags = Tags::new(text.as_bytes());
        let tag = tags.next().unwrap().unwrap();
        assert_eq!(
            (tag.name.as_str(), tag.get("x"), tag.get("y")),
            ("A", Some("1 > 0"), Some("µm &"))
        );
        let end = tags.next().unwrap().unwrap();
        assert_eq!((end.name.as_str(), end.text.as_str()), ("/A", "text"));
        assert_eq!(tags.offset(), text.len() as u64);
        assert!(tags.next().unwrap().is_none());
        assert!(Tags::new("<a".as_bytes()).next().is_err());
    }
}
