//! Base64 as VTK writes it: pieces with their own padding one after another, until a tag begins.

use std::io::{self, BufRead, Read};

/// The bytes that text in base64 stands for. Ends at `<` or at the end of the text.
pub struct Base64<R> {
    inner: R,
    /// Decoded bytes that wait, in `ready[at..end]`.
    ready: [u8; 3],
    at: usize,
    end: usize,
}

impl<R: BufRead> Base64<R> {
    /// From the text's first character on.
    pub fn new(inner: R) -> Base64<R> {
        Base64 { inner, ready: [0; 3], at: 0, end: 0 }
    }

    /// The next character that is not blank, `None` at the end.
    fn character(&mut self) -> io::Result<Option<u8>> {
        loop {
            let Some(&byte) = self.inner.fill_buf()?.first() else { return Ok(None) };
            if byte == b'<' {
                return Ok(None);
            }
            self.inner.consume(1);
            if !byte.is_ascii_whitespace() {
                return Ok(Some(byte));
            }
        }
    }

    /// Decodes the next four characters; `false` at the end.
    fn group(&mut self) -> io::Result<bool> {
        let mut bits = 0u32;
        let mut padding = 0;
        for index in 0..4 {
            let Some(character) = self.character()? else {
                let kind = io::ErrorKind::UnexpectedEof;
                return if index == 0 { Ok(false) } else { Err(kind.into()) };
            };
            let six = match character {
                b'=' if index > 1 => {
                    padding += 1;
                    0
                }
                _ if padding > 0 => return Err(invalid(character)),
                b'A'..=b'Z' => character - b'A',
                b'a'..=b'z' => character - b'a' + 26,
                b'0'..=b'9' => character - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => return Err(invalid(character)),
            };
            bits = bits << 6 | u32::from(six);
        }
        let [_, bytes @ ..] = bits.to_be_bytes();
        (self.ready, self.at, self.end) = (bytes, 0, 3 - padding);
        Ok(true)
    }
}

fn invalid(character: u8) -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        format!("character {} is not base64", character.escape_ascii()),
    )
}

impl<R: BufRead> Read for Base64<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut got = 0;
        while got < buffer.len() {
            if self.at == self.end && !self.group()? {
                break;
            }
            // Whole groups go past the waiting bytes' loop one at a time: at most three of them.
            buffer[got] = self.ready[self.at];
            self.at += 1;
            got += 1;
        }
        Ok(got)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(text: &str) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        Base64::new(text.as_bytes()).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    #[test]
    fn pieces_with_padding_follow_one_another() {
        assert_eq!(decoded(" Zm9v\nYg==Zm8= <").unwrap(), b"foobfo");
        assert!(decoded("Zm9").is_err());
        assert!(decoded("Z=9v").is_err());
        assert!(decoded("Zm9*").is_err());
    }
}
