//! The words of one line that matter for the path, sorted by letter.

use super::known::Known;
use super::lexer::{Line, Span, Value, Word};
use super::unsupported::Unsupported;

/// The words of a line by what they are for.
#[derive(Debug, Default)]
pub struct Words {
    /// X, Y, Z.
    pub axes: [Option<Word>; 3],
    /// E.
    pub extruder: Option<Word>,
    /// F.
    pub feed: Option<Word>,
    /// Number of a tool length.
    pub h: Option<Word>,
    /// Which kind of offset `G10` sets.
    pub l: Option<Word>,
    /// Which coordinate system, tool or time.
    pub p: Option<Word>,
    /// A letter of D, H, L, P, Q, which belong to codes other than moves.
    pub parameter: Option<u8>,
    /// A letter of X, Y, Z, E that stands twice.
    pub repeated: Option<u8>,
    /// Letter of an axis that the model does not have.
    pub extra_axis: Option<u8>,
    /// I, J, K or R.
    pub has_arc_words: bool,
    /// R.
    pub has_rotation: bool,
    /// A letter that may not stand on a straight move.
    pub odd: Option<u8>,
}

impl Words {
    /// Sorts the words of `line`.
    pub fn of(line: &Line) -> Self {
        let mut sorted = Self::default();
        for word in &line.words {
            sorted.take(word);
        }
        sorted
    }

    fn take(&mut self, word: &Word) {
        if matches!(word.letter, b'D' | b'H' | b'L' | b'P' | b'Q') {
            self.parameter = self.parameter.or(Some(word.letter));
        }
        let slot = match word.letter {
            b'X' => &mut self.axes[0],
            b'Y' => &mut self.axes[1],
            b'Z' => &mut self.axes[2],
            b'E' => &mut self.extruder,
            b'H' => &mut self.h,
            b'L' => &mut self.l,
            b'P' => &mut self.p,
            b'A' | b'B' | b'C' | b'U' | b'V' | b'W' => {
                self.extra_axis = self.extra_axis.or(Some(word.letter));
                return;
            }
            b'I' | b'J' | b'K' | b'R' => {
                self.has_arc_words = true;
                self.has_rotation |= word.letter == b'R';
                self.odd = self.odd.or(Some(word.letter));
                return;
            }
            b'F' => {
                self.feed = Some(*word);
                return;
            }
            b'G' | b'M' | b'S' | b'T' | b'D' | b'Q' => return,
            _ => {
                self.odd = self.odd.or(Some(word.letter));
                return;
            }
        };
        if slot.is_some() {
            self.repeated = Some(word.letter);
        }
        *slot = Some(*word);
    }

    /// Whether X, Y or Z is among them.
    pub fn has_axes(&self) -> bool {
        self.axes.iter().any(Option::is_some)
    }

    /// Whether an axis or the extruder is among them.
    pub fn has_motion(&self) -> bool {
        self.has_axes() || self.extra_axis.is_some() || self.extruder.is_some()
    }

    /// X, Y and Z in mm; the reason where one of them, or E, is no plain number.
    pub fn axes_mm(&self, unit_mm: f64) -> Result<Known, Unsupported> {
        if let Some(letter) = self.repeated {
            return Err(Unsupported::RepeatedWord { letter });
        }
        let mut numbers = [None; 3];
        for (number, word) in numbers.iter_mut().zip(&self.axes) {
            *number = plain(word.as_ref())?.map(|value| value * unit_mm);
        }
        plain(self.extruder.as_ref())?;
        Ok(numbers.into())
    }

    /// Whether one of X, Y, Z, E is a placeholder.
    pub fn has_placeholder(&self) -> bool {
        let mut words = self.axes.iter().chain([&self.extruder]).flatten();
        words.any(|word| word.value == Value::Placeholder)
    }
}

fn plain(word: Option<&Word>) -> Result<Option<f64>, Unsupported> {
    let Some(word) = word else { return Ok(None) };
    match word.value {
        Value::Number(number) => Ok(Some(number.to_f64())),
        Value::Missing => Err(Unsupported::MissingNumber { letter: word.letter }),
        Value::OwnMode => Err(Unsupported::OwnMode { letter: word.letter }),
        Value::Expression | Value::Placeholder | Value::Name(_) => Err(Unsupported::Expression),
    }
}

/// Where the words of a move stand in its line, for rewriting it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MoveText {
    /// X, Y, Z.
    pub axes: [Option<Span>; 3],
    /// E.
    pub extruder: Option<Span>,
    /// `G0` or `G1`.
    pub motion: Option<Span>,
    /// `G53`.
    pub machine: Option<Span>,
    /// Behind the last of X, Y, Z.
    pub behind_axes: u32,
    /// Whether X, Y, Z and E stand in this order.
    pub is_in_order: bool,
    /// Whether blanks stand between words.
    pub is_spaced: bool,
    /// Whether letters are lower case.
    pub is_lower: bool,
    /// Whether the line says something that is, or may be, [meant for the end](said_for_the_end) of the move.
    pub stops: bool,
}

impl MoveText {
    /// Of a line that has been sorted into `words`.
    ///
    /// In a rapid nothing is cut: spindle and coolant may go off before its end.
    pub fn of(line: &Line, words: &Words, body: &[u8], is_rapid: bool) -> Self {
        let code = |wanted: &[u32]| {
            let mut codes = line.words.iter().filter(|word| word.letter == b'G');
            codes
                .find(|word| word.code10().is_some_and(|code10| wanted.contains(&code10)))
                .map(|word| word.span)
        };
        let axes = words.axes.map(|word| word.map(|word| word.span));
        let letter = axes.iter().flatten().next().and_then(|span| span.of(body).first().copied());
        let begins = words.axes.iter().chain([&words.extruder]).flatten().map(|word| word.span.start);
        Self {
            axes,
            extruder: words.extruder.map(|word| word.span),
            motion: code(&[0, 10]),
            machine: code(&[530]),
            is_in_order: begins.is_sorted(),
            behind_axes: axes.iter().flatten().map(|span| span.end).max().unwrap_or(0),
            is_spaced: line.words.len() < 2
                || line.words.windows(2).any(|pair| pair[0].span.end < pair[1].span.start),
            is_lower: letter.is_some_and(|letter| letter.is_ascii_lowercase()),
            stops: line.words.iter().any(|word| is_for_the_end(word) && !(is_rapid && is_off(word))),
        }
    }
}

/// The code of a move's line that is, or may be, meant for the end of the move: a stop, an exact stop, a spindle that is
/// switched off (Fanuc's controls do so behind the move, LinuxCNC before it). The letter, and ten times the number;
/// `u32::MAX` where it is none.
pub fn said_for_the_end(body: &[u8]) -> Option<(u8, u32)> {
    let mut line = Line::default();
    line.lex(body);
    let word = line.words.iter().find(|word| is_for_the_end(word))?;
    Some((word.letter, word.code10().unwrap_or(u32::MAX)))
}

/// Spindle or coolant off.
fn is_off(word: &Word) -> bool {
    word.letter == b'M' && matches!(word.code10(), Some(50 | 90))
}

fn is_for_the_end(word: &Word) -> bool {
    match word.letter {
        // Spindle and coolant on, and how E is read: these hold from the begin.
        b'M' => !matches!(word.code10(), Some(30 | 40 | 70 | 80 | 130 | 140 | 820 | 830)),
        b'G' => word.code10() == Some(90),
        _ => false,
    }
}
