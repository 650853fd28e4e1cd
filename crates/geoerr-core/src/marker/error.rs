//! Why a marker's picture gave no corners.

use thiserror::Error;

/// Why a marker was not fitted.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MarkerError {
    /// The pattern is not square, or the picture not as large as it says.
    #[error("{what} has {found} entries, {expected} are needed")]
    Length {
        /// What it is.
        what: &'static str,
        /// Entries there.
        found: usize,
        /// Entries needed.
        expected: usize,
    },
    /// Modules are too few pixels wide.
    #[error("the marker is too small: {module_px:.1} px a module")]
    TooSmall {
        /// Width of a module.
        module_px: f64,
    },
    /// It lies outside the picture.
    #[error("the marker is not in the picture")]
    Outside,
    /// The lens bends no ray to these pixels.
    #[error("the lens model has no inverse here")]
    NoInverse,
    /// No homography.
    #[error("three corners in one line")]
    InOneLine,
    /// Black and white cannot be told from the pixels.
    #[error("the picture shows no black and white here")]
    NoBlackAndWhite,
    /// The equations are singular.
    #[error("the picture does not determine the marker")]
    Undetermined,
    /// Steps grew.
    #[error("the fit diverged")]
    Diverged,
    /// Steps did not shrink.
    #[error("the fit did not converge")]
    NotConverged,
    /// A corner went too far.
    #[error("the fit moved a corner by {px:.1} px")]
    Moved {
        /// How far.
        px: f64,
    },
    /// The blur is larger than the modules.
    #[error("the blur came out as {long_px:.2} by {short_px:.2} px")]
    Blurred {
        /// Along its long axis.
        long_px: f64,
        /// Along its short axis.
        short_px: f64,
    },
    /// The light is of a kind that no model here follows.
    #[error(
        "a shadow's edge or a reflection on it: without a part of the picture a corner moves by {px:.1} px"
    )]
    Uneven {
        /// How far, as a standard deviation.
        px: f64,
    },
    /// Fewer pixels than a covariance needs.
    #[error("too few pixels")]
    TooFew,
    /// Something else is there.
    #[error("the marker has no contrast")]
    NoContrast,
    /// Something else is there, or most of it is covered.
    #[error("{per_cent:.0} % of its pixels do not show this marker")]
    NotThisMarker {
        /// Of its pixels.
        per_cent: f64,
    },
}

impl MarkerError {
    /// Whether the picture is that of something else, or most of the marker is covered: no other way of looking helps.
    #[must_use]
    pub fn is_another(&self) -> bool {
        matches!(self, Self::NoContrast | Self::NotThisMarker { .. })
    }
}
