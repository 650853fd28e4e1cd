//! Text to tokens with their places.

use std::ops::Range;

use super::error::Problem;

/// What a token is; names are looked up in the text by their place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Token {
    Number(f64),
    Name,
    Plus,
    Minus,
    Times,
    Divide,
    Power,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    NotEqual,
    Open,
    Close,
    Comma,
}

/// A problem and its place.
pub(super) type Placed = (Problem, Range<usize>);

/// Cuts a text into tokens.
pub(super) fn tokens(text: &str) -> Result<Vec<(Token, Range<usize>)>, Placed> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let next = bytes.get(at + 1).copied();
        let (token, length) = match byte {
            b' ' | b'\t' | b'\n' | b'\r' => {
                at += 1;
                continue;
            }
            b'0'..=b'9' => number(text, at)?,
            b'.' if next.is_some_and(|next| next.is_ascii_digit()) => number(text, at)?,
            b'a'..=b'z' | b'A'..=b'Z' | b'_' => {
                let is_part = |byte: &&u8| byte.is_ascii_alphanumeric() || **byte == b'_';
                (Token::Name, bytes[at..].iter().take_while(is_part).count())
            }
            b'*' if next == Some(b'*') => {
                return Err(foreign("**", "a power is written `^`", at));
            }
            b'&' if next == Some(b'&') => {
                return Err(foreign("&&", "multiply the comparisons", at));
            }
            b'|' if next == Some(b'|') => {
                return Err(foreign("||", "take `max` of the comparisons", at));
            }
            b'+' => (Token::Plus, 1),
            b'-' => (Token::Minus, 1),
            b'*' => (Token::Times, 1),
            b'/' => (Token::Divide, 1),
            b'^' => (Token::Power, 1),
            b'<' if next == Some(b'=') => (Token::LessEqual, 2),
            b'<' => (Token::Less, 1),
            b'>' if next == Some(b'=') => (Token::GreaterEqual, 2),
            b'>' => (Token::Greater, 1),
            b'=' if next == Some(b'=') => (Token::Equal, 2),
            b'=' => return Err(foreign("=", "`==` compares", at)),
            b'!' if next == Some(b'=') => (Token::NotEqual, 2),
            b'(' => (Token::Open, 1),
            b')' => (Token::Close, 1),
            b',' => (Token::Comma, 1),
            _ => {
                let found = text[at..].chars().next().unwrap_or('\u{fffd}');
                return Err((Problem::UnexpectedCharacter { found }, at..at + found.len_utf8()));
            }
        };
        found.push((token, at..at + length));
        at += length;
    }
    Ok(found)
}

fn foreign(found: &'static str, instead: &'static str, at: usize) -> Placed {
    (Problem::ForeignOperator { found, instead }, at..at + found.len())
}

/// Digits, a point, an exponent: the longest number that begins here.
fn number(text: &str, at: usize) -> Result<(Token, usize), Placed> {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut end = at + digits(at);
    if bytes.get(end) == Some(&b'.') {
        end += 1;
        end += digits(end);
    }
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        let exponent = digits((end + 1 + sign).min(bytes.len()));
        // Without digits it is no exponent: `2e` is a number beside a name, and is refused as that.
        if exponent > 0 {
            end += 1 + sign + exponent;
        }
    }
    match text[at..end].parse::<f64>() {
        Ok(value) if value.is_finite() => Ok((Token::Number(value), end - at)),
        _ => Err((Problem::NumberTooLarge, at..end)),
    }
}
