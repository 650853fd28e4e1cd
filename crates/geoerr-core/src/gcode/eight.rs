//! Numbers of plain lines, eight bytes of a program at once.

use super::decimal::{Decimal, POWERS};

/// The number at `start`, and the place behind it: whatever stands there.
#[inline(always)]
pub fn number(text: &[u8], start: usize) -> Option<(Decimal, usize)> {
    let is_negative = text.get(start) == Some(&b'-');
    let first = start + usize::from(is_negative);
    let eight = Eight::at(text, first)?;
    let (mantissa, n_digits, n_bytes) = match eight.number() {
        Some(number) => number,
        None => long_number(text, first, &eight)?,
    };
    let mantissa = if is_negative { -mantissa } else { mantissa };
    Some((Decimal { mantissa, digits: n_digits as u8, is_cut: false }, first + n_bytes))
}

/// A number at `start` that is longer than eight bytes, of up to seven digits before the point and seven behind: its
/// digits, how many of them stand behind the point, its length.
#[inline(never)]
fn long_number(text: &[u8], start: usize, eight: &Eight) -> Option<(i64, usize, usize)> {
    let n_head = eight.n_digits()?;
    if text.get(start + n_head) != Some(&b'.') {
        return None;
    }
    let tail = Eight::at(text, start + n_head + 1)?;
    let n_tail = tail.n_digits()?;
    let mantissa = eight.value(n_head) * POWERS[n_tail] + tail.value(n_tail);
    (n_head + n_tail > 0).then_some((mantissa, n_tail, n_head + 1 + n_tail))
}

/// Eight bytes of a program, looked at all at once: a loop over digits would be guessed wrong at the end of most numbers.
struct Eight {
    /// Digits are 0 to 9, a point is [`POINT`].
    values: u64,
    /// A bit for each byte that is no digit, right up to the first that is neither digit nor point.
    others: u64,
}

const ONES: u64 = 0x0101_0101_0101_0101;

/// A point among digits.
const POINT: u64 = (b'.' ^ b'0') as u64;

impl Eight {
    /// Those at `start`; None where the text is too near its end.
    #[inline(always)]
    fn at(text: &[u8], start: usize) -> Option<Self> {
        let bytes = u64::from_le_bytes(*text.get(start..)?.first_chunk()?);
        let values = bytes ^ (ONES * u64::from(b'0'));
        // Points carry nothing into the next byte.
        let others = (values.wrapping_add(ONES * (0x80 - 10)) | values) & (ONES * 0x80);
        Some(Self { values, others })
    }

    /// The number that they begin with: its digits, how many of them stand behind the point, its length; None where it
    /// does not end in them or has no digit.
    #[inline(always)]
    fn number(&self) -> Option<(i64, usize, usize)> {
        let n_head = self.n_digits()?;
        if self.values >> (8 * n_head) & 0xff != POINT {
            return (n_head > 0).then(|| (joined(self.values, n_head), 0, n_head));
        }
        let behind_point = self.others & (self.others - 1);
        if behind_point == 0 {
            return None;
        }
        let n_bytes = (behind_point.trailing_zeros() / 8) as usize;
        let n_digits = n_bytes - 1;
        let head = self.values & ((1 << (8 * n_head)) - 1);
        // Without the point between them. A point that is the last byte has nothing behind it.
        let tail = self.values >> (8 * n_head) >> 8 << (8 * n_head);
        (n_digits > 0).then(|| (joined(head | tail, n_digits), n_digits - n_head, n_bytes))
    }

    /// How many digits they begin with; None for eight.
    #[inline(always)]
    fn n_digits(&self) -> Option<usize> {
        (self.others != 0).then_some((self.others.trailing_zeros() / 8) as usize)
    }

    /// The first digits as a number.
    #[inline(always)]
    fn value(&self, n_digits: usize) -> i64 {
        if n_digits == 0 { 0 } else { joined(self.values, n_digits) }
    }
}

/// The first bytes, one to eight digits, as a number.
#[inline(always)]
fn joined(values: u64, n_digits: usize) -> i64 {
    // The digits at the end, zeros before them; then pairs, fours and all eight.
    let eight = values << (64 - 8 * n_digits);
    let pairs = (eight.wrapping_mul(10).wrapping_add(eight >> 8)) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs.wrapping_mul(100).wrapping_add(pairs >> 16)) & 0x0000_ffff_0000_ffff;
    let number = (fours.wrapping_mul(10_000).wrapping_add(fours >> 32)) & 0xffff_ffff;
    number as i64
}
