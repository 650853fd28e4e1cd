"""What the figures of a fit mean, in sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from geoerr.summaries import p_words

# Less probable than this, what the residual has beyond the noise is not chance.
_SIGNIFICANCE = 0.01
# Less probable than this it is seldom chance, and is not to be passed over.
_SELDOM = 0.05
# In a record's `noise`: what share of the stated uncertainties the points scatter, where it is less than a tenth.
OF_STATED, FAR_BELOW_STATED = "scatter_of_stated", 0.1
# In a record's `figures`: what the error's x, y and z are off by between the places that were measured, where it is
# more than chance, and how many places tell.
BETWEEN_PLACES, PLACES_LEFT_OUT = tuple(f"between_places_{axis}_um" for axis in "xyz"), "places_left_out"
# Points that fit more closely than this share fit exactly, as far as anybody needs to know.
_LEAST_OF_STATED = 1e-6
# Figures that a report shows as numbers, in its order: name in the record, name on paper.
FIGURES = {
    "rmse_um": "residual, rms",
    "radial_rms_um": "residual of radii, rms",
    "held_out_rmse_um": "residual of passes held out, rms",
    "expected_held_out_rmse_um": "the same for a right model",
    "noise_floor_um": "noise floor (what repeats scatter)",
    "within_pass_floor_um": "noise floor within a pass",
    "noise_um": "noise (repeats, or as stated)",
}
# Figures that stand in the sentences, or count rows and degrees of freedom.
_IN_SENTENCES = frozenset(
    {
        "lack_of_fit_um",
        "lack_of_fit_p",
        "lack_of_fit_dof",
        "held_out_not_computable",
        "n",
        "n_radial",
        "dof",
        "components_per_row",
        *BETWEEN_PLACES,
        PLACES_LEFT_OUT,
    }
)


NOT_SETTLED = "the fit has not settled: its numbers are not to be used"
# What to do about it.
SETTLE = (
    "look for a mistyped row, which fit and compare name, leave out the effect that runs away, or measure what would "
    "hold it; then fit again"
)


# Of a record's `noise`: 1 where standard uncertainties count what rows share, and so no factor alone.
COUNTS_SHARED = "counts_shared"
SHARED_WORDS = "rows share offsets of their passes or a drift: standard uncertainties count that"


def other_figures(figures: Mapping[str, float]) -> list[str]:
    """Name the figures that have neither a name on paper nor a sentence."""
    return [name for name in figures if name not in FIGURES and name not in _IN_SENTENCES]


def fit_sentences(figures: Mapping[str, float], noise: Mapping[str, float]) -> Iterator[str]:
    """Say whether the model lacks anything, what its uncertainties are made of, and what could not be predicted."""
    p_value = figures.get("lack_of_fit_p", math.nan)
    beyond_um = figures.get("lack_of_fit_um", math.nan)
    if "lack_of_fit_p" in figures:
        yield lack_of_fit_words(p_value, beyond_um, math.isfinite(figures.get("noise_floor_um", math.nan)))
    scale, scatter_um = noise.get("scale", math.nan), noise.get("scatter_um", math.nan)
    if noise.get(COUNTS_SHARED, 0.0) > 0.0:
        yield SHARED_WORDS
    elif scale > 1.0:
        yield (
            f"the points scatter {scale:.2f} times as far as stated: standard uncertainties are larger by that factor"
        )
    elif OF_STATED in noise:
        yield far_below_stated_words(noise[OF_STATED])
    elif math.isfinite(scale):
        yield "the points scatter as stated or less: standard uncertainties follow from the stated ones"
    elif math.isfinite(scatter_um):
        yield (
            f"no uncertainty is stated; a measured component scatters {scatter_um:.3g} µm about the model, and "
            "standard uncertainties follow from that"
        )
    if noise.get("calibration_unknowns", 0.0) > 0.0:
        yield "the calibration of the measuring device is part of every standard uncertainty"
    lost = figures.get("held_out_not_computable", 0.0)
    if lost > 0.0:
        yield f"{lost:.0f} rows cannot be predicted with their pass held out: the other passes do not determine them"
    between_um = math.hypot(*(figures.get(name, 0.0) for name in BETWEEN_PLACES))
    if between_um > 0.0:
        yield (
            f"between the places that were measured the model may be off by another {between_um:.2g} µm rms, which "
            "is in no standard uncertainty of its numbers: measure at places in between"
        )


def far_below_stated_words(share: float) -> str:
    """Say that points scatter a small share of what is stated, and ask for the unit."""
    factor = f"{1.0 / max(share, _LEAST_OF_STATED):,.0f}"
    if share < _LEAST_OF_STATED:
        factor = f"more than {factor}"
    return (
        f"the points scatter {factor} times less than stated: are sx, sy and sz in mm, and a covariance in mm²? "
        "standard uncertainties follow from what is stated"
    )


def noise_words(p_value: float, what: str) -> str:
    """Say that a residual is no more than what explains it, or that chance seldom leaves as much."""
    if p_value >= _SELDOM:
        return f"what is left is {what}, as far as can be told ({p_words(p_value)})"
    return f"what is left may be more than {what}: chance leaves as much in one case of {1.0 / p_value:.0f}"


def lack_of_fit_words(p_value: float, beyond_um: float, is_from_repeats: bool) -> str:
    """Say whether the residual is noise; NaN where it cannot be told."""
    if math.isnan(p_value):
        return (
            "whether the model lacks anything cannot be told: nothing was measured twice under the same conditions, "
            "no uncertainty is stated"
        )
    if p_value >= _SIGNIFICANCE:
        return noise_words(p_value, "noise")
    against = "repeats scatter" if is_from_repeats else "the stated uncertainties allow"
    size = f", by {beyond_um:.2g} µm rms" if beyond_um > 0.0 else ""
    return f"the model lacks something: the residual is more than {against}{size} ({p_words(p_value)})"
