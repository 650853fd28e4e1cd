"""Terms: what moves a point, as data. One term is one row of "the one model" and stands alone in a model file.

A term displaces points on one or more **channels** (places of the kinematic chain, or of the measuring rig), by an
expression or by the functions of a basis, with linear coefficients θ and a few inner parameters φ:

    p_measured − p_nominal = Σ_terms Σ_parts J_channel(q, l) · factor · f(q, covariates; θ, φ) + noise

Values are plain (texts, numbers, tuples): a term can be compared, pickled, written to JSON and read back without
loss, and nothing in it is ever executed. Documents from untrusted places are checked key by key.
"""

from geoerr.terms.basis_spec import BasisKind, BasisSpec
from geoerr.terms.entries import MAX_ITEMS, MAX_TEXT
from geoerr.terms.names import (
    CHANNELS,
    CLOCK_NAME,
    CONSTANTS,
    EMPIRICAL,
    FUNCTIONS,
    HISTORY_NAMES,
    JOINT_CHANNELS,
    PLACE_NAMES,
    RAW_VARIABLES,
    RIG_CHANNELS,
    SESSION_NAME,
    SQUARENESS_CHANNELS,
    has_span,
    is_column,
    is_effect_id,
    is_motion,
    is_name,
    is_rig_channel,
    mentions,
    names_in,
)
from geoerr.terms.parameter import SIGNS, Parameter, Plausible, UsualSpan
from geoerr.terms.reference import REFERENCE_AXES, EffectReference, parse_effect_reference
from geoerr.terms.session_numbers import session_numbers
from geoerr.terms.term import Part, Term, TermSource

__all__ = [
    "CHANNELS",
    "CLOCK_NAME",
    "CONSTANTS",
    "EMPIRICAL",
    "FUNCTIONS",
    "HISTORY_NAMES",
    "JOINT_CHANNELS",
    "MAX_ITEMS",
    "MAX_TEXT",
    "PLACE_NAMES",
    "RAW_VARIABLES",
    "REFERENCE_AXES",
    "RIG_CHANNELS",
    "SESSION_NAME",
    "SIGNS",
    "SQUARENESS_CHANNELS",
    "BasisKind",
    "BasisSpec",
    "EffectReference",
    "Parameter",
    "Part",
    "Plausible",
    "Term",
    "TermSource",
    "UsualSpan",
    "has_span",
    "is_column",
    "is_effect_id",
    "is_motion",
    "is_name",
    "is_rig_channel",
    "mentions",
    "names_in",
    "parse_effect_reference",
    "session_numbers",
]
