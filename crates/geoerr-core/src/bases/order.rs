//! What of a function is asked for.

/// What of a function is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// d/dq, per mm.
    Derivative,
    /// The function.
    Value,
    /// Its integral from the low end of the range, times mm.
    Integral,
}

/// How often a function is integrated: once more than is asked for where a basis is itself an integral.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Depth {
    Derivative,
    Value,
    Integral,
    DoubleIntegral,
}

impl Order {
    pub(super) fn depth(self) -> Depth {
        match self {
            Self::Derivative => Depth::Derivative,
            Self::Value => Depth::Value,
            Self::Integral => Depth::Integral,
        }
    }

    /// The depth at which the integrand of a function answers for it.
    pub(super) fn depth_of_integrand(self) -> Depth {
        match self {
            Self::Derivative => Depth::Value,
            Self::Value => Depth::Integral,
            Self::Integral => Depth::DoubleIntegral,
        }
    }
}
