//! The operations of a formula, by name and as numbers.

/// Operations on one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Unary {
    Negate,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Exp,
    Log,
    Sqrt,
    Sinh,
    Cosh,
    Tanh,
    Abs,
    Sign,
    Step,
}

/// Operations on two values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Atan2,
    Min,
    Max,
    Less,
    LessEqual,
    Equal,
    NotEqual,
    /// e^(−a/b): what is left of a start value after travel a with constant b.
    Decay,
}

impl Unary {
    /// The operation on numbers. Every one gives NaN for NaN.
    #[inline(always)]
    pub(super) fn apply(self, a: f64) -> f64 {
        match self {
            Self::Negate => -a,
            Self::Sin => a.sin(),
            Self::Cos => a.cos(),
            Self::Tan => a.tan(),
            Self::Asin => a.asin(),
            Self::Acos => a.acos(),
            Self::Atan => a.atan(),
            Self::Exp => a.exp(),
            Self::Log => a.ln(),
            Self::Sqrt => a.sqrt(),
            Self::Sinh => a.sinh(),
            Self::Cosh => a.cosh(),
            Self::Tanh => a.tanh(),
            Self::Abs => a.abs(),
            Self::Sign => sign(a),
            Self::Step => step(a),
        }
    }
}

impl Unary {
    /// Whether it has neither corner nor jump where it has a value.
    pub(super) fn is_smooth(self) -> bool {
        !matches!(self, Self::Abs | Self::Sign | Self::Step)
    }
}

impl Binary {
    /// The operation on numbers. Every one gives NaN where either is NaN.
    #[inline(always)]
    pub(super) fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => power(a, b),
            Self::Atan2 => a.atan2(b),
            Self::Min => smaller(a, b),
            Self::Max => larger(a, b),
            Self::Less => truth(a < b, a, b),
            Self::LessEqual => truth(a <= b, a, b),
            Self::Equal => truth(a == b, a, b),
            Self::NotEqual => truth(a != b, a, b),
            Self::Decay => decay(a, b),
        }
    }

    /// Whether it has neither corner nor jump where it has a value.
    pub(super) fn is_smooth(self) -> bool {
        matches!(self, Self::Add | Self::Subtract | Self::Multiply | Self::Divide | Self::Power | Self::Decay)
    }

    /// Whether `a op b` is `b op a` to the last bit.
    pub(super) fn is_commutative(self) -> bool {
        matches!(self, Self::Add | Self::Multiply | Self::Min | Self::Max | Self::Equal | Self::NotEqual)
    }
}

/// −1, 0, 1.
#[inline(always)]
pub(super) fn sign(a: f64) -> f64 {
    if a > 0.0 {
        1.0
    } else if a < 0.0 {
        -1.0
    } else {
        // ±0 and NaN as they are.
        a
    }
}

/// Heaviside's step, 1 at 0.
#[inline(always)]
pub(super) fn step(a: f64) -> f64 {
    if a >= 0.0 {
        1.0
    } else if a < 0.0 {
        0.0
    } else {
        a
    }
}

/// `a` where the condition holds (is not 0), else `b`; an unknown condition gives NaN.
#[inline(always)]
pub(super) fn select(condition: f64, a: f64, b: f64) -> f64 {
    if condition.is_nan() {
        condition
    } else if condition != 0.0 {
        a
    } else {
        b
    }
}

/// e^(−travel/length): 1 without travel, 0 for length 0, NaN for a negative length.
#[inline(always)]
pub(crate) fn decay(travel: f64, length: f64) -> f64 {
    if length.is_nan() || length < 0.0 {
        f64::NAN
    } else if travel == 0.0 {
        1.0
    } else {
        (-travel / length).exp()
    }
}

#[inline(always)]
fn power(a: f64, b: f64) -> f64 {
    // C's pow knows NaN^0 = 1 and 1^NaN = 1; an unknown value stays unknown here.
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.powf(b) }
}

#[inline(always)]
fn smaller(a: f64, b: f64) -> f64 {
    if a.is_nan() || a < b { a } else { b }
}

#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

#[inline(always)]
fn truth(holds: bool, a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { f64::from(u8::from(holds)) }
}

/// What a name before a bracket stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    Unary(Unary),
    Binary(Binary),
    Where,
    Lag,
    Windup,
}

/// Every function: name, meaning, least number of arguments, largest, and the number in words.
const FUNCTIONS: [(&str, Function, usize, usize, &str); 21] = {
    use Function as F;
    const ONE: &str = "one argument";
    const MANY: usize = usize::MAX;
    [
        ("sin", F::Unary(Unary::Sin), 1, 1, ONE),
        ("cos", F::Unary(Unary::Cos), 1, 1, ONE),
        ("tan", F::Unary(Unary::Tan), 1, 1, ONE),
        ("asin", F::Unary(Unary::Asin), 1, 1, ONE),
        ("acos", F::Unary(Unary::Acos), 1, 1, ONE),
        ("atan", F::Unary(Unary::Atan), 1, 1, ONE),
        ("atan2", F::Binary(Binary::Atan2), 2, 2, "two arguments (y, x)"),
        ("exp", F::Unary(Unary::Exp), 1, 1, ONE),
        ("log", F::Unary(Unary::Log), 1, 1, ONE),
        ("sqrt", F::Unary(Unary::Sqrt), 1, 1, ONE),
        ("sinh", F::Unary(Unary::Sinh), 1, 1, ONE),
        ("cosh", F::Unary(Unary::Cosh), 1, 1, ONE),
        ("tanh", F::Unary(Unary::Tanh), 1, 1, ONE),
        ("abs", F::Unary(Unary::Abs), 1, 1, ONE),
        ("sign", F::Unary(Unary::Sign), 1, 1, ONE),
        ("step", F::Unary(Unary::Step), 1, 1, ONE),
        ("min", F::Binary(Binary::Min), 2, MANY, "two or more arguments"),
        ("max", F::Binary(Binary::Max), 2, MANY, "two or more arguments"),
        ("where", F::Where, 3, 3, "three arguments (condition, value if it holds, value if not)"),
        ("lag", F::Lag, 2, 2, "two arguments (what is followed, time constant)"),
        ("windup", F::Windup, 1, 1, "one argument (length)"),
    ]
};

/// A function with its canonical name and numbers of arguments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Signature {
    pub(super) name: &'static str,
    pub(super) function: Function,
    pub(super) least: usize,
    pub(super) most: usize,
    pub(super) in_words: &'static str,
}

/// The function of this name.
pub(super) fn function(name: &str) -> Option<Signature> {
    FUNCTIONS.iter().find(|entry| entry.0 == name).map(|&(name, function, least, most, in_words)| Signature {
        name,
        function,
        least,
        most,
        in_words,
    })
}

/// The names of all functions.
pub(super) fn function_names() -> impl Iterator<Item = &'static str> {
    FUNCTIONS.iter().map(|entry| entry.0)
}
