//! Lines of text files as they are found in the wild, a piece of the file in memory at a time.

use std::io::{self, Read};
use std::ops::Range;

use super::error::{Place, SceneError};

/// Reads lines that end in LF, CR LF or CR, joins those continued by a `\`, and counts them.
///
/// Lines are bytes, not text: [`decode`] makes text of the few that hold names.
pub struct Lines<R> {
    reader: R,
    file: String,
    buffer: Vec<u8>,
    /// What of the buffer is read but not yet handed out.
    unread: Range<usize>,
    end_of_file: bool,
    /// The last line ended in CR, so a LF that follows belongs to it.
    after_cr: bool,
    /// Number of the last physical line handed out.
    physical: u64,
    /// Number of the physical line on which the last logical line began.
    logical: u64,
    joined: Vec<u8>,
    bytes_left: u64,
    max_bytes: u64,
}

impl<R: Read> Lines<R> {
    /// Lines must be shorter than this many bytes; continued lines count as one.
    pub const MAX_LINE_BYTES: usize = 1 << 20;

    /// Reads `file` (the name for messages) from `reader`, at most `max_bytes` of it.
    pub fn new(reader: R, file: &str, max_bytes: u64) -> Self {
        Self {
            reader,
            file: file.to_owned(),
            buffer: vec![0; 1 << 16],
            unread: 0..0,
            end_of_file: false,
            after_cr: false,
            physical: 0,
            logical: 0,
            joined: Vec::new(),
            bytes_left: max_bytes,
            max_bytes,
        }
    }

    /// Where the last line began.
    pub fn place(&self) -> Place {
        Place::new(&self.file, self.logical)
    }

    /// The next line and its number; without the line's end, and without the byte order mark of the first.
    ///
    /// # Errors
    /// When reading fails, a line or the file is longer than its limit, or the file is UTF-16.
    pub fn next(&mut self) -> Result<Option<(u64, &[u8])>, SceneError> {
        let Some(mut line) = self.physical_line()? else {
            return Ok(None);
        };
        self.logical = self.physical;
        if self.physical == 1 {
            if self.buffer[line.clone()].starts_with(b"\xEF\xBB\xBF") {
                line.start += 3;
            } else if self.buffer[line.clone()].starts_with(b"\xFF\xFE")
                || self.buffer[line.clone()].starts_with(b"\xFE\xFF")
            {
                return Err(SceneError::bad_data(self.place(), "the file is UTF-16 text", "save it as UTF-8"));
            }
        }
        // A comment may end in a folder name; joining would lose the statement that follows.
        let continued = |line: &[u8]| line.ends_with(b"\\") && !line.trim_ascii_start().starts_with(b"#");
        if !continued(&self.buffer[line.clone()]) {
            return Ok(Some((self.logical, &self.buffer[line])));
        }
        self.joined.clear();
        loop {
            let piece = &self.buffer[line.clone()];
            let more = piece.ends_with(b"\\");
            self.joined.extend_from_slice(piece);
            if self.joined.len() > Self::MAX_LINE_BYTES {
                return Err(self.too_long());
            }
            if !more {
                break;
            }
            self.joined.pop();
            self.joined.push(b' ');
            match self.physical_line()? {
                Some(next) => line = next,
                None => break,
            }
        }
        Ok(Some((self.logical, &self.joined)))
    }

    fn too_long(&self) -> SceneError {
        let place = Place::new(&self.file, self.logical.max(self.physical));
        let what = format!("the line has {} bytes or more", Self::MAX_LINE_BYTES);
        SceneError::bad_data(place, what, "this is not a text file, or a polygon needs splitting into smaller ones")
    }

    /// Where in the buffer the next line lies.
    fn physical_line(&mut self) -> Result<Option<Range<usize>>, SceneError> {
        let mut searched = self.unread.start;
        loop {
            if self.after_cr && !self.unread.is_empty() {
                self.after_cr = false;
                if self.buffer[self.unread.start] == b'\n' {
                    self.unread.start += 1;
                }
                searched = self.unread.start;
            }
            let found = self.buffer[searched..self.unread.end].iter().position(|&byte| byte == b'\n' || byte == b'\r');
            if let Some(offset) = found {
                let line = self.unread.start..searched + offset;
                self.after_cr = self.buffer[line.end] == b'\r';
                self.unread.start = line.end + 1;
                self.physical += 1;
                return Ok(Some(line));
            }
            if self.end_of_file {
                let line = self.unread.clone();
                self.unread.start = self.unread.end;
                self.physical += u64::from(!line.is_empty());
                return Ok((!line.is_empty()).then_some(line));
            }
            searched = self.unread.end - self.unread.start;
            self.fill()?;
        }
    }

    /// Moves the unread bytes to the front of the buffer and reads more behind them.
    fn fill(&mut self) -> Result<(), SceneError> {
        self.buffer.copy_within(self.unread.clone(), 0);
        self.unread = 0..self.unread.len();
        if self.unread.end == self.buffer.len() {
            if self.buffer.len() >= Self::MAX_LINE_BYTES {
                self.physical += 1;
                return Err(self.too_long());
            }
            self.buffer.resize(self.buffer.len() * 2, 0);
        }
        let count = loop {
            match self.reader.read(&mut self.buffer[self.unread.end..]) {
                Ok(count) => break count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => {
                    return Err(SceneError::Read { place: Place::new(&self.file, self.physical), source });
                }
            }
        };
        if count as u64 > self.bytes_left {
            let what = format!("the file is longer than the limit of {} bytes", self.max_bytes);
            return Err(SceneError::bad_data(Place::new(&self.file, self.physical), what, "raise `--max-size`"));
        }
        self.bytes_left -= count as u64;
        self.unread.end += count;
        self.end_of_file = count == 0;
        Ok(())
    }
}

/// Text of a line: UTF-8, or else Latin-1, in which every byte is a character.
pub fn decode(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// Splits a line into its first word and the rest, without the blanks around them.
pub fn split_keyword(line: &[u8]) -> (&[u8], &[u8]) {
    let line = line.trim_ascii();
    let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_ascii_start())
}

/// The words of a statement that holds numbers: up to a `#`, split at blanks.
pub fn words(rest: &[u8]) -> impl Iterator<Item = &[u8]> {
    let end = rest.iter().position(|&byte| byte == b'#').unwrap_or(rest.len());
    rest[..end].split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
}

/// A piece of a line that is short enough for a message.
pub fn excerpt(bytes: &[u8]) -> String {
    let text: String = decode(bytes.trim_ascii()).chars().filter(|c| !c.is_control()).collect();
    if text.chars().count() > 60 { text.chars().take(57).chain("...".chars()).collect() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &[u8]) -> Vec<(u64, String)> {
        // A reader of one byte at a time meets every boundary.
        struct Trickle<'a>(&'a [u8]);
        impl Read for Trickle<'_> {
            fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
                let count = self.0.len().min(1);
                out[..count].copy_from_slice(&self.0[..count]);
                self.0 = &self.0[count..];
                Ok(count)
            }
        }
        let mut lines = Lines::new(Trickle(text), "t", u64::MAX);
        let mut all = Vec::new();
        while let Some((number, line)) = lines.next().expect("valid") {
            all.push((number, decode(line)));
        }
        all
    }

    #[test]
    fn every_kind_of_line_end_counts_once() {
        let expected = [(1, "a"), (2, "b"), (3, ""), (4, "c"), (5, "d")].map(|(line, text)| (line, text.to_owned()));
        assert_eq!(all(b"a\nb\n\nc\nd"), expected);
        assert_eq!(all(b"a\r\nb\r\n\r\nc\r\nd\r\n"), expected);
        assert_eq!(all(b"a\rb\r\rc\rd\r"), expected);
    }

    #[test]
    fn continued_lines_are_joined_and_numbered_by_their_first() {
        assert_eq!(all(b"f 1 \\\n2 3\nx"), [(1, "f 1  2 3".to_owned()), (3, "x".to_owned())]);
        assert_eq!(all(b"f 1 \\\r\n2\\\r\n3"), [(1, "f 1  2 3".to_owned())]);
        assert_eq!(all(b"# C:\\\nf 1 2 3"), [(1, "# C:\\".to_owned()), (2, "f 1 2 3".to_owned())]);
        assert_eq!(all(b"f 1 \\"), [(1, "f 1  ".to_owned())]);
    }

    #[test]
    fn the_byte_order_mark_is_not_part_of_the_first_line() {
        assert_eq!(all(b"\xEF\xBB\xBFv 1"), [(1, "v 1".to_owned())]);
    }

    #[test]
    fn a_line_without_end_is_refused_after_a_mebibyte() {
        let mut lines = Lines::new(io::repeat(b'x'), "t.obj", u64::MAX);
        let error = lines.next().expect_err("endless").to_string();
        assert!(error.starts_with("t.obj:1: the line has 1048576 bytes or more\nhelp: "), "{error}");
    }

    #[test]
    fn lines_longer_than_a_read_are_whole() {
        let long = "y".repeat(300_000);
        assert_eq!(all(format!("{long}\nz").as_bytes()), [(1, long), (2, "z".to_owned())]);
    }

    #[test]
    fn text_that_is_not_utf8_is_read_as_latin1() {
        assert_eq!(decode(b"caf\xE9"), "caf\u{e9}");
        assert_eq!(decode("café".as_bytes()), "café");
    }
}
