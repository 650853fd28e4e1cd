//! Tokens to a syntax tree, by binding powers (Pratt).
//!
//! The tree is a list in which operands stand before what uses them, so that walking and dropping it need no recursion
//! and a hostile text cannot exhaust the stack. Only brackets, prefix signs and powers nest, and those are counted.

use std::ops::Range;

use super::error::Problem;
use super::functions::{Binary, Function, Signature, Unary, function, function_names};
use super::lexer::{Placed, Token, tokens};
use super::names::near;
use super::{MAX_NESTING, MAX_TEXT_BYTES};

/// Place of a node in its tree.
pub(super) type SyntaxId = usize;

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Number(f64),
    /// A name, its place without brackets; inside `lag()` the name `v_x` means the mean speed.
    Name {
        start: usize,
        end: usize,
        in_lag: bool,
    },
    Unary(Unary, SyntaxId),
    Binary(Binary, SyntaxId, SyntaxId),
    Where([SyntaxId; 3]),
    Lag(SyntaxId, SyntaxId),
    Windup(SyntaxId),
}

/// One node and its place in the text.
#[derive(Clone, Debug)]
pub(super) struct Syntax {
    pub(super) kind: Kind,
    pub(super) span: Range<usize>,
}

/// Parses a text; the last node is the whole.
pub(super) fn parse(text: &str) -> Result<Vec<Syntax>, Placed> {
    if text.len() > MAX_TEXT_BYTES {
        return Err((Problem::TooLong { found: text.len() }, 0..0));
    }
    let tokens = tokens(text)?;
    if tokens.is_empty() {
        return Err((Problem::Empty, 0..text.len()));
    }
    let mut parser = Parser { text, tokens, at: 0, depth: 0, lags: 0, nodes: Vec::new() };
    parser.expression(0)?;
    match parser.peek() {
        None => Ok(parser.nodes),
        Some(token) => Err((after_value(token), parser.place())),
    }
}

const COMPARISON: u8 = 1;
const SUM: u8 = 3;
const PRODUCT: u8 = 5;
const SIGN: u8 = 7;
const POWER: u8 = 9;

/// What an operator between two values does: its strength, its operation, and whether its sides change places.
fn infix(token: Token) -> Option<(u8, Binary, bool)> {
    Some(match token {
        Token::Plus => (SUM, Binary::Add, false),
        Token::Minus => (SUM, Binary::Subtract, false),
        Token::Times => (PRODUCT, Binary::Multiply, false),
        Token::Divide => (PRODUCT, Binary::Divide, false),
        Token::Power => (POWER, Binary::Power, false),
        Token::Less => (COMPARISON, Binary::Less, false),
        Token::LessEqual => (COMPARISON, Binary::LessEqual, false),
        Token::Greater => (COMPARISON, Binary::Less, true),
        Token::GreaterEqual => (COMPARISON, Binary::LessEqual, true),
        Token::Equal => (COMPARISON, Binary::Equal, false),
        Token::NotEqual => (COMPARISON, Binary::NotEqual, false),
        Token::Number(_) | Token::Name | Token::Open | Token::Close | Token::Comma => return None,
    })
}

/// Why a token cannot follow a complete value.
fn after_value(token: Token) -> Problem {
    match token {
        Token::Number(_) | Token::Name | Token::Open => Problem::MissingOperator,
        Token::Close => Problem::NotOpened,
        _ => Problem::Expected { expected: "an operator" },
    }
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<(Token, Range<usize>)>,
    at: usize,
    depth: usize,
    /// How many `lag()` surround this place.
    lags: usize,
    nodes: Vec<Syntax>,
}

impl Parser<'_> {
    fn peek(&self) -> Option<Token> {
        self.tokens.get(self.at).map(|(token, _)| *token)
    }

    /// Place of the next token; behind the text where there is none.
    fn place(&self) -> Range<usize> {
        let end = self.text.trim_end().len();
        self.tokens.get(self.at).map_or(end..end, |(_, span)| span.clone())
    }

    fn push(&mut self, kind: Kind, span: Range<usize>) -> SyntaxId {
        self.nodes.push(Syntax { kind, span });
        self.nodes.len() - 1
    }

    fn span(&self, node: SyntaxId) -> Range<usize> {
        self.nodes[node].span.clone()
    }

    /// A value and all that binds to it more strongly than `strength`.
    fn expression(&mut self, strength: u8) -> Result<SyntaxId, Placed> {
        self.depth += 1;
        if self.depth > MAX_NESTING {
            return Err((Problem::TooDeep, self.place()));
        }
        let mut left = self.value()?;
        while let Some(token) = self.peek() {
            let Some((binds, operation, is_swapped)) = infix(token) else { break };
            if binds <= strength {
                break;
            }
            self.at += 1;
            // A power binds to the right: 2^3^2 = 2^(3^2). Its exponent may have a sign.
            let right = self.expression(if binds == POWER { POWER - 1 } else { binds })?;
            let span = self.span(left).start..self.span(right).end;
            if binds == COMPARISON && self.peek().and_then(infix).is_some_and(|next| next.0 == COMPARISON) {
                return Err((Problem::ChainedComparison, self.place()));
            }
            let (first, second) = if is_swapped { (right, left) } else { (left, right) };
            left = self.push(Kind::Binary(operation, first, second), span);
        }
        self.depth -= 1;
        Ok(left)
    }

    /// A number, a name, a call, something in brackets, or a signed value.
    fn value(&mut self) -> Result<SyntaxId, Placed> {
        let place = self.place();
        let Some(token) = self.peek() else {
            return Err((Problem::UnexpectedEnd { expected: "a value" }, place));
        };
        self.at += 1;
        match token {
            Token::Number(value) => Ok(self.push(Kind::Number(value), place)),
            Token::Name => self.name(place),
            Token::Minus => {
                let operand = self.expression(SIGN)?;
                let span = place.start..self.span(operand).end;
                Ok(self.push(Kind::Unary(Unary::Negate, operand), span))
            }
            Token::Plus => self.expression(SIGN),
            Token::Open => {
                let inside = self.expression(0)?;
                self.close(&place)?;
                // The brackets are part of the place, so that a mark under it shows them.
                self.nodes[inside].span = place.start..self.tokens[self.at - 1].1.end;
                Ok(inside)
            }
            _ => Err((Problem::Expected { expected: "a value" }, place)),
        }
    }

    /// The closing bracket of the one at `opened`.
    fn close(&mut self, opened: &Range<usize>) -> Result<(), Placed> {
        match self.peek() {
            Some(Token::Close) => {
                self.at += 1;
                Ok(())
            }
            Some(token @ (Token::Number(_) | Token::Name | Token::Open)) => {
                Err((after_value(token), self.place()))
            }
            Some(Token::Comma) => Err((Problem::Expected { expected: "an operator or `)`" }, self.place())),
            _ => Err((Problem::NotClosed, opened.clone())),
        }
    }

    fn name(&mut self, place: Range<usize>) -> Result<SyntaxId, Placed> {
        let name = &self.text[place.clone()];
        let is_called = self.peek() == Some(Token::Open);
        if is_called {
            let Some(signature) = function(name) else {
                return Err((unknown_function(name), place));
            };
            return self.call(&signature, place);
        }
        if name == "pi" {
            return Ok(self.push(Kind::Number(std::f64::consts::PI), place));
        }
        let in_lag = self.lags > 0;
        Ok(self.push(Kind::Name { start: place.start, end: place.end, in_lag }, place))
    }

    fn call(&mut self, signature: &Signature, place: Range<usize>) -> Result<SyntaxId, Placed> {
        let opened = self.place();
        self.at += 1;
        let is_lag = signature.function == Function::Lag;
        self.lags += usize::from(is_lag);
        let mut arguments = Vec::new();
        if self.peek() != Some(Token::Close) {
            arguments.push(self.expression(0)?);
            while self.peek() == Some(Token::Comma) {
                self.at += 1;
                arguments.push(self.expression(0)?);
            }
        }
        self.lags -= usize::from(is_lag);
        self.close(&opened)?;
        let span = place.start..self.tokens[self.at - 1].1.end;
        let found = arguments.len();
        let arity = Problem::Arity { name: signature.name, needed: signature.in_words, found };
        if found < signature.least || found > signature.most {
            return Err((arity, span));
        }
        let kind = match (signature.function, arguments.as_slice()) {
            (Function::Unary(operation), &[a]) => Kind::Unary(operation, a),
            (Function::Binary(operation), &[a, b, ref more @ ..]) => {
                let mut all = Kind::Binary(operation, a, b);
                for &next in more {
                    let before = self.push(all, span.clone());
                    all = Kind::Binary(operation, before, next);
                }
                all
            }
            (Function::Where, &[condition, a, b]) => Kind::Where([condition, a, b]),
            (Function::Lag, &[u, tau]) => Kind::Lag(u, tau),
            (Function::Windup, &[lambda]) => Kind::Windup(lambda),
            _ => return Err((arity, span)),
        };
        Ok(self.push(kind, span))
    }
}

fn unknown_function(name: &str) -> Problem {
    let known: Vec<String> = function_names().map(str::to_owned).collect();
    Problem::UnknownFunction { name: name.to_owned(), near: near(name, &known), known }
}
