//! Why a basis, a curve or a grid of elements is refused.

/// Why a basis, a curve or a grid of elements is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BasisError {
    /// A degree or order beyond what is held to rounding.
    #[error("{what} {found}: at most {most}")]
    TooHigh {
        /// `degree` or `order`.
        what: &'static str,
        /// The one asked for.
        found: usize,
        /// The highest possible.
        most: usize,
    },
    /// Too few nodes, knots or grid lines to span a range.
    #[error("{found} {what}: at least {needed} are needed")]
    TooFew {
        /// `nodes`, `knots`, `nodes along x`, ...
        what: &'static str,
        /// Number given.
        found: usize,
        /// Least number.
        needed: usize,
    },
    /// Three-node elements share their end nodes, so that their number of nodes is odd.
    #[error("{found} nodes: three-node elements that share their ends have 3, 5, 7, ... nodes")]
    EvenNodes {
        /// Number given.
        found: usize,
    },
    /// A basis of more functions than data can ever determine.
    #[error("{found} functions: at most {most}")]
    TooManyFunctions {
        /// Number of functions.
        found: usize,
        /// The most that are allowed.
        most: usize,
    },
    /// A position that is not a place on a machine.
    #[error("{what} {index} is {position_mm}, not a finite position within {most_mm:e} mm of 0")]
    Position {
        /// `node`, `knot`, `end of the range`, ...
        what: &'static str,
        /// Its index.
        index: usize,
        /// Its value.
        position_mm: f64,
        /// The farthest possible.
        most_mm: f64,
    },
    /// Positions that do not rise, or hardly.
    #[error(
        "{what} {index} is {position_mm} mm after {previous_mm} mm: it must lie at least {least_mm:e} mm above"
    )]
    NotRising {
        /// `node`, `knot`, `end of the range`, ...
        what: &'static str,
        /// Index of the position that does not rise.
        index: usize,
        /// The position before it.
        previous_mm: f64,
        /// Its value.
        position_mm: f64,
        /// The least distance.
        least_mm: f64,
    },
    /// A knot that is repeated until the spline would jump.
    #[error("the knot at {position_mm} mm is repeated {found} times: at most {most} for this degree")]
    KnotRepeated {
        /// Where.
        position_mm: f64,
        /// How often it is given.
        found: usize,
        /// How often it may be.
        most: usize,
    },
    /// A period that cannot be told from a line, or is no period.
    #[error(
        "a period of {period_mm} mm with order {order} over {length_mm} mm: it must be finite, its shortest wave at \
         least {least_mm:e} mm, and at most {most_lengths} times the range"
    )]
    Period {
        /// The period asked for.
        period_mm: f64,
        /// The order asked for.
        order: usize,
        /// Length of the range.
        length_mm: f64,
        /// Shortest possible wave.
        least_mm: f64,
        /// Longest possible period in lengths of the range.
        most_lengths: f64,
    },
    /// A tangent integral of a tangent integral.
    #[error("a tangent integral of a tangent integral has no meaning: give the basis of the angle")]
    NestedTangentIntegral,
    /// Coefficients or values that are not one for each function, node or position.
    #[error("{found} {what}: {needed} are needed")]
    Count {
        /// `coefficients`, `nodal values`, ...
        what: &'static str,
        /// Number given.
        found: usize,
        /// Number needed.
        needed: usize,
    },
    /// A coefficient or value that is not finite.
    #[error("{what} {index} is {value}, a finite number is needed")]
    NotFinite {
        /// `coefficient`, `nodal value`, ...
        what: &'static str,
        /// Its index.
        index: usize,
        /// Its value.
        value: f64,
    },
}
