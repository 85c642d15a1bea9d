//! OBJ text, one checked and rewritten line at a time: what `tobj` reads from.
//!
//! `tobj` reports errors without a line, takes names from the file to open, and mixes up vertices of which only some
//! have a normal. A [`Normalizer`] hands it one [statement](super::statements) at a time, so that the
//! line at an error is known, and only statements of the few forms that `tobj` reads without surprises.

use std::io::{self, BufRead, Read};

use super::error::SceneError;
use super::lines::{Lines, excerpt};
use super::statements::Statements;

/// A `BufRead` over normalised OBJ text.
pub struct Normalizer<R> {
    lines: Lines<R>,
    out: Vec<u8>,
    consumed: usize,
    error: Option<SceneError>,
    /// What the statements so far amount to.
    pub statements: Statements,
}

impl<R: Read> Normalizer<R> {
    /// Reads OBJ text of `file` (the name for messages), at most `max_bytes` of it.
    pub fn new(reader: R, file: &str, max_bytes: u64) -> Self {
        Self {
            lines: Lines::new(reader, file, max_bytes),
            out: Statements::PROLOGUE.to_vec(),
            consumed: 0,
            error: None,
            statements: Statements::new(file),
        }
    }

    /// Why `tobj` stopped: the reason of this side, or else the statement that it read last.
    pub fn explain(&mut self, reason: &str) -> SceneError {
        self.error.take().unwrap_or_else(|| {
            let what = format!("cannot read `{}`: {reason}", excerpt(&self.out));
            SceneError::bad_data(self.lines.place(), what, "write numbers as in `v 1.5 -2 3e-4`")
        })
    }

    /// Fills `out` with the next normalised line; leaves it empty at the end of the file.
    fn advance(&mut self) -> Result<(), SceneError> {
        self.out.clear();
        self.consumed = 0;
        while self.out.is_empty() {
            let Some((number, line)) = self.lines.next()? else {
                break;
            };
            self.statements.rewrite(number, line, &mut self.out)?;
        }
        Ok(())
    }
}

impl<R: Read> BufRead for Normalizer<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.consumed == self.out.len() {
            self.advance().map_err(|error| {
                self.error = Some(error);
                io::Error::from(io::ErrorKind::InvalidData)
            })?;
        }
        Ok(&self.out[self.consumed..])
    }

    fn consume(&mut self, count: usize) {
        self.consumed += count;
    }
}

impl<R: Read> Read for Normalizer<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}
