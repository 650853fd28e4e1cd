"""The uncertainty budget: from the pictures to the error at any place of the volume, and to a compensated part."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from geoerr.budget.columns import Predictor, owners_of
from geoerr.budget.combine import effective_dof, expanded, expanded_length
from geoerr.budget.estimator import Estimator
from geoerr.budget.implementation import Implementation
from geoerr.budget.places import grid_axes_mm, grid_of, outside_measured, stated_places, volume_mm
from geoerr.budget.source import Source
from geoerr.budget.sources import (
    Stage,
    conditions_of,
    sources_of_fit,
    sources_of_record,
    stages_of,
    stages_of_parameters,
)
from geoerr.drawing import drawn
from geoerr.errors import NotDeterminedError, ShapeError
from geoerr.fit import FitResult, Fitted
from geoerr.machine import AXES
from geoerr.model import GROUPS, Model
from geoerr.model.arrays import Numbers, points
from geoerr.model.called import check_model
from geoerr.model.conditions import Conditions
from geoerr.model.fit_words import NOT_SETTLED
from geoerr.model.in_model import is_about_the_model, not_in_model_words
from geoerr.model.program_conditions import extrapolated_conditions
from geoerr.summaries import facts_html, number_text, summary_html, table_html
from geoerr.terms import Term
from geoerr.vision.rig import Rig

if TYPE_CHECKING:
    import plotly.graph_objects as go

Quantity = Literal["prediction", "part"]
_UM_PER_MM = 1e3
# Places along each edge of the grid in which the worst place is looked for.
_SEARCHED = 9
# A variance below that of a picometre is rounding: at the first point of the range the error is 0 by convention.
_NOTHING_MM2 = 1e-18
_NOTHING_UM = 1e-6
_ALWAYS_SILENT = (
    "where the work is clamped: the error counts from the first point of the range, up to the work's rigid set-up",
    "what stayed the same in all the data: air, lenses beyond their model, targets that are not flat, wear",
    "lever arms: a target glued on 0.1 mm off changes an angle by a share 0.1 mm / lever, second order",
)


@dataclass(frozen=True, eq=False)
class Contribution:
    """What a source, or a part of one, contributes at the places of a budget.

    Attributes
    ----------
    name
        Of the source or part.
    std_um
        (n,) alone: the root of its own variance, the length of all three components.
    share
        (n,) of the variance of the whole, with half of every correlation; negative where it offsets others.
    """

    name: str
    std_um: Numbers
    share: Numbers


@dataclass(frozen=True, eq=False)
class Budget:
    """How uncertain the error at some places is, and why; made by `uncertainty_budget`.

    The **prediction** is the error that the model predicts; the **part** is what is left of it in a part made with
    compensation: the prediction's uncertainty, what the machine does not repeat, and what carrying out a correction
    leaves. Sources are independent of each other; within a source correlations are whole (the calibration is one
    error for all points and for all places).

    Attributes
    ----------
    model
        The fitted model.
    place_names, q_mm
        The places, (n, 3).
    is_determined
        (n, 3) whether the data determine x, y, z of the error there, and the model has what these are about; numbers
        are NaN where not, and those of the length where one of the three is not.
    sources
        Each once.
    stages
        What is uncertain before the prediction: corner, point, parameters.
    not_counted_anywhere
        Sentences: what is in none of the numbers, at any place.
    """

    model: Model
    place_names: tuple[str, ...]
    q_mm: Numbers
    is_determined: npt.NDArray[np.bool_]
    sources: tuple[Source, ...]
    stages: tuple[Stage, ...]
    not_counted_anywhere: tuple[str, ...]
    predictor: Predictor
    estimator: Estimator | None
    rig: Rig | None
    roots_mm: tuple[Numbers, ...]

    @property
    def not_counted(self) -> tuple[str, ...]:
        """Sentences: what is in none of the numbers, at these places and at any."""
        absent = self.model.not_in_model
        told = (not_in_model_words(absent),) if absent else ()
        if not self.has_settled:
            told = (NOT_SETTLED, *told)
        return (*told, *outside_measured(self.model, self.place_names, self.q_mm), *self.not_counted_anywhere)

    @property
    def has_settled(self) -> bool:
        """Tell whether the fit of the model came to rest: without that no number here means anything."""
        return self.model.record is None or self.model.record.has_settled

    @property
    def is_in_model(self) -> npt.NDArray[np.bool_]:
        """Tell for x, y, z at the places (n, 3) whether the model has the errors that this component is about."""
        return self._in_model(self.q_mm)

    def _in_model(self, q_mm: Numbers) -> npt.NDArray[np.bool_]:
        absent = self.model.not_in_model
        if not absent:
            return np.ones(q_mm.shape, dtype=np.bool_)
        stood, (low, _) = self.model.stood_mm, volume_mm(self.model)
        from_mm = np.array([stood.get(axis, first) for axis, first in zip(AXES, low.tolist(), strict=True)])
        return is_about_the_model(absent, q_mm, from_mm)

    def at_places(self, q_mm: npt.ArrayLike, names: Sequence[str] | None = None) -> Budget:
        """Give the same budget at other places (n, 3)."""
        places = points(q_mm, "q_mm")
        if names is not None and len(names) != len(places):
            raise ShapeError(f"{len(names)} names are given for {len(places)} places")
        return replace(
            self,
            place_names=tuple(names or (f"({x:g}, {y:g}, {z:g})" for x, y, z in places)),
            q_mm=places,
            is_determined=self._in_model(places)
            & self.model.is_determined_at(places, self.predictor.offset_mm, at=self.predictor.at),
            roots_mm=_roots(self.sources, self.predictor, places),
        )

    def chosen(self, of: Quantity) -> list[tuple[Source, Numbers]]:
        """Give the sources of the prediction or of the part, with their roots (n, 3, k) in mm."""
        pairs = zip(self.sources, self.roots_mm, strict=True)
        return [(source, root) for source, root in pairs if of == "part" or not source.is_of_part]

    def covariance_mm2(self, of: Quantity = "prediction") -> Numbers:
        """Give the covariance of the error, (n, 3, 3); NaN where it is not determined."""
        total = np.zeros((len(self.q_mm), 3, 3))
        for _, root in self.chosen(of):
            total += root @ root.transpose(0, 2, 1)
        is_open = ~self.is_determined
        total[is_open[:, :, None] | is_open[:, None, :]] = math.nan
        return total

    def standard_um(self, of: Quantity = "prediction") -> Numbers:
        """Give the combined standard uncertainty of x, y, z, (n, 3)."""
        return np.sqrt(np.diagonal(self.covariance_mm2(of), axis1=1, axis2=2)) * _UM_PER_MM

    def standard_length_um(self, of: Quantity = "prediction") -> Numbers:
        """Give the root of the sum of the three variances, (n,)."""
        return np.asarray(np.sqrt(np.trace(self.covariance_mm2(of), axis1=1, axis2=2)) * _UM_PER_MM)

    def dof(self, of: Quantity = "prediction") -> Numbers:
        """Give the effective degrees of freedom of x, y, z and of the length, (n, 4)."""
        chosen = self.chosen(of)
        variances = [(root**2).sum(axis=2) for _, root in chosen]
        with_length = [np.column_stack([v, v.sum(axis=1)]) for v in variances]
        dof = effective_dof(with_length, [source.dof for source, _ in chosen])
        return np.column_stack([np.where(self.is_determined, dof[:, :3], math.nan), self._known(dof[:, 3])])

    def expanded_um(self, of: Quantity = "prediction") -> Numbers:
        """Give U = k·u of x, y, z at 95 %, (n, 3)."""
        return expanded(self.standard_um(of), self.dof(of)[:, :3])

    def expanded_length_um(self, of: Quantity = "prediction") -> Numbers:
        """Give the length (n,) that the error of the statement stays below with 95 %."""
        return expanded_length(self.covariance_mm2(of), self.dof(of)[:, 3]) * _UM_PER_MM

    def contributions(self, of: Quantity = "part") -> list[Contribution]:
        """Give one contribution a source; their shares add up to 1."""
        total = np.trace(self.covariance_mm2(of), axis1=1, axis2=2)
        found = []
        for source, root in self.chosen(of):
            own = self._known((root**2).sum(axis=(1, 2)))
            found.append(Contribution(source.name, np.sqrt(own) * _UM_PER_MM, _share(own, total)))
        return found

    def pieces(self, source_name: str) -> list[Contribution]:
        """Give the parts of a source; their shares of its variance, with correlations, add up to 1."""
        source = next(source for source in self.sources if source.name == source_name)
        if not source.pieces:
            return []
        by_parameter = self.predictor.by_parameter(self.q_mm)
        whole = by_parameter @ np.sum([piece.by_parameter for piece in source.pieces.values()], axis=0)
        parts = {name: by_parameter @ piece.by_parameter for name, piece in source.pieces.items()}
        return self._parts(parts, whole)

    def parameter_groups(self) -> list[Contribution]:
        """Give the way of all data through the parameters, by groups: positioning, ..., each effect.

        The same variance as that of the sources that act through parameters, divided another way; shares of it add up
        to 1, and are negative where groups offset each other (a slope of an angle, and of a squareness).
        """
        roots = [source.by_parameter for source in self.sources if source.by_parameter is not None]
        root = np.concatenate([np.zeros((self.predictor.n_parameters, 0)), *roots], axis=1)
        by_parameter = self.predictor.by_parameter(self.q_mm)
        group = np.array([group_of(term) for term in owners_of(self.model.terms)])
        names = list(dict.fromkeys(group_of(term) for term in self.model.terms if not term.is_rig))
        parts = {name: by_parameter[:, :, group == name] @ root[group == name] for name in names}
        return self._parts(parts, by_parameter @ root)

    def worst(self, of: Quantity = "prediction") -> tuple[Numbers, float]:
        """Give the place (3,) of a grid over the volume with the largest standard uncertainty (length), and it in µm.

        An axis that never moved in the data stays where it stood: elsewhere nothing is known of it.

        Raises
        ------
        NotDeterminedError
            where the error, or one of its components, is determined nowhere but where it is 0 by convention: at the
            first point, and of a straightness at both ends.
        """
        axes = zip(AXES, grid_axes_mm(self.model, _SEARCHED), strict=True)
        stood = self.model.stood_mm
        x_mm, y_mm, z_mm = (np.array([stood[axis]]) if axis in stood else along for axis, along in axes)
        places = grid_of(x_mm, y_mm, z_mm)
        there = self.at_places(places)
        by_component = there.standard_um(of)
        is_known = np.isfinite(by_component)
        is_measured = (is_known & (by_component > _NOTHING_UM)).any(axis=0) | is_known.all(axis=0)
        std_um = there.standard_length_um(of)
        if not (is_measured.all() and np.isfinite(std_um).any()):
            raise NotDeterminedError("the data determine the error at no place of the volume")
        number = int(np.nanargmax(std_um))
        return places[number], float(std_um[number])

    def plot_volume(self, n: int = 11) -> go.Figure:
        """Draw error and uncertainty over the volume, on a grid of so many places along each edge."""
        return drawn("budget_slices", self, n)

    def _repr_html_(self) -> str:
        """Show how sure each place is, and the sources, for a notebook."""
        places = [
            (name, ", ".join(f"{value:g}" for value in place), number_text(known), number_text(part))
            for name, place, known, part in zip(
                self.place_names,
                self.q_mm.tolist(),
                self.expanded_length_um("prediction").tolist(),
                self.expanded_length_um("part").tolist(),
                strict=True,
            )
        ]
        return summary_html(
            "Uncertainty budget, 95 %",
            facts_html({"model": self.model.machine.name}),
            table_html(("place", "x, y, z, mm", "predicted error below, µm", "compensated part below, µm"), places),
            table_html(("source", "what", "type"), [(one.name, one.what, one.kind) for one in self.sources]),
        )

    def to_document(self) -> dict[str, Any]:
        """Give everything as plain values, for `--json`; µm, a place a row, null where it is not determined."""
        places: list[dict[str, Any]] = []
        groups = self.parameter_groups()
        columns = {of: self.contributions(of) for of in ("prediction", "part")}
        numbers = {
            of: (
                self.standard_um(of),
                self.standard_length_um(of),
                self.dof(of),
                self.expanded_um(of),
                self.expanded_length_um(of),
            )
            for of in ("prediction", "part")
        }
        for row, name in enumerate(self.place_names):
            entry: dict[str, Any] = {"name": name, **dict(zip("xyz", self.q_mm[row].tolist(), strict=True))}
            for of, (std, length, dof, wide, wide_length) in numbers.items():
                entry[of] = {
                    "std_um": _plain(std[row]),
                    "std_length_um": _plain(length[row]),
                    "dof": _plain(dof[row]),
                    "expanded_um": _plain(wide[row]),
                    "expanded_length_um": _plain(wide_length[row]),
                    "contributions": _documents(columns[of], row),
                }
            entry["parameter_groups"] = _documents(groups, row)
            places.append(entry)
        return {
            "probability": 0.95,
            "stages": [
                {"stage": stage.name, "what": stage.what, "std": _plain(stage.std), "unit": stage.unit}
                for stage in self.stages
            ],
            "sources": [
                {
                    "name": source.name,
                    "what": source.what,
                    "type": source.kind,
                    "distribution": source.distribution,
                    "std": _plain(source.std),
                    "unit": source.unit,
                    "dof": _plain(source.dof),
                    "part_only": source.is_of_part,
                }
                for source in self.sources
            ],
            "places": places,
            "not_counted": list(self.not_counted),
        }

    def _parts(self, parts: Mapping[str, Numbers], whole: Numbers) -> list[Contribution]:
        total = self._known((whole**2).sum(axis=(1, 2)))
        return [
            Contribution(
                name,
                np.sqrt(self._known((root**2).sum(axis=(1, 2)))) * _UM_PER_MM,
                _share(self._known((root * whole).sum(axis=(1, 2))), total),
            )
            for name, root in parts.items()
        ]

    def _known(self, values: Numbers) -> Numbers:
        """Give numbers of a length (n,), NaN where one of its components is not determined."""
        return np.where(self.is_determined.all(axis=1), values, math.nan)


def uncertainty_budget(
    fit: FitResult | Fitted | Model,
    q_mm: npt.ArrayLike | Mapping[str, npt.ArrayLike] | None = None,
    *,
    offset_mm: npt.ArrayLike | None = None,
    at: Conditions | None = None,
    at_std: Mapping[str, float] | None = None,
    rig: Rig | None = None,
    calibration_dof: float = math.inf,
    implementation: Implementation | None = None,
) -> Budget:
    """Make the uncertainty budget of a fitted model.

    Parameters
    ----------
    fit
        A fit; or a model that was read from a file, whose record holds no more than the parameters' covariance and
        the fit's figures: noise and calibration are then one source, misfit and degrees of freedom are what the file
        states, and repeatability is not known.
    q_mm : (n, 3)
        Places, or places by name; None: corners, centre and the worst place of the volume,
        if the data determine all of the error somewhere.
    offset_mm : (3,)
        From the machine's tool point to the point that is meant.
    at, at_std
        Conditions of the prediction, and their standard uncertainties (type B): `at={"temp": 90.0}`,
        `at_std={"temp": 1.0}`.
    rig
        The camera pair that the points were measured with, with its covariance: the calibration's part is divided by
        groups, and stated even where the fit was not told of it.
    calibration_dof
        Degrees of freedom of the rig's covariance.
    implementation
        How corrections are carried out; the defaults are those of `geoerr compensate`.

    Raises
    ------
    NotDeterminedError
        where the model has no record of a fit.
    GeoerrError
        for conditions that are needed and not given, or uncertain and not given.
    ShapeError
        for places that are not (n, 3).

    Notes
    -----
    GUM (JCGM 100): propagation with correlations (5.2), Welch and Satterthwaite's degrees of freedom (G.4), U = k·u
    with k from Student's t. Where the scatter exceeds what is stated, its excess is a source of its own and does not
    enlarge the calibration's part, as `FitRecord.covariance` does. Verified in tests/budget by Monte-Carlo, and by
    `validation/budget.py` against true errors.
    """
    fitted = fit.fitted if isinstance(fit, FitResult) else fit if isinstance(fit, Fitted) else None
    model = _model_of(fit)
    check_model(model, (), "uncertainty_budget(model)")
    if model.record is None:
        raise NotDeterminedError(
            "the model has no covariance of its parameters to propagate: it was not fitted here\n"
            "hint: fit it to measurements with `geoerr fit`"
        )
    predictor = Predictor(model, offset_mm, at)
    if fitted is None:
        estimator, stages = None, []
        sources, silent = sources_of_record(model.record)
    else:
        estimator = Estimator(fitted)
        sources, silent = sources_of_fit(fitted, estimator, rig, calibration_dof)
        stages = stages_of(fitted, rig)
    stages += stages_of_parameters(model, predictor.at)
    silent += [f"{one}: whether its form holds there" for one in extrapolated_conditions(model, at)]
    how = implementation or Implementation()
    sources += [*conditions_of(at_std or {}), *how.sources()]
    if how.controller_step_mm is None:
        silent.append("the controller's step: not stated")
    budget = Budget(
        model,
        (),
        np.empty((0, 3)),
        np.empty((0, 3), dtype=np.bool_),
        tuple(sources),
        tuple(stages),
        (*silent, *_ALWAYS_SILENT),
        predictor,
        estimator,
        rig,
        (),
    )
    if q_mm is None:
        budget = budget.at_places(np.empty((0, 3)))
        return _at_usual_places(budget)
    if isinstance(q_mm, Mapping):
        return budget.at_places(np.array([np.asarray(place) for place in q_mm.values()]), list(q_mm))
    return budget.at_places(q_mm)


def _at_usual_places(budget: Budget) -> Budget:
    """Give it at the corners, the centre and the worst place, if there is one."""
    places = stated_places(budget.model)
    try:
        places["worst"] = budget.worst()[0]
    except NotDeterminedError:
        there = budget.at_places(np.array(list(places.values())), list(places))
        if there.is_in_model.any() and not there.is_determined.any():
            raise
        return there
    return budget.at_places(np.array(list(places.values())), list(places))


def group_of(term: Term) -> str:
    """Name the group of a term: that of a classic error, the id of another."""
    if term.kind != "classic":
        return term.id
    names = ("positioning", "straightness", "pitch-yaw", "roll")
    return next((name for name in names if term.id in GROUPS[name]), "squareness")


def _model_of(fit: FitResult | Fitted | Model) -> Model:
    if isinstance(fit, Fitted):
        from geoerr.fit import result_of

        return result_of(fit).model
    return fit.model if isinstance(fit, FitResult) else fit


def _roots(sources: Sequence[Source], predictor: Predictor, q_mm: Numbers) -> tuple[Numbers, ...]:
    by_parameter = predictor.by_parameter(q_mm)
    return tuple(source.root_mm(predictor, q_mm, by_parameter) for source in sources)


def _share(own: Numbers, total: Numbers) -> Numbers:
    share: Numbers = np.divide(own, total, out=np.full(len(total), math.nan), where=total > _NOTHING_MM2)
    return share


def _documents(contributions: Sequence[Contribution], row: int) -> list[dict[str, Any]]:
    return [
        {"name": one.name, "std_um": _plain(one.std_um[row]), "share": _plain(one.share[row])}
        for one in contributions
    ]


def _plain(value: Any) -> Any:
    """Give plain numbers; null for what is not finite."""
    if np.ndim(value):
        return [_plain(one) for one in value]
    return float(value) if math.isfinite(value) else None
