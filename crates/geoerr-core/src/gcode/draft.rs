//! Lines that are being written: bytes in one place, copied in pieces of a fixed length where they are short.

use super::decimal::{FIXED_BYTES, SHORT_BYTES, fixed, short_fixed};

/// Bytes that are copied at once, wanted or not: a copy whose length is known costs no call.
const AT_ONCE: usize = 16;

/// New numbers of a line.
const NUMBERS: usize = 4;

/// Lines of one block. Kept and filled again, so that its memory is.
#[derive(Debug, Default)]
pub struct Draft {
    /// What has been written, and room behind it.
    bytes: Vec<u8>,
    length: usize,
}

impl Draft {
    /// Begins anew.
    #[inline]
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Makes room for one more line, whatever its numbers become: one that came with so many bytes.
    #[inline]
    pub fn make_room(&mut self, n_bytes: usize) {
        // Numbers with letters and blanks, and what is copied beyond.
        let wanted = self.length + n_bytes + NUMBERS * (FIXED_BYTES + 2) + AT_ONCE;
        if wanted > self.bytes.len() {
            self.bytes.resize(2 * wanted, 0);
        }
    }

    /// What has been written.
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        debug_assert!(self.length <= self.bytes.len(), "no room was made");
        self.bytes.get(..self.length).unwrap_or_default()
    }

    /// Appends `text[from..to]`; the bytes behind may be read too.
    #[inline(always)]
    pub fn copy(&mut self, text: &[u8], from: usize, to: usize) {
        let n_bytes = to.saturating_sub(from);
        if n_bytes <= AT_ONCE
            && let Some(source) = text.get(from..from + AT_ONCE)
            && let Some(target) = self.bytes.get_mut(self.length..self.length + AT_ONCE)
        {
            target.copy_from_slice(source);
        } else if let Some(source) = text.get(from..to)
            && let Some(target) = self.bytes.get_mut(self.length..self.length + n_bytes)
        {
            target.copy_from_slice(source);
        }
        self.length += n_bytes;
    }

    /// Appends one byte.
    #[inline(always)]
    pub fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
        }
        self.length += 1;
    }

    /// Appends `scaled / 10^digits`.
    #[inline(always)]
    pub fn number(&mut self, scaled: i64, digits: u8) {
        if let Some(place) = self.bytes.get_mut(self.length..self.length + SHORT_BYTES)
            && let Ok(place) = place.try_into()
            && let Some(n_bytes) = short_fixed(place, scaled, digits)
        {
            self.length += n_bytes;
        } else {
            self.long_number(scaled, digits);
        }
    }

    #[cold]
    fn long_number(&mut self, scaled: i64, digits: u8) {
        let (buffer, begin) = fixed(scaled, digits);
        for &byte in &buffer[begin..] {
            self.push(byte);
        }
    }

    /// How much has been written.
    #[inline]
    pub fn length(&self) -> usize {
        self.length
    }

    /// Puts a line between what has been written, before byte `at`.
    #[cold]
    pub fn insert(&mut self, at: usize, line: &[u8]) {
        self.make_room(line.len());
        self.bytes.copy_within(at..self.length, at + line.len());
        self.bytes[at..at + line.len()].copy_from_slice(line);
        self.length += line.len();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_draft_is_what_appending_gives(
            text in "[ -~]{0,60}",
            cuts in proptest::collection::vec(0_usize..60, 0..4),
            scaled in any::<i64>(),
            digits in 0_u8..=9,
        ) {
            let bytes = text.as_bytes();
            let mut draft = Draft::default();
            let mut expected = Vec::new();
            let mut at = 0;
            let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
            cuts.sort_unstable();
            draft.make_room(bytes.len());
            for cut in cuts {
                draft.copy(bytes, at, cut);
                draft.number(scaled, digits);
                expected.extend_from_slice(&bytes[at..cut]);
                let (number, begin) = fixed(scaled, digits);
                expected.extend_from_slice(&number[begin..]);
                at = cut;
            }
            draft.push(b' ');
            expected.push(b' ');
            prop_assert_eq!(draft.bytes(), expected.as_slice());
            let middle = expected.len() / 2;
            draft.insert(middle, bytes);
            expected.splice(middle..middle, bytes.iter().copied());
            prop_assert_eq!(draft.bytes(), expected.as_slice());
            draft.clear();
            prop_assert!(draft.bytes().is_empty());
        }
    }
}
