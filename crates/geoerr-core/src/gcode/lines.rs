//! A program's bytes into lines, whatever ends them.

use super::error::GcodeError;

/// A longer line is no line of a program.
pub const LINE_LIMIT_BYTES: usize = 1 << 20;

/// Where a line stands in the buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSpan {
    /// First byte.
    pub start: usize,
    /// Behind the last byte that is not its end.
    pub end: usize,
    /// Behind its end: `\n`, `\r\n`, `\r` or, in the last line, nothing.
    pub next: usize,
}

impl LineSpan {
    /// The line without its end.
    pub fn body(self, buffer: &[u8]) -> &[u8] {
        buffer.get(self.start..self.end).unwrap_or_default()
    }
}

/// Bytes that have come in and not yet gone out.
#[derive(Debug, Default)]
pub struct Lines {
    buffer: Vec<u8>,
    /// Bytes of the buffer that have gone out.
    done: usize,
    /// No more bytes will come.
    is_whole: bool,
    /// Lines given so far.
    n_lines: u64,
    /// How far the buffer was searched for the end of an unfinished line.
    searched: usize,
}

impl Lines {
    /// Takes more bytes; `is_last` where no more will come.
    pub fn push(&mut self, bytes: &[u8], is_last: bool) {
        self.buffer.drain(..self.done);
        self.searched -= self.done.min(self.searched);
        self.done = 0;
        self.buffer.extend_from_slice(bytes);
        self.is_whole |= is_last;
    }

    /// The bytes that spans refer to.
    pub fn buffer(&self) -> &[u8] {
        &self.buffer
    }

    /// Where the next line begins.
    pub fn next_start(&self) -> usize {
        self.done
    }

    /// Whether more bytes may come.
    pub fn is_open(&self) -> bool {
        !self.is_whole
    }

    /// Takes over that somebody else has read the next line, whose end stands at `end` and behind it `next`.
    #[inline]
    pub fn skip_line(&mut self, end: usize, next: usize) -> LineSpan {
        let start = std::mem::replace(&mut self.done, next);
        self.n_lines += 1;
        LineSpan { start, end, next }
    }

    /// The next line; None where it has not ended yet. Spans hold until the next push.
    ///
    /// # Errors
    /// [`GcodeError::LineTooLong`], [`GcodeError::NulByte`], [`GcodeError::Binary`].
    pub fn next_line(&mut self) -> Result<Option<LineSpan>, GcodeError> {
        let start = self.done;
        let from = start.max(self.searched);
        let found = memchr::memchr2(b'\n', b'\r', &self.buffer[from..]).map(|length| from + length);
        let line = self.n_lines + 1;
        let span = match found {
            Some(end) => {
                let ends_in_pair = self.buffer[end] == b'\r' && self.buffer.get(end + 1) == Some(&b'\n');
                if self.buffer[end] == b'\r' && end + 1 == self.buffer.len() && !self.is_whole {
                    self.searched = end;
                    return Ok(None);
                }
                Some(LineSpan { start, end, next: end + 1 + usize::from(ends_in_pair) })
            }
            None if self.is_whole && start < self.buffer.len() => {
                Some(LineSpan { start, end: self.buffer.len(), next: self.buffer.len() })
            }
            None => {
                self.searched = self.buffer.len();
                None
            }
        };
        let end = span.map_or(self.buffer.len(), |span| span.end);
        if line == 1 && self.buffer[start..end].starts_with(b"GCDE") {
            return Err(GcodeError::Binary);
        }
        if end - start > LINE_LIMIT_BYTES {
            return Err(GcodeError::LineTooLong { line, limit_bytes: LINE_LIMIT_BYTES });
        }
        if memchr::memchr(0, &self.buffer[start..end]).is_some() {
            return Err(GcodeError::NulByte { line });
        }
        if let Some(span) = span {
            self.done = span.next;
            self.n_lines += 1;
        }
        Ok(span)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(lines: &mut Lines, out: &mut Vec<(Vec<u8>, Vec<u8>)>) -> Result<(), GcodeError> {
        while let Some(span) = lines.next_line()? {
            out.push((span.body(lines.buffer()).to_vec(), lines.buffer()[span.end..span.next].to_vec()));
        }
        Ok(())
    }

    #[test]
    fn ends_are_kept() {
        let mut lines = Lines::default();
        lines.push(b"a\r\nb\nc\rd", true);
        let mut out = Vec::new();
        all(&mut lines, &mut out).unwrap();
        let ends: Vec<&[u8]> = out.iter().map(|(_, end)| end.as_slice()).collect();
        assert_eq!(ends, [b"\r\n".as_slice(), b"\n", b"\r", b""]);
    }

    #[test]
    fn what_is_no_text_is_refused_by_line() {
        let mut lines = Lines::default();
        lines.push(b"G1\nG1 \0X", true);
        let mut out = Vec::new();
        assert_eq!(all(&mut lines, &mut out), Err(GcodeError::NulByte { line: 2 }));
        let mut lines = Lines::default();
        lines.push(b"GCDE\x01\x02", true);
        assert_eq!(all(&mut lines, &mut out), Err(GcodeError::Binary));
        let mut lines = Lines::default();
        lines.push(b"G1\n", false);
        lines.push(&vec![b'X'; LINE_LIMIT_BYTES + 1], false);
        let endless = GcodeError::LineTooLong { line: 2, limit_bytes: LINE_LIMIT_BYTES };
        assert_eq!(all(&mut lines, &mut out), Err(endless));
    }

    proptest! {
        #[test]
        fn chunks_do_not_matter(
            bytes in "[ab\r\n]{0,40}",
            cuts in proptest::collection::vec(0_usize..40, 0..5),
        ) {
            let bytes = bytes.as_bytes();
            let mut whole = Vec::new();
            let mut lines = Lines::default();
            lines.push(bytes, true);
            all(&mut lines, &mut whole).unwrap();
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
            cuts.extend([0, bytes.len()]);
            cuts.sort_unstable();
            let mut pieces = Vec::new();
            let mut lines = Lines::default();
            for pair in cuts.windows(2) {
                lines.push(&bytes[pair[0]..pair[1]], false);
                all(&mut lines, &mut pieces).unwrap();
            }
            lines.push(b"", true);
            all(&mut lines, &mut pieces).unwrap();
            prop_assert_eq!(&whole, &pieces);
            let joined: Vec<u8> = whole.into_iter().flat_map(|(body, end)| [body, end].concat()).collect();
            prop_assert_eq!(joined, bytes);
        }
    }
}
