//! One line of a program into words: letters with numbers, comments aside.

use super::decimal::Decimal;

/// Bytes `start..end` of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// Behind the last byte.
    pub end: u32,
}

impl Span {
    fn new(start: usize, end: usize) -> Self {
        // Lines are at most a megabyte long: `lines::LINE_LIMIT_BYTES`.
        Self { start: start as u32, end: end as u32 }
    }

    /// The bytes of `line` that are meant.
    #[inline]
    pub fn of(self, line: &[u8]) -> &[u8] {
        line.get(self.start as usize..self.end as usize).unwrap_or_default()
    }
}

/// What stands behind a letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// A number.
    Number(Decimal),
    /// Nothing, as in `G28 X`.
    Missing,
    /// Something that a controller computes: `[#1*2]`, `#5`, `{move.axes[0].max}`.
    Expression,
    /// A slicer's placeholder that was never filled in, `{machine_depth}`: no controller knows its value.
    Placeholder,
    /// `X=AC(5)`, `X=IC(5)`: whether it is a position or an increment it says itself.
    OwnMode,
    /// A name between quotes, `T="MILL 10"`, as a number of its own.
    Name(u64),
}

/// A letter and what stands behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// The letter, upper case.
    pub letter: u8,
    /// Its value.
    pub value: Value,
    /// Where it stands, letter and value.
    pub span: Span,
}

impl Word {
    /// The number behind the letter.
    pub fn number(&self) -> Option<Decimal> {
        match self.value {
            Value::Number(number) => Some(number),
            _ => None,
        }
    }

    /// The tool that a T means, by its number or its name.
    pub fn tool(&self) -> Option<u64> {
        match self.value {
            Value::Name(name) => Some(name),
            _ => self.number().map(|number| number.to_f64() as u64),
        }
    }

    /// Ten times the number, for codes such as 92.1; None where there are further digits.
    pub fn code10(&self) -> Option<u32> {
        let number = self.number()?;
        // Trailing zeros say nothing: G1.00 is G1.
        let tenfold = number.to_f64() * 10.0;
        let rounded = tenfold.round();
        ((tenfold - rounded).abs() < 1e-9 && (0.0..1e6).contains(&rounded)).then_some(rounded as u32)
    }
}

/// How a line begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Head {
    /// Nothing but blanks and comments.
    #[default]
    Empty,
    /// `%`: begin or end of a tape.
    Percent,
    /// A word of several letters, such as `START_PRINT`: its name.
    Macro(Span),
    /// `#CS ON`, an instruction of the controls of Beckhoff (ISG) and Fagor: its name. Everywhere else a comment.
    Instruction(Span),
    /// An `O` word: subprograms, loops, branches.
    Subprogram,
    /// Letters with numbers.
    Words,
}

const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// One line, taken apart. Kept and filled again, so that a line costs no allocation.
#[derive(Debug, Default)]
pub struct Line {
    /// How it begins.
    pub head: Head,
    /// Its words, without the line number.
    pub words: Vec<Word>,
    /// Whether it begins with `/`, or has it behind its number.
    pub is_block_skip: bool,
    /// Whether it ends with a checksum, `*71`.
    pub has_checksum: bool,
    /// Whether that is a `*` alone, which ends the blocks of Heidenhain's ISO.
    pub has_bare_star: bool,
    /// Whether it names a parameter outside a word's value: `#1=2`.
    pub has_parameter: bool,
    /// Byte from which nothing could be read.
    pub unreadable: Option<u32>,
    /// Byte of the first `G` or `M` with a number behind the name that it begins with.
    pub code_behind_name: Option<u32>,
    /// Byte of the first `=` between a letter and its number, `X=150`, as Siemens' controls have it.
    pub assigned: Option<u32>,
    /// Whether it has a comment that begins with `;`.
    pub has_semicolon: bool,
    /// Whether it has a comment in parentheses.
    pub has_parenthesis: bool,
    /// Whether it begins with an M code behind which printers read text, and machine tools words.
    pub is_text_on_printers: bool,
}

impl Line {
    /// Takes `body`, a line without its end, apart.
    pub fn lex(&mut self, body: &[u8]) {
        self.words.clear();
        let words = std::mem::take(&mut self.words);
        *self = Self { words, ..Self::default() };
        // The mark that an editor puts before the first line is no part of it.
        let begin = if body.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
        // Before the line number, or behind it.
        let mut at = self.block_skip(body, blanks(body, begin));
        if let Some(behind) = line_number(body, at) {
            at = self.block_skip(body, blanks(body, behind));
        }
        if body.get(at) == Some(&b'%') {
            self.head = Head::Percent;
            return;
        }
        self.words(body, at);
    }

    /// Place behind a `/`, or behind one of several switches, `/1` to `/9`, that stands at `at`.
    fn block_skip(&mut self, body: &[u8], at: usize) -> usize {
        if body.get(at) != Some(&b'/') {
            return at;
        }
        self.is_block_skip = true;
        let behind = blanks(body, at + 1);
        let has_number = body.get(behind).is_some_and(u8::is_ascii_digit);
        if has_number { blanks(body, behind + 1) } else { behind }
    }

    /// Leaves unread what is text to printers behind the first word; `X=5` says nothing to them.
    pub fn read_as_on_printers(&mut self) {
        if self.is_text_on_printers {
            self.words.truncate(1);
            (self.has_checksum, self.has_parameter, self.unreadable, self.assigned) =
                (false, false, None, None);
        }
        self.unreadable = self.assigned.or(self.unreadable);
    }

    fn words(&mut self, body: &[u8], mut at: usize) {
        loop {
            at = blanks(body, at);
            let Some(&byte) = body.get(at) else { return };
            match byte {
                b';' => {
                    self.has_semicolon = true;
                    return;
                }
                b'(' => match memchr::memchr(b')', &body[at..]) {
                    Some(length) => {
                        self.has_parenthesis = true;
                        at += length + 1;
                    }
                    None => return self.give_up(at),
                },
                b'*' => {
                    let n_digits = body[at + 1..].iter().take_while(|b| b.is_ascii_digit()).count();
                    (self.has_checksum, self.has_bare_star) = (true, n_digits == 0);
                    let behind = at + 1 + n_digits;
                    // A checksum ends its line.
                    if !matches!(body.get(blanks(body, behind)), None | Some(b';' | b'(')) {
                        return self.give_up(at);
                    }
                    at = behind;
                }
                b'#' if self.head == Head::Empty && body.get(at + 1).is_some_and(u8::is_ascii_alphabetic) => {
                    self.head = Head::Instruction(name(body, at + 1));
                    return;
                }
                b'#' => {
                    // `# text`, alone on a line, is how Klipper's own files comment.
                    let names_one =
                        body.get(at + 1).is_some_and(|b| b.is_ascii_digit() || b"<#[".contains(b));
                    self.has_parameter = names_one || self.head != Head::Empty;
                    return;
                }
                _ if byte.is_ascii_alphabetic() => match self.word(body, at) {
                    Some(behind) => at = behind,
                    None => return,
                },
                _ => return self.give_up(at),
            }
        }
    }

    /// Reads one word; gives the place behind it, or None where the rest of the line is no words.
    fn word(&mut self, body: &[u8], start: usize) -> Option<usize> {
        let letter = body[start].to_ascii_uppercase();
        let is_first = self.head == Head::Empty;
        let directly = start + 1;
        if is_first && body.get(directly).is_some_and(|&b| b.is_ascii_alphabetic() || b == b'_') {
            return self.named(body, start);
        }
        if is_first && letter == b'O' {
            self.head = Head::Subprogram;
            return None;
        }
        let at = blanks(body, directly);
        let (value, end) = match body.get(at) {
            Some(b'=') if is_assigned(body, start) => {
                self.assigned = self.assigned.or(Some(at as u32));
                match assigned(body, blanks(body, at + 1)) {
                    Some(assigned) => assigned,
                    None => {
                        self.give_up(at);
                        return None;
                    }
                }
            }
            Some(b'0'..=b'9' | b'+' | b'-' | b'.') => match Decimal::parse(&body[at..]) {
                Some((number, length)) => (Value::Number(number), at + length),
                None => match body.get(at + 1) {
                    Some(b'[' | b'#') => (Value::Expression, self.expression(body, at + 1)?),
                    _ => {
                        self.give_up(at);
                        return None;
                    }
                },
            },
            Some(b'[' | b'#') => (Value::Expression, self.expression(body, at)?),
            Some(b'{') => {
                let Some(length) = memchr::memchr(b'}', &body[at..]) else {
                    self.give_up(at);
                    return None;
                };
                let inside = &body[at + 1..at + length];
                let value = if is_placeholder(inside) { Value::Placeholder } else { Value::Expression };
                (value, at + length + 1)
            }
            _ => (Value::Missing, directly),
        };
        if body.get(end) == Some(&b'_') {
            // `T0_LOAD` is a name.
            if is_first {
                return self.named(body, start);
            }
            self.give_up(end);
            return None;
        }
        self.head = Head::Words;
        self.words.push(Word { letter, value, span: Span::new(start, end) });
        if is_first && letter == b'M' {
            let code10 = self.words[0].code10();
            self.is_text_on_printers = code10.is_some_and(takes_text_on_printers);
            if code10.is_some_and(takes_text) {
                return None;
            }
        }
        Some(end)
    }

    /// Reads the name that a line begins with; gives the place behind it where the line goes on.
    fn named(&mut self, body: &[u8], start: usize) -> Option<usize> {
        let name = name(body, start);
        // `DRILL: G91` has a label of Siemens' controls.
        if let [b':', rest @ ..] = &body[name.end as usize..]
            && rest.first() != Some(&b'=')
        {
            return Some(name.end as usize + 1);
        }
        self.head = Head::Macro(name);
        self.code_behind_name = code_behind(body, name.end as usize);
        None
    }

    /// Place behind the bracketed expression or the parameter that begins at `start`.
    fn expression(&mut self, body: &[u8], start: usize) -> Option<usize> {
        let mut at = start;
        while body.get(at) == Some(&b'#') {
            at += 1;
        }
        let end = match body.get(at) {
            Some(b'<') => memchr::memchr(b'>', &body[at..]).map(|length| at + length + 1),
            Some(b'[') => {
                let mut depth = 0_u32;
                let close = body[at..].iter().position(|&byte| {
                    depth += u32::from(byte == b'[');
                    depth -= u32::from(byte == b']');
                    depth == 0
                });
                close.map(|length| at + length + 1)
            }
            Some(byte) if byte.is_ascii_digit() => {
                Some(at + body[at..].iter().take_while(|b| b.is_ascii_digit()).count())
            }
            _ => None,
        };
        if end.is_none() {
            self.give_up(start);
        }
        end
    }

    fn give_up(&mut self, at: usize) {
        self.unreadable = Some(at as u32);
        if self.head == Head::Empty {
            self.head = Head::Words;
        }
    }
}

/// Whether the letter at `start` may have its value behind `=`: it is none of a longer name (`FZ=0.1` is a feed a tooth,
/// and no place), and no code.
fn is_assigned(body: &[u8], start: usize) -> bool {
    let is_of_name = start > 0 && (body[start - 1].is_ascii_alphabetic() || body[start - 1] == b'_');
    !is_of_name && !matches!(body[start].to_ascii_uppercase(), b'G' | b'M' | b'N')
}

/// What stands behind a `=` at `start`, and the place behind it: a plain number, a name between quotes, or what a
/// controller computes.
fn assigned(body: &[u8], start: usize) -> Option<(Value, usize)> {
    if body.get(start) == Some(&b'"') {
        let length = memchr::memchr(b'"', &body[start + 1..])?;
        return Some((Value::Name(number_of_name(&body[start + 1..start + 1 + length])), start + length + 2));
    }
    if let Some((number, length)) = Decimal::parse(&body[start..]) {
        let end = start + length;
        let behind = body.get(blanks(body, end));
        if !behind.is_some_and(|byte| b"+-*/=".contains(byte)) {
            return Some((Value::Number(number), end));
        }
    }
    let end = computed_end(body, start)?;
    let is_mode = [&b"AC("[..], b"IC("].iter().any(|mode| {
        body.get(start..start + mode.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(mode))
    });
    Some((if is_mode { Value::OwnMode } else { Value::Expression }, end))
}

/// Place behind what is computed from `start` on: it goes to the next blank or comment outside of brackets. None where there
/// is nothing, or a bracket stays open.
fn computed_end(body: &[u8], start: usize) -> Option<usize> {
    let mut depth = 0_i32;
    let mut at = start;
    while let Some(&byte) = body.get(at) {
        match byte {
            b'(' | b'[' => depth += 1,
            b')' | b']' => depth -= 1,
            b' ' | b'\t' | b';' | b'=' if depth == 0 => break,
            _ => {}
        }
        if depth < 0 {
            return None;
        }
        at += 1;
    }
    (depth == 0 && at > start).then_some(at)
}

/// A number that no tool has, of its name (FNV-1a).
fn number_of_name(name: &[u8]) -> u64 {
    let hash = name.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, &byte| {
        (hash ^ u64::from(byte.to_ascii_uppercase())).wrapping_mul(0x0100_0000_01b3)
    });
    hash | 1 << 63
}

#[inline]
fn blanks(body: &[u8], at: usize) -> usize {
    at + body[at..].iter().take_while(|&&byte| byte == b' ' || byte == b'\t').count()
}

/// Place behind the line number that begins at `at`.
fn line_number(body: &[u8], at: usize) -> Option<usize> {
    if !matches!(body.get(at), Some(b'N' | b'n')) {
        return None;
    }
    let digits = blanks(body, at + 1);
    let (_, length) = Decimal::parse(&body[digits..])?;
    Some(digits + length)
}

fn name(body: &[u8], start: usize) -> Span {
    let length = body[start..].iter().take_while(|b| b.is_ascii_alphanumeric() || **b == b'_').count();
    Span::new(start, start + length)
}

/// Place of the first word behind `start` that begins with `G` or `M` and goes on with a digit; text between quotes, in
/// parentheses or braces and behind `;` is none.
fn code_behind(body: &[u8], start: usize) -> Option<u32> {
    let mut closing = None;
    let mut before = b'_';
    for (at, &byte) in body.iter().enumerate().skip(start) {
        match closing {
            Some(end) if byte != end => {}
            Some(_) => closing = None,
            None => match byte {
                b'"' | b'\'' => closing = Some(byte),
                b'(' => closing = Some(b')'),
                b'{' => closing = Some(b'}'),
                b';' => return None,
                b'G' | b'g' | b'M' | b'm' => {
                    let begins = before.is_ascii_whitespace() || b"\"')".contains(&before);
                    if begins && body.get(at + 1).is_some_and(u8::is_ascii_digit) {
                        return Some(at as u32);
                    }
                }
                _ => {}
            },
        }
        before = byte;
    }
    None
}

/// M codes (times ten) whose line is text: messages, file names, object names.
fn takes_text(code10: u32) -> bool {
    matches!(
        code10 / 10,
        98 | 99 | 117 | 118 | 486 | 550..=553 | 586..=589 | 808 | 862 | 928 | 929 | 1002
    )
}

/// M codes (times ten) whose line is text for printers alone: `M0` with a message, `M23` with a file. Machine tools have
/// words behind them: a move on the line of an optional stop, a rigid tapping cycle behind `M29`.
fn takes_text_on_printers(code10: u32) -> bool {
    matches!(code10 / 10, 0 | 1 | 16 | 20..=33 | 36..=39)
}

/// A bare lower-case name, as slicers' templates have. What RepRapFirmware computes has a point, a bracket or an
/// operator, or is one of its constants.
fn is_placeholder(inside: &[u8]) -> bool {
    const CONSTANTS: [&[u8]; 8] =
        [b"iterations", b"line", b"null", b"pi", b"result", b"true", b"false", b"input"];
    inside.first().is_some_and(u8::is_ascii_lowercase)
        && inside.iter().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || *b == b'_')
        && !CONSTANTS.contains(&inside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lexed(text: &str) -> Line {
        let mut line = Line::default();
        line.lex(text.as_bytes());
        line
    }

    fn shown(text: &str) -> String {
        let line = lexed(text);
        let words = line.words.iter().map(|word| {
            let value = match word.value {
                Value::Number(number) => number.to_f64().to_string(),
                Value::Missing => "-".to_owned(),
                Value::Expression => "?".to_owned(),
                Value::Placeholder => "{}".to_owned(),
                Value::OwnMode => "mode".to_owned(),
                Value::Name(_) => "name".to_owned(),
            };
            format!("{}={value}", char::from(word.letter))
        });
        words.collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn words_of_slicers_and_of_machining_programs() {
        assert_eq!(shown("G1 X114.255 Y94.658 E2.00592"), "G=1 X=114.255 Y=94.658 E=2.00592");
        assert_eq!(shown("N30g1z-.1f24 ; comment X5"), "G=1 Z=-0.1 F=24");
        assert_eq!(shown("G17 G2 (270 360) I0.5 J7"), "G=17 G=2 I=0.5 J=7");
        assert_eq!(shown(" X3.2100 Z-0.1530"), "X=3.21 Z=-0.153");
        assert_eq!(shown("G28 X Y"), "G=28 X=- Y=-");
        assert_eq!(shown("N50T#<toolno>M6"), "T=? M=6");
        assert_eq!(shown("G0X[#<xscale>*53.]Y[#1*-[2+3]]"), "G=0 X=? Y=?");
        assert_eq!(shown("G1 X0 Y{machine_depth} ;Present print"), "G=1 X=0 Y={}");
        assert_eq!(shown("G1 X{move.axes[0].max}"), "G=1 X=?");
        assert_eq!(shown("X -5 Y+ 3"), "X=-5");
        assert_eq!(shown("G 1 X 10"), "G=1 X=10");
    }

    #[test]
    fn values_behind_an_equals_sign() {
        assert_eq!(shown("G1 X=150 Y = -2.5Z=.5 F=500"), "G=1 X=150 Y=-2.5 Z=0.5 F=500");
        assert_eq!(shown("N10 X=IC(10) Y=ac(-5) Z=R1*(2+R3) F=$AC_F[1]"), "X=mode Y=mode Z=? F=?");
        assert_eq!(shown("X=5*3 Y=2+R1 Z=-R2 E=DC(90)"), "X=? Y=? Z=? E=?");
        assert_eq!(shown("T=\"MILL 10\" D1 ; T=\"X\""), "T=name D=1");
        assert_eq!(shown("G0X=5Y=7"), "G=0 X=5 Y=7");
        assert_eq!(lexed("X=5").assigned, Some(1));
        let names = |text: &str| lexed(text).words[0].tool();
        assert_eq!(names("T=\"a\""), names("T=\"A\""));
        assert_ne!(names("T=\"a\""), names("T=\"b\""));
        assert_eq!((names("T=3"), names("T3.0"), names("T")), (Some(3), Some(3), None));
        // Longer names, numbered axes, codes, and what is not ended.
        for (text, at) in [
            ("G1 FZ=0.1", 5),
            ("G1 X1=5", 5),
            ("G1 X=", 4),
            ("X=IC(5", 1),
            ("G=1", 1),
            ("T=\"A", 1),
            ("X==5", 1),
        ] {
            assert_eq!(lexed(text).unreadable, Some(at), "{text}");
        }
    }

    #[test]
    fn heads() {
        assert_eq!(lexed("").head, Head::Empty);
        assert_eq!(lexed("  ; G1 X5").head, Head::Empty);
        assert_eq!(lexed("%").head, Head::Percent);
        assert_eq!(lexed("o<rm400> sub").head, Head::Subprogram);
        assert_eq!(lexed("N10 O100 while [#1 LT 3]").head, Head::Subprogram);
        for (text, length) in [("START_PRINT EXTRUDER=210", 11), ("T0_LOAD X5", 7), ("if {true}", 2)] {
            let Head::Macro(name) = lexed(text).head else { panic!("{text}") };
            assert_eq!(name.end - name.start, length);
        }
        assert_eq!(lexed("N10 #CS ON [0,0,0,0,0,30]").head, Head::Instruction(Span { start: 5, end: 7 }));
        assert!(lexed("#1=5").has_parameter && lexed("#<depth>=5").has_parameter);
        assert!(!lexed("# X5 to the left").has_parameter && lexed("G1 X5 # left").has_parameter);
        for text in ["DRILL: G1 X5", "N10 T0_A:G1 X5", "AN_1: ; begins", "END_:"] {
            let line = lexed(text);
            assert!(!matches!(line.head, Head::Macro(_)) && line.unreadable.is_none(), "{text}");
        }
        assert_eq!(shown("DRILL: G91 X5"), "G=91 X=5");
        for (text, at) in [
            ("SUPA G0 Z0", Some(5)),
            ("MSG(\"G1\") g91", Some(10)),
            ("MSG(\"DEPTH\")M8", Some(12)),
            ("PRINT GCODE='G1 X5' G=1 A=G1 {G1} XG1 ; G1", None),
            ("NAME:=G1", None),
        ] {
            assert_eq!(lexed(text).code_behind_name, at, "{text}");
        }
        for text in ["/G1 X5", "/1 G1 X5", "N7 /G1 X5", "/ 2 N7 G1 X5", "/3G1X5"] {
            assert!(lexed(text).is_block_skip && shown(text) == "G=1 X=5", "{text}");
        }
        assert!(lexed("N3 G1 X5*71").has_checksum);
        assert_eq!(lexed("\u{feff}G91").words.len(), 1);
    }

    #[test]
    fn text_of_messages_is_not_read() {
        assert_eq!(shown("M117 G1 X10"), "M=117");
        assert_eq!(shown("M1002 judge_flag timelapse_record_flag"), "M=1002");
        // Whether it is one, the firmware says.
        assert_eq!(shown("M29 S800 G84 X10."), "M=29 S=800 G=84 X=10");
        let mut line = lexed("M0 X (");
        assert!(line.is_text_on_printers && line.unreadable.is_some() && !lexed("M3").is_text_on_printers);
        line.read_as_on_printers();
        assert!(line.words.len() == 1 && line.unreadable.is_none());
        assert_eq!(shown("M862.3 P \"MINI\" G1 X1"), "M=862.3");
        assert_eq!(shown("M3 S1000 G0 X5"), "M=3 S=1000 G=0 X=5");
    }

    #[test]
    fn codes_with_a_digit() {
        let code = |text: &str| lexed(text).words[0].code10();
        assert_eq!(code("G38.2"), Some(382));
        assert_eq!(code("G01"), Some(10));
        assert_eq!(code("G1.00"), Some(10));
        assert_eq!(code("G1.25"), None);
        assert_eq!(code("G-1"), None);
    }

    #[test]
    fn what_cannot_be_read_says_where() {
        assert_eq!(lexed("G1 X1=2").unreadable, Some(5));
        assert_eq!(lexed("G1 X--1").unreadable, Some(4));
        assert_eq!(lexed("G1 X5 (open").unreadable, Some(6));
        assert_eq!(lexed("G1 X[#1").unreadable, Some(4));
        assert_eq!(lexed("G1 X1 0").unreadable, Some(6));
        assert_eq!(lexed("G1 X1*12 Y1").unreadable, Some(5));
    }

    proptest! {
        #[test]
        fn any_bytes_give_words_inside_the_line(body in proptest::collection::vec(any::<u8>(), 0..60)) {
            let mut line = Line::default();
            line.lex(&body);
            for word in &line.words {
                prop_assert!(word.span.start < word.span.end && word.span.end as usize <= body.len());
            }
        }

        #[test]
        fn any_text_of_words_gives_words(body in "[GXYZEMNO#\\[\\]{}();*%/0-9. _-]{0,40}") {
            let mut line = Line::default();
            line.lex(body.as_bytes());
            for word in &line.words {
                prop_assert!(word.span.end as usize <= body.len());
            }
        }
    }
}
