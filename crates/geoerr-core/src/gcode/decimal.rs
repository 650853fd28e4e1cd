//! Numbers as programs write them: exact decimals in, fixed decimals out.

/// Digits that a mantissa keeps; further ones are below the resolution of an `f64` and are dropped.
const MAX_DIGITS: u32 = 18;

/// A decimal number, `mantissa / 10^digits`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decimal {
    /// The number without its point.
    pub mantissa: i64,
    /// Digits behind the point.
    pub digits: u8,
    /// Whether digits that the mantissa cannot hold were left out.
    pub is_cut: bool,
}

impl Decimal {
    /// Reads the number that `text` begins with; gives it and its length in bytes.
    ///
    /// Sign, digits, point, digits; no exponent (`1E2` is the word 1 and the word E2). None where there is no
    /// digit or more than 18 before the point.
    pub fn parse(text: &[u8]) -> Option<(Self, usize)> {
        let negative = text.first() == Some(&b'-');
        let mut at = usize::from(negative || text.first() == Some(&b'+'));
        let mut mantissa: i64 = 0;
        let mut kept = 0;
        let mut digits: u8 = 0;
        let mut seen_digit = false;
        let mut behind_point = false;
        let mut is_cut = false;
        while let Some(&byte) = text.get(at) {
            match byte {
                b'0'..=b'9' => {
                    seen_digit = true;
                    if kept < MAX_DIGITS && digits < 18 {
                        mantissa = mantissa * 10 + i64::from(byte - b'0');
                        kept += u32::from(mantissa != 0);
                        digits += u8::from(behind_point);
                    } else if behind_point {
                        is_cut |= byte != b'0';
                    } else {
                        return None;
                    }
                }
                b'.' if !behind_point => behind_point = true,
                _ => break,
            }
            at += 1;
        }
        if !seen_digit {
            return None;
        }
        let mantissa = if negative { -mantissa } else { mantissa };
        Some((Self { mantissa, digits, is_cut }, at))
    }

    /// The nearest `f64` (exact to half a unit in the last place below 2^53, to one beyond).
    #[inline(always)]
    pub fn to_f64(self) -> f64 {
        // 10^18 is exact in an f64: one rounding in the division.
        self.mantissa as f64 / POWERS_F64[usize::from(self.digits)]
    }

    /// The number in units of `10^-digits`; None where it has more digits or does not fit.
    pub fn scaled(self, digits: u8) -> Option<i64> {
        let shift = digits.checked_sub(self.digits)?;
        self.mantissa.checked_mul(*POWERS.get(usize::from(shift))?)
    }

    /// The number in units of `10^-18`: sums of such numbers are exact.
    #[inline]
    pub fn exact(self) -> i128 {
        i128::from(self.mantissa) * i128::from(POWERS[usize::from(18 - self.digits.min(18))])
    }
}

/// `10^0 .. 10^18`.
pub const POWERS: [i64; 19] = {
    let mut powers = [1; 19];
    let mut i = 1;
    while i < powers.len() {
        powers[i] = powers[i - 1] * 10;
        i += 1;
    }
    powers
};

/// `10^0 .. 10^18`, all exact.
pub const POWERS_F64: [f64; 19] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18];

/// Most bytes of a written number.
pub const FIXED_BYTES: usize = 24;

/// `scaled / 10^digits` with exactly `digits` digits behind the point, at the end of the bytes; and where it begins.
pub fn fixed(scaled: i64, digits: u8) -> ([u8; FIXED_BYTES], usize) {
    let mut buffer = [b'0'; FIXED_BYTES];
    let mut at = FIXED_BYTES;
    let mut rest = scaled.unsigned_abs();
    let mut put = |byte: u8| {
        at -= 1;
        buffer[at] = byte;
    };
    // Least significant digit first.
    for _ in 0..digits.min(18) {
        put(b'0' + (rest % 10) as u8);
        rest /= 10;
    }
    if digits > 0 {
        put(b'.');
    }
    loop {
        put(b'0' + (rest % 10) as u8);
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    if scaled < 0 {
        put(b'-');
    }
    (buffer, at)
}

/// Eight digits as they are written, of two numbers below 10,000: the first one's in the lower half.
#[inline(always)]
fn twice_four_digits(first: u32, second: u32) -> u64 {
    // Divisions by multiplication, exact for numbers of that size: by 100, and then all halves by 10.
    let both = u64::from(first) | u64::from(second) << 32;
    let hundreds = ((both * 5_243) >> 19) & 0x0000_007f_0000_007f;
    let halves = hundreds | ((both - 100 * hundreds) << 16);
    let tens = ((halves * 103) >> 10) & 0x000f_000f_000f_000f;
    (tens | ((halves - 10 * tens) << 8)) + u64::from_le_bytes(*b"00000000")
}

/// Room for what [`short_fixed`] writes.
pub const SHORT_BYTES: usize = 16;

/// Writes what [`fixed`] gives of numbers of usual size with usual digits; how many bytes it has. Those behind
/// may be anything then.
#[inline(always)]
pub fn short_fixed(place: &mut [u8; SHORT_BYTES], scaled: i64, digits: u8) -> Option<usize> {
    let size = u32::try_from(scaled.unsigned_abs()).ok()?;
    // Divisors that the compiler knows. Of five digits the last stands alone.
    let (whole, fraction, last) = match digits {
        3 => (size / 1_000, size % 1_000 * 10, 0),
        4 => (size / 10_000, size % 10_000, 0),
        5 => (size / 100_000, size / 10 % 10_000, size % 10),
        _ => return None,
    };
    if whole >= 10_000 {
        return None;
    }
    let written = twice_four_digits(whole, fraction);
    let padded = written as u32;
    // The last zero stays.
    let last_digit = 1 << 24;
    let n_zeros = ((padded ^ u32::from_le_bytes(*b"0000")) | last_digit).trailing_zeros() / 8;
    let n_sign = usize::from(scaled < 0);
    let n_whole = 4 - n_zeros as usize;
    let behind = u64::from(b'.') | (written >> 32 << 8) | u64::from(u32::from(b'0') + last) << 40;
    place[0] = b'-';
    place[n_sign..n_sign + 4].copy_from_slice(&(padded >> (8 * n_zeros)).to_le_bytes());
    let point = n_sign + n_whole;
    place[point..point + 8].copy_from_slice(&behind.to_le_bytes());
    Some(point + 1 + usize::from(digits))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(scaled: i64, digits: u8) -> String {
        let (buffer, begin) = fixed(scaled, digits);
        String::from_utf8(buffer[begin..].to_vec()).unwrap()
    }

    #[test]
    fn reads_what_programs_write() {
        let read = |text: &str| Decimal::parse(text.as_bytes()).map(|(d, n)| (d.mantissa, d.digits, n));
        assert_eq!(read("156.387 Y"), Some((156_387, 3, 7)));
        assert_eq!(read("-.1f24"), Some((-1, 1, 3)));
        assert_eq!(read("+5.x"), Some((5, 0, 3)));
        assert_eq!(read("1E5"), Some((1, 0, 1)));
        assert_eq!(read("1.2.3"), Some((12, 1, 3)));
        assert_eq!(read("00012.50"), Some((1250, 2, 8)));
        for nothing in ["", "-", ".", "-.", "x", "{machine_depth}", "--1", "1234567890123456789"] {
            assert_eq!(read(nothing), None, "{nothing}");
        }
    }

    #[test]
    fn digits_beyond_the_mantissa_are_cut_and_say_so() {
        let (long, length) = Decimal::parse(b"10.12345678901234567890").unwrap();
        assert_eq!(length, 23);
        assert!(long.is_cut);
        assert_eq!(long.to_f64(), 10.123_456_789_012_346);
        let (zeros, _) = Decimal::parse(b"1.00000000000000000000000").unwrap();
        assert!(!zeros.is_cut);
        assert_eq!(zeros.to_f64(), 1.0);
    }

    #[test]
    fn four_digits_are_those_of_the_number() {
        for number in 0..10_000 {
            let other = 9_999 - number;
            let written = twice_four_digits(number, other).to_le_bytes();
            assert_eq!(written, format!("{number:04}{other:04}").as_bytes());
        }
    }

    #[test]
    fn writes_fixed_digits() {
        assert_eq!(written(1_000_500, 4), "100.0500");
        assert_eq!(written(-5, 4), "-0.0005");
        assert_eq!(written(0, 4), "0.0000");
        assert_eq!(written(-42, 0), "-42");
        assert_eq!(written(i64::MIN, 9), "-9223372036.854775808");
    }

    proptest! {
        #[test]
        fn short_numbers_are_written_as_long_ones(scaled in -200_000_000_i64..200_000_000, digits in 0_u8..=9) {
            let (long, begin) = fixed(scaled, digits);
            let mut short = [0; SHORT_BYTES];
            if let Some(n_bytes) = short_fixed(&mut short, scaled, digits) {
                prop_assert_eq!(&short[..n_bytes], &long[begin..]);
            }
        }

        #[test]
        fn reading_is_std_parsing(text in "-?[0-9]{1,9}(\\.[0-9]{0,6})?") {
            let (decimal, length) = Decimal::parse(text.as_bytes()).unwrap();
            prop_assert_eq!(length, text.len());
            prop_assert_eq!(decimal.to_f64(), text.parse::<f64>().unwrap());
        }

        #[test]
        fn written_numbers_read_back(scaled in -1_000_000_000_000_000_i64..1_000_000_000_000_000, digits in 0_u8..=9) {
            let text = written(scaled, digits);
            let (decimal, length) = Decimal::parse(text.as_bytes()).unwrap();
            prop_assert_eq!(length, text.len());
            prop_assert_eq!(decimal.scaled(digits), Some(scaled));
        }

        #[test]
        fn any_bytes_are_read_or_refused(text in proptest::collection::vec(any::<u8>(), 0..40)) {
            if let Some((decimal, length)) = Decimal::parse(&text) {
                prop_assert!(length <= text.len());
                prop_assert!(decimal.to_f64().is_finite());
            }
        }
    }
}
