//! Lines as slicers and CAM systems write them by the million: one straight move, letters and numbers, nothing else.
//!
//! What is read here means the same to the [lexer](super::lexer), which reads everything; every doubt goes there.

use super::decimal::{Decimal, POWERS};
use super::lexer::Span;
use super::words::MoveText;

/// More digits of a line's own number than this go to the lexer.
const MOST_DIGITS: usize = 15;

/// A straight move on a line of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlainMove {
    /// Whether `G0` stands on the line; None where no code does.
    pub is_rapid: Option<bool>,
    /// X, Y, Z.
    pub axes: [Option<Decimal>; 3],
    /// E.
    pub extruder: Option<Decimal>,
    /// F.
    pub feed: Option<Decimal>,
    /// Where the words stand.
    pub text: MoveText,
    /// Length of the line without its end.
    pub length: usize,
    /// Length of the line with it.
    pub length_with_end: usize,
}

impl PlainMove {
    /// Reads the line that `text` begins with; None where it is anything else, or does not end within `text`.
    #[inline]
    pub fn read(text: &[u8]) -> Option<Self> {
        let mut plain = Self {
            is_rapid: None,
            axes: [None; 3],
            extruder: None,
            feed: None,
            text: MoveText {
                axes: [None; 3],
                extruder: None,
                motion: None,
                machine: None,
                behind_axes: 0,
                is_spaced: false,
                is_lower: false,
            },
            length: 0,
            length_with_end: 0,
        };
        let mut n_words = 0_u32;
        // Behind the word before.
        let mut behind = 0;
        let mut at = 0;
        if text.first() == Some(&b'N') {
            let digits = text[1..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            if !(1..=MOST_DIGITS).contains(&digits) {
                return None;
            }
            at = 1 + digits;
        }
        loop {
            let mut byte = *text.get(at)?;
            while byte == b' ' {
                at += 1;
                byte = *text.get(at)?;
            }
            let start = at;
            match byte {
                b'X' | b'Y' | b'Z' => {
                    let axis = usize::from(byte - b'X');
                    let (number, end) = number(text, at + 1)?;
                    if plain.axes[axis].replace(number).is_some() {
                        return None;
                    }
                    let span = Span { start: start as u32, end: end as u32 };
                    plain.text.axes[axis] = Some(span);
                    plain.text.behind_axes = span.end;
                    at = end;
                }
                b'E' => {
                    let (number, end) = number(text, at + 1)?;
                    if plain.extruder.replace(number).is_some() {
                        return None;
                    }
                    plain.text.extruder = Some(Span { start: start as u32, end: end as u32 });
                    at = end;
                }
                b'F' => {
                    let (number, end) = number(text, at + 1)?;
                    if plain.feed.replace(number).is_some() {
                        return None;
                    }
                    at = end;
                }
                b'G' if n_words == 0 => {
                    at += 1 + usize::from(text.get(at + 1) == Some(&b'0') && is_digit(text.get(at + 2)));
                    plain.is_rapid = match text.get(at) {
                        Some(b'0') => Some(true),
                        Some(b'1') => Some(false),
                        _ => return None,
                    };
                    at += 1;
                    if is_digit(text.get(at)) || text.get(at) == Some(&b'.') {
                        return None;
                    }
                    plain.text.motion = Some(Span { start: start as u32, end: at as u32 });
                }
                b'\n' => {
                    plain.length_with_end = at + 1;
                    break;
                }
                b'\r' if text.get(at + 1) == Some(&b'\n') => {
                    plain.length_with_end = at + 2;
                    break;
                }
                _ => return None,
            }
            plain.text.is_spaced |= n_words > 0 && behind < start;
            n_words += 1;
            behind = at;
        }
        plain.text.is_spaced |= n_words < 2;
        plain.length = at;
        // A line without words is none of the moves that are meant here.
        (n_words > 0).then_some(plain)
    }
}

#[inline]
fn is_digit(byte: Option<&u8>) -> bool {
    byte.is_some_and(u8::is_ascii_digit)
}

/// The number at `start`, and the place behind it.
#[inline]
fn number(text: &[u8], start: usize) -> Option<(Decimal, usize)> {
    let is_negative = text.get(start) == Some(&b'-');
    let first = start + usize::from(is_negative);
    let (head, n_head) = digits(text, first)?;
    let (mut mantissa, mut at, mut n_tail) = (head, first + n_head, 0);
    if text.get(at) == Some(&b'.') {
        let (tail, n_digits) = digits(text, at + 1)?;
        mantissa = head * POWERS[n_digits] + tail;
        at += 1 + n_digits;
        n_tail = n_digits;
    }
    // A second point, an underscore, a letter that is no word: the lexer knows.
    let goes_on = !matches!(text.get(at), Some(b' ' | b'\n' | b'\r' | b'X'..=b'Z' | b'E' | b'F'));
    if goes_on || n_head + n_tail == 0 {
        return None;
    }
    let mantissa = if is_negative { -mantissa } else { mantissa };
    Some((Decimal { mantissa, digits: n_tail as u8, is_cut: false }, at))
}

/// At most seven digits at `start`, and how many there are; None where there are more, or the text is too near its end.
///
/// All eight bytes at once: a loop over digits would be guessed wrong at the end of most numbers.
#[inline]
fn digits(text: &[u8], start: usize) -> Option<(i64, usize)> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let bytes = u64::from_le_bytes(*text.get(start..)?.first_chunk()?);
    // Digits are 0 to 9 now; of the bytes from the first other one on, only that it is one counts.
    let values = bytes ^ (ONES * u64::from(b'0'));
    let others = (values.wrapping_add(ONES * (0x80 - 10)) | values) & (ONES * 0x80);
    if others == 0 {
        return None;
    }
    let n_digits = (others.trailing_zeros() / 8) as usize;
    if n_digits == 0 {
        return Some((0, 0));
    }
    // The digits at the end, zeros before them; then pairs, fours and all eight.
    let eight = values << (64 - 8 * n_digits);
    let pairs = (eight.wrapping_mul(10).wrapping_add(eight >> 8)) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs.wrapping_mul(100).wrapping_add(pairs >> 16)) & 0x0000_ffff_0000_ffff;
    let number = (fours.wrapping_mul(10_000).wrapping_add(fours >> 32)) & 0xffff_ffff;
    Some((number as i64, n_digits))
}
