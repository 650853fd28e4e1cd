"""The joint estimate: the 21 errors from all lines, components, repeats and covariances at once, as tables.

Nothing is asked of the order of the lines or of what they cross: any motion that the rank analysis finds sufficient
will do. The freedom of each function is chosen by the data (`geoerr.fit.knots`), so that neighbours help each other;
this is what makes it more certain than the nine lines' arithmetic.

Tangent-following (Li Eq. 19) is an option and is tested: in the fit that does not assume it, straightness and the
integral of the angle are both linear in the coefficients, and so is their difference, with its covariance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from geoerr.arguments import check_choice
from geoerr.bases import basis_of
from geoerr.error_functions import ErrorFunctions, NotDetermined
from geoerr.fit import FitOptions, FitResult, fit_model
from geoerr.fit.classic import TANGENT, is_straightness, positions_by_axis
from geoerr.fit.sightings import SAME_POSITION_MM
from geoerr.identify.axis import angle_name, delta_name
from geoerr.identify.between_places import integral_covariance, without_line
from geoerr.identify.linear import Numbers
from geoerr.identify.nine_line import StraightnessMethod
from geoerr.identify.squareness import PAIRS
from geoerr.identify.straightness import TangentVerdict, judged
from geoerr.machine import AXES, Machine
from geoerr.model.called import check_machine, check_tables, one_or_several
from geoerr.model.fit_words import SHARED_WORDS
from geoerr.observations import CircularTest, Lengths, MeasuredTable, Observations

# Tables have no more entries than this: where an axis stood at more places, they are spread evenly over them.
_MOST_ENTRIES = 101
# Places of an axis that tell a line from what bends about it.
_FEWEST_OF_A_LINE = 3
# A squareness that is another by so many of its standard errors is told.
_OTHER_SQUARENESS = 0.5


@dataclass(frozen=True, eq=False)
class JointResult:
    """The 21 errors of the joint fit.

    Attributes
    ----------
    errors
        Tables at the measured positions.
    result
        The fit with the straightness that `errors` holds.
    tangent
        Direct against integrated straightness, one verdict a function that has both.
    """

    errors: ErrorFunctions
    result: FitResult
    tangent: tuple[TangentVerdict, ...]

    def to_document(self) -> dict[str, Any]:
        """Give the diagnostics as plain values, for `--json`; lengths in µm."""
        return {
            "fit": self.result.to_document(),
            "straightness": [
                {
                    "name": verdict.name,
                    "rms_um": verdict.rms_mm * 1e3,
                    "p_value": verdict.p_value,
                    "follows_tangent": verdict.follows,
                }
                for verdict in self.tangent
            ],
        }


def identify_joint(
    observations: MeasuredTable | Sequence[MeasuredTable],
    machine: Machine,
    *,
    straightness: StraightnessMethod = "direct",
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    threads: int = 0,
) -> JointResult:
    """Find the 21 errors by fitting all observations at once.

    Parameters
    ----------
    observations
        Measured points of any motions; repeats, partial components and several sessions are welcome. Circular tests
        and lengths tell some of the errors, beside points or alone.
    machine
        The machine.
    straightness
        `direct`: functions of its own. `integrated`: the integral of the angle (tangent-following). The other is in
        `errors.alternatives`.
    rig_sensitivity, rig_covariance
        As for `analyze_nine_lines`.

    Raises
    ------
    GeometryError
        where nothing can be fitted.

    Notes
    -----
    `docs/theory/model.md`, "The joint estimate". Verified in tests/identify/test_joint.py and, against the nine
    lines' arithmetic and for coverage, by `validation/joint.py`.
    """
    check_choice("straightness", straightness, get_args(StraightnessMethod))
    tables = one_or_several(observations)
    check_machine(machine, tables, "identify_joint(observations, machine)")
    check_tables(tables, "identify_joint(observations, machine)", Observations, CircularTest, Lengths)
    fits = {
        method: fit_model(
            machine,
            *tables,
            options=FitOptions(follows_tangent=method == "integrated", freedom="smooth", threads=threads),
            rig_sensitivity=rig_sensitivity,
            rig_covariance=rig_covariance,
        )
        for method in ("direct", "integrated")
    }
    chosen = fits[straightness]
    record = chosen.model.record
    assert record is not None
    other_name = "integrated" if straightness == "direct" else "direct"
    positions = _positions(chosen)
    errors = _without_chords(chosen.model.error_functions(positions))
    alternative = _without_chords(fits[other_name].model.error_functions(positions))
    crossing = {straight for straight, _ in TANGENT.values()}
    reasons = _all_reasons(chosen, errors)
    known = errors.functions.keys() & alternative.functions.keys()
    verdicts = tuple(one for one in _verdicts(fits["direct"], machine) if one.name in known)
    errors = replace(
        errors,
        method="joint",
        alternatives={
            f"straightness-{other_name}": {
                name: function for name, function in alternative.functions.items() if name in crossing
            }
        },
        not_determined=reasons,
        notes=(*errors.notes, *_notes(chosen, verdicts, straightness), *_too_few_entries(errors, chosen)),
        data_digest=record.data_digest,
    )
    return JointResult(errors, chosen, verdicts)


def _positions(result: FitResult) -> dict[str, Numbers]:
    places = positions_by_axis(result.fitted.sightings.commanded_mm, SAME_POSITION_MM)
    chosen = {}
    for axis in AXES:
        found = places[axis]
        if len(found) < 2:
            continue
        if len(found) > _MOST_ENTRIES:
            found = np.linspace(float(found[0]), float(found[-1]), _MOST_ENTRIES)
        chosen[axis] = np.ascontiguousarray(found)
    return chosen


def _without_chords(errors: ErrorFunctions) -> ErrorFunctions:
    """Take out the straightness of axes that stood at two places, and the directions that rest on it.

    Through two places runs a chord: no straightness is left beside it, which is not one of 0 ± 0, and its direction
    is not that of a line through the whole of the axis.
    """
    chords = {
        name: NotDetermined(name, f"fewer than three positions on {name[2]} were measured")
        for name, function in errors.functions.items()
        if is_straightness(name) and len(function.position_mm) < _FEWEST_OF_A_LINE
    }
    for name, (first, second) in PAIRS.items():
        lines = {delta_name(AXES.index(second), first), delta_name(AXES.index(first), second)}
        if name in errors.squareness and lines & chords.keys():
            axes = f"{first.upper()} and {second.upper()}"
            chords[name] = NotDetermined(name, f"of {axes} the direction of a chord is known, not that of the axis")
    return replace(
        errors,
        functions={name: table for name, table in errors.functions.items() if name not in chords},
        squareness={name: value for name, value in errors.squareness.items() if name not in chords},
        not_determined=(*errors.not_determined, *chords.values()),
    )


def _all_reasons(result: FitResult, errors: ErrorFunctions) -> tuple[NotDetermined, ...]:
    """Join the reasons of the fit with those of the tables, each name once."""
    reasons = {item.name: item for item in (*errors.not_determined, *result.fitted.not_determined)}
    return tuple(reasons[name] for name in sorted(reasons))


def _verdicts(result: FitResult, machine: Machine) -> tuple[TangentVerdict, ...]:
    terms = result.fitted.terms
    spans, first = {}, 0
    for term in terms:
        spans[term.id] = slice(first, first + len(term.coefficients))
        first += len(term.coefficients)
    unknown = {item.name for item in result.fitted.not_determined}
    by_id = {term.id: term for term in terms}
    determined = by_id.keys() - unknown
    pairs = [(angle, *other) for angle, other in TANGENT.items() if {angle, other[0]} <= determined]
    positions = _positions(result)
    between = {}
    for axis in dict.fromkeys(angle[2].lower() for angle, _, _ in pairs):
        names = [name for name in (angle_name(direction, axis) for direction in range(3)) if name in determined]
        between[axis] = _between(result, by_id, spans, names, positions[axis])
    return tuple(
        _verdict(result, machine, by_id, spans, positions, between, angle, straight, sign)
        for angle, straight, sign in pairs
    )


def _verdict(
    result: FitResult,
    machine: Machine,
    by_id: Mapping[str, Any],
    spans: Mapping[str, slice],
    positions: Mapping[str, Numbers],
    between_mm2: Mapping[str, Numbers],
    angle: str,
    straight: str,
    sign: float,
) -> TangentVerdict:
    """Test `straightness − ∫ angle` at the measured positions against its covariance, and what lies between them."""
    axis = angle[2].lower()
    side = 1.0 if machine.side(axis) == "tool" else -1.0
    places = positions[axis]
    spec, angle_spec = by_id[straight].parts[0].basis, by_id[angle].parts[0].basis
    direct = basis_of(spec).evaluate(places)
    integral = side * sign * basis_of(replace(angle_spec, is_tangent_integral=True)).evaluate(places)
    design = without_line(places) @ np.hstack([direct, -integral])
    own = np.r_[spans[straight], spans[angle]]
    values = np.array([p.value for p in (*by_id[straight].coefficients, *by_id[angle].coefficients)])
    covariance = design @ result.fitted.covariance[np.ix_(own, own)] @ design.T
    return judged(straight, design @ values, covariance + between_mm2[axis])


def _between(
    result: FitResult, by_id: Mapping[str, Any], spans: Mapping[str, slice], names: Sequence[str], places: Numbers
) -> Numbers:
    angles, covariances = [], []
    for name in names:
        design = basis_of(by_id[name].parts[0].basis).evaluate(places)
        angles.append(design @ np.array([p.value for p in by_id[name].coefficients]))
        covariances.append(design @ result.fitted.covariance[spans[name], spans[name]] @ design.T)
    return integral_covariance(places, angles, covariances)


def _too_few_entries(errors: ErrorFunctions, result: FitResult) -> Iterator[str]:
    """Name the squareness that is another beside polygons through so few entries than beside the fitted curves."""
    closely = result.model.error_functions().squareness
    shifts = {
        name: abs(value.value_rad - closely[name].value_rad) / value.std_rad
        for name, value in errors.squareness.items()
        if name in closely and value.std_rad
    }
    name = max(shifts, key=lambda one: shifts[one], default=None)
    if name is not None and shifts[name] > _OTHER_SQUARENESS:
        yield (
            f"with so few places of an axis the polygon through them is not the curve that was fitted: {name} is "
            f"{1e6 * errors.squareness[name].value_rad:.1f} µrad beside the polygons of this table, "
            f"{1e6 * closely[name].value_rad:.1f} beside the curves (`geoerr fit`), and straightness is turned by "
            "the difference; errors at the places themselves are the same. Measure more places"
        )


def _notes(
    result: FitResult, verdicts: Sequence[TangentVerdict], straightness: StraightnessMethod
) -> tuple[str, ...]:
    fitted = result.fitted
    notes = list(fitted.sightings.notes)
    broken = [verdict.name for verdict in verdicts if verdict.follows is False]
    if broken and straightness == "integrated":
        notes.append(
            f"the carriage does not follow its guideway's tangent: {', '.join(broken)} differ from the integral of "
            "the angle beyond chance; direct straightness is the one to use"
        )
    if fitted.outliers:
        rows = ", ".join(str(outlier.row + 1) for outlier in fitted.outliers[:8])
        notes.append(f"{len(fitted.outliers)} gross outliers were left out: rows {rows}")
    if fitted.shared_noise is not None:
        notes.append(SHARED_WORDS)
    elif fitted.sightings.is_stated and fitted.scale > 1.0:
        notes.append(
            f"the scatter is {fitted.scale:.2f} times what the stated uncertainties say: standard uncertainties are "
            "multiplied by that"
        )
    return tuple(notes)
