//! Lines as slicers and CAM systems write them by the million: one straight move, letters and numbers, nothing else.
//!
//! What is read here means the same to the [lexer](super::lexer), which reads everything; every doubt goes there.

use super::decimal::Decimal;
use super::eight::number;
use super::known::Known;
use super::lexer::Span;
use super::usual::UsualMove;
use super::words::MoveText;

/// More digits of a line's own number than this go to the lexer.
const MOST_DIGITS: usize = 15;

/// Bits of the letters of a line: of X, of Y and Z behind it, of E and of F.
const X: u8 = 1;
const EXTRUDER: u8 = 1 << 3;
const FEED: u8 = 1 << 4;

/// The bit of each byte that is such a letter; 0 of all others.
const LETTERS: [u8; 256] = {
    let mut bits = [0; 256];
    bits[b'X' as usize] = X;
    bits[b'Y' as usize] = X << 1;
    bits[b'Z' as usize] = X << 2;
    bits[b'E' as usize] = EXTRUDER;
    bits[b'F' as usize] = FEED;
    bits
};

/// A straight move on a line of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlainMove {
    /// Whether `G0` stands on the line; None where no code does.
    pub is_rapid: Option<bool>,
    /// X, Y, Z, in the program's unit.
    pub axes: Known,
    /// E.
    pub extruder: Option<Decimal>,
    /// F, in the program's unit.
    pub feed: Option<f64>,
    /// Where the words stand.
    pub text: MoveText,
    /// Length of the line without its end.
    pub length: usize,
    /// Length of the line with it.
    pub length_with_end: usize,
}

impl Default for PlainMove {
    fn default() -> Self {
        Self {
            is_rapid: None,
            axes: Known::NONE,
            extruder: None,
            feed: None,
            text: MoveText::default(),
            length: 0,
            length_with_end: 0,
        }
    }
}

impl PlainMove {
    /// Reads the line that `text` begins with; false where it is anything else, or does not end within `text`.
    ///
    /// Into memory that is there: a line is short beside what is read of it.
    #[inline]
    pub fn read(&mut self, text: &[u8]) -> bool {
        self.usual(text).or_else(|| self.words(text)).is_some()
    }

    /// A [usual move](UsualMove), which most are.
    #[inline]
    fn usual(&mut self, text: &[u8]) -> Option<()> {
        let usual = UsualMove::read(text)?;
        (self.length, self.length_with_end) = (usize::from(usual.length), usual.length_with_end());
        (self.is_rapid, self.feed) = (Some(false), None);
        (self.axes, self.extruder, self.text) = (usual.axes(), usual.extruder, usual.text());
        Some(())
    }

    /// What a line may leave as it is; a whole new move would be made elsewhere and copied.
    #[inline]
    fn forget(&mut self) {
        (self.is_rapid, self.extruder, self.feed) = (None, None, None);
        self.axes = Known::NONE;
        let text = &mut self.text;
        (text.axes, text.extruder, text.motion, text.behind_axes) = ([None; 3], None, None, 0);
    }

    #[inline]
    fn words(&mut self, text: &[u8]) -> Option<()> {
        self.forget();
        // Which of X, Y, Z, E, F there were, a bit each, and how long all words are without the blanks between them.
        let (mut seen, mut n_words, mut n_bytes) = (0_u8, 0_u32, 0);
        self.text.is_in_order = true;
        let (mut at, mut first) = (0, 0);
        if text.first() == Some(&b'N') {
            let digits = text[1..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            if !(1..=MOST_DIGITS).contains(&digits) {
                return None;
            }
            at = 1 + digits;
        }
        let last = loop {
            let behind = at;
            let mut byte = *text.get(at)?;
            while byte == b' ' {
                at += 1;
                byte = *text.get(at)?;
            }
            let start = at;
            let letter = LETTERS[usize::from(byte)];
            match byte {
                _ if letter != 0 => {
                    // What may not stand behind a number is met as no word.
                    let (number, end) = number(text, at + 1)?;
                    let span = Span { start: start as u32, end: end as u32 };
                    if seen & letter != 0 {
                        return None;
                    }
                    // E behind Z; F may stand anywhere.
                    self.text.is_in_order &= seen & !FEED < letter;
                    seen |= letter;
                    match letter {
                        EXTRUDER => (self.text.extruder, self.extruder) = (Some(span), Some(number)),
                        FEED => self.feed = Some(number.to_f64()),
                        _ => {
                            let axis = usize::from(byte - b'X');
                            self.text.behind_axes = span.end;
                            self.text.axes[axis] = Some(span);
                            self.axes.set(axis, Some(number.to_f64()));
                        }
                    }
                    at = end;
                }
                b'G' if n_words == 0 => {
                    at += 1 + usize::from(text.get(at + 1) == Some(&b'0') && is_digit(text.get(at + 2)));
                    self.is_rapid = match text.get(at) {
                        Some(b'0') => Some(true),
                        Some(b'1') => Some(false),
                        _ => return None,
                    };
                    at += 1;
                    if is_digit(text.get(at)) || text.get(at) == Some(&b'.') {
                        return None;
                    }
                    self.text.motion = Some(Span { start: start as u32, end: at as u32 });
                }
                b'\n' => {
                    self.length_with_end = at + 1;
                    break behind;
                }
                b'\r' if text.get(at + 1) == Some(&b'\n') => {
                    self.length_with_end = at + 2;
                    break behind;
                }
                _ => return None,
            }
            if n_words == 0 {
                first = start;
            }
            n_bytes += at - start;
            n_words += 1;
        };
        self.text.is_spaced = first + n_bytes < last || n_words < 2;
        self.length = at;
        // A line without words is none of the moves that are meant here.
        (n_words > 0).then_some(())
    }
}

#[inline]
fn is_digit(byte: Option<&u8>) -> bool {
    byte.is_some_and(u8::is_ascii_digit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gcode::lexer::{Head, Line};
    use crate::gcode::words::Words;
    use proptest::prelude::*;

    /// What the lexer makes of the first line of `text`, as a plain move.
    fn by_lexer(text: &str) -> PlainMove {
        let length = text.find(['\n', '\r']).unwrap();
        let body = &text.as_bytes()[..length];
        let mut line = Line::default();
        line.lex(body);
        assert!(line.head == Head::Words && line.unreadable.is_none() && !line.has_parameter, "{text:?}");
        let words = Words::of(&line);
        assert!(words.repeated.is_none() && words.odd.is_none() && words.parameter.is_none(), "{text:?}");
        let code = line.words.iter().find(|word| word.letter == b'G').map(|word| word.code10().unwrap());
        let number = |word: &crate::gcode::lexer::Word| word.number().unwrap();
        PlainMove {
            is_rapid: code.map(|code10| code10 == 0),
            axes: words.axes.map(|word| word.as_ref().map(|word| number(word).to_f64())).into(),
            extruder: words.extruder.as_ref().map(number),
            feed: words.feed.as_ref().map(|word| number(word).to_f64()),
            text: MoveText::of(&line, &words, body, false),
            length,
            length_with_end: length + if text[length..].starts_with("\r\n") { 2 } else { 1 },
        }
    }

    fn read_bytes(text: &[u8]) -> Option<PlainMove> {
        let mut plain = PlainMove::default();
        plain.read(text).then_some(plain)
    }

    fn read(text: &str) -> Option<PlainMove> {
        // A number near the end of the text is left to the lexer.
        read_bytes(format!("{text}M117 what follows\n").as_bytes())
    }

    #[test]
    fn moves_of_slicers_and_of_cam_systems_are_read() {
        for text in [
            "G1 X114.255 Y94.658 E2.00592\n",
            "G0 F9000 X-.5 Y1 Z0.300\r\n",
            "N120 G01X1.0Y-2.5F300\n",
            "X1.5 Y2. \n",
            "G1 E-.8 F2400\n",
            "G1 F1800\n",
            "G00\n",
            " G1  X1\n",
            "G1 Z1 X2 Y3\n",
        ] {
            assert_eq!(read(text), Some(by_lexer(text)), "{text:?}");
        }
    }

    #[test]
    fn everything_else_is_left_to_the_lexer() {
        for text in [
            "\n",
            "N5\n",
            "G2 X1 Y1 I1\n",
            "G1 X1 X2\n",
            "G1 X1 ; travel\n",
            "G1 X1 (travel)\n",
            "g1 x1\n",
            "G1 X 1\n",
            "G1 X+1\n",
            "G1 X\n",
            "G1 X-\n",
            "G1 X.\n",
            "G1 X1.2.3\n",
            "G1 X12345678\n",
            "G1 X1_\n",
            "G1 X1\r",
            "G1 X1\tY2\n",
            "G1.5 X1\n",
            "G10 X1\n",
            "G1 G90 X1\n",
            "X1 G1\n",
            "G1 X1*33\n",
            "G1 X1 A2\n",
            "%\n",
            "START X1\n",
        ] {
            assert_eq!(read(text), None, "{text:?}");
        }
    }

    #[test]
    fn a_line_that_has_not_ended_is_left_to_the_lexer() {
        assert_eq!(read_bytes(b"G1 X114.255 Y94.658 E2.00592"), None);
        assert_eq!(read_bytes(b""), None);
    }

    proptest! {
        #[test]
        fn what_is_read_is_what_the_lexer_reads(
            text in "(N[0-9]{1,4} ?)?(G0?[01])?( {0,2}[XYZEF]-?[0-9]{0,8}(\\.[0-9]{0,8})?){0,4} ?(\r?\n)",
        ) {
            if let Some(plain) = read(&text) {
                prop_assert_eq!(plain, by_lexer(&text));
            }
        }

        #[test]
        fn what_a_line_says_does_not_depend_on_the_one_before(
            before in "(G0?[01])?( {0,2}[XYZEF]-?[0-9]{0,8}(\\.[0-9]{0,8})?){0,4} ?(\r?\n)",
            text in "(G0?[01])?( {0,2}[XYZEF]-?[0-9]{0,8}(\\.[0-9]{0,8})?){0,4} ?(\r?\n)",
        ) {
            let mut plain = PlainMove::default();
            plain.read(format!("{before}M117 what follows\n").as_bytes());
            if plain.read(format!("{text}M117 what follows\n").as_bytes()) {
                prop_assert_eq!(Some(plain), read(&text));
            }
        }

        #[test]
        fn any_bytes_are_read_or_left(bytes in proptest::collection::vec(any::<u8>(), 0..60)) {
            if let Some(plain) = read_bytes(&bytes) {
                prop_assert!(plain.length < plain.length_with_end && plain.length_with_end <= bytes.len());
            }
        }
    }
}
