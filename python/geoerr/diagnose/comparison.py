"""Any model held against any measurements: how far it is off, and where."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from geoerr.diagnose.components import Component, components_of
from geoerr.diagnose.document import document_of, worst_first
from geoerr.diagnose.lengths import LengthComparison, lengths_of
from geoerr.diagnose.own_uncertainty import OwnUncertainty, own_uncertainty
from geoerr.diagnose.parts import Part, by_carrier, by_direction, by_session, by_target, by_text
from geoerr.diagnose.regions import Region, regions_of
from geoerr.diagnose.set_up import SetUp, set_up_of
from geoerr.diagnose.spread_trends import SpreadTrend, spread_trends_of
from geoerr.diagnose.summary import comparison_html
from geoerr.diagnose.trends import Trend, trends_of
from geoerr.distributions import chi_squared_sf, f_sf, never_zero
from geoerr.drawing import drawn
from geoerr.errors import GeoerrError, ShapeError
from geoerr.fit import (
    Fitted,
    Sightings,
    complete_rows,
    digest_of,
    frames_only,
    has_covariates,
    own_freedom,
    sightings_of,
    within_the_machine,
)
from geoerr.fit.calibration import checked_calibration
from geoerr.fit.figures import ErrorFigures, figures_of
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import with_rows
from geoerr.model import Model
from geoerr.model.called import check_model, check_tables
from geoerr.model.conditions import Conditions
from geoerr.model.sessions import since_last_session
from geoerr.model.tables import terms_of_errors
from geoerr.observations import CircularTest, Lengths, MeasuredTable, Observations
from geoerr.terms import Term

if TYPE_CHECKING:
    import plotly.graph_objects as go

# `own`: these are the data that the model was fitted to, and its coefficients are fitted anew; `refit`: others, and
# they are fitted anew because that was asked for; `held`: others, and they stay as they are.
Freedom = Literal["own", "refit", "held"]

_OTHER_ROWS = "another model lacks a covariate"


@dataclass(frozen=True, eq=False)
class Comparison:
    """A model held against measurements; arrays are in the order of `fitted.sightings`.

    Attributes
    ----------
    model
        As it was given.
    freedom
        Whether its coefficients took part (`own`, `refit`) or only the measuring frames did (`held`).
    whole
        The fit behind the figures: residuals, frames, repeats, held-out passes.
    lengths
        Measured lengths and the model's; None where there are none.
    """

    model: Model
    freedom: Freedom
    whole: Fitted
    lengths: LengthComparison | None = None

    @property
    def fitted(self) -> Fitted | None:
        """The fit behind the figures of points and radii; None where there are measured lengths only."""
        return None if self.whole.sightings.has_lengths_only else self.whole

    @property
    def is_held(self) -> bool:
        """Whether the model's coefficients stayed as they were."""
        return self.freedom == "held"

    @property
    def points(self) -> Fitted:
        """The fit behind the figures of points and radii.

        Raises
        ------
        GeoerrError
            where there are measured lengths only.
        """
        fitted = self.fitted
        if fitted is None:
            raise GeoerrError("there are measured lengths only: these have no place, line or direction")
        return fitted

    @property
    def residual_mm(self) -> Numbers:
        """Measured minus predicted in base axes, (n, 3); a radius in the first component."""
        return self.points.residual_mm

    @property
    def figures(self) -> ErrorFigures:
        """How large the residuals are, over the rows that take part."""
        return self.points.figures

    @property
    def rmse_um(self) -> float:
        """The headline: of positions, or of radii, or of lengths, the first that there is."""
        headline = self.whole.figures.headline_um
        return math.nan if headline is None else headline

    @cached_property
    def components(self) -> tuple[Component, ...]:
        """Residuals component by component, NaN where there is none."""
        return components_of(self.points)

    @cached_property
    def by_line(self) -> tuple[Part, ...]:
        """Figures of each line of the plan."""
        return by_text(self.points, "line")

    @cached_property
    def by_session(self) -> tuple[Part, ...]:
        """Figures of each session and circular run."""
        return by_session(self.points)

    @cached_property
    def by_direction(self) -> tuple[Part, ...]:
        """Figures of each direction of approach."""
        return by_direction(self.points)

    @cached_property
    def by_carrier(self) -> tuple[Part, ...]:
        """Figures of each body that carries targets."""
        return by_carrier(self.points)

    @cached_property
    def by_target(self) -> tuple[Part, ...]:
        """Figures of each target; none where there are more than 64."""
        return by_target(self.points)

    @cached_property
    def regions(self) -> tuple[Region, ...]:
        """Mean, spread and count in 3 × 3 × 3 cells of the volume."""
        return regions_of(self.points)

    @cached_property
    def trends(self) -> tuple[Trend, ...]:
        """What the residual follows, the largest trend first, those over pixels behind all others."""
        return trends_of(self.points)

    @cached_property
    def spread_trends(self) -> tuple[SpreadTrend, ...]:
        """What the size of the residual follows about its means, the surest first, those over pixels behind."""
        return spread_trends_of(self.points)

    @cached_property
    def set_up(self) -> SetUp | None:
        """What of the disagreement is the measuring frame's; None for cameras and circles."""
        return set_up_of(self.points)

    @cached_property
    def worst(self) -> np.ndarray:
        """Rows from the worst on, (n,): by the length of the residual, of all that were measured."""
        return worst_first(self.points)

    @cached_property
    def own_uncertainty(self) -> OwnUncertainty | None:
        """What the model's covariance does to the residuals; None where its coefficients took part, or have none."""
        return own_uncertainty(self.model, self.whole) if self.is_held else None

    @property
    def lack_of_fit_p(self) -> float | None:
        """Probability of so much residual by chance, for independent noise; None where nothing tells the noise.

        Of a model that is held, what its own covariance accounts for is no lack of fit.
        """
        split = self.whole.split
        doubt = self.own_uncertainty
        if split.lack_of_fit_p is None or doubt is None:
            return split.lack_of_fit_p
        dof, noise_dof = split.dof
        total = self.whole.solved.chi_squared
        if not split.is_from_repeats:
            return never_zero(float(chi_squared_sf(total - doubt.explained(1.0), dof)))
        noise_ss = split.noise_ss
        sigma2 = noise_ss / noise_dof
        if sigma2 == 0.0:
            return split.lack_of_fit_p
        ratio = (total - doubt.explained(sigma2) - noise_ss) / (dof - noise_dof) / sigma2
        return never_zero(float(f_sf(max(ratio, 0.0), dof - noise_dof, noise_dof)))

    @property
    def expected_rmse_um(self) -> float | None:
        """What a right model with this covariance would show: √(noise² + mean tr Cov); None where nothing tells."""
        doubt, noise_um = self.own_uncertainty, self.whole.split.noise_um
        return None if doubt is None or noise_um is None else math.sqrt(noise_um**2 + doubt.variance_um2)

    def figures_on(self, rows: np.ndarray) -> ErrorFigures:
        """Give the figures over some rows (n,), of those that take part: for models on their common rows."""
        fitted = self.points
        return figures_of(fitted.sightings, fitted.residual_mm, np.asarray(rows, dtype=bool) & fitted.solved.used)

    def to_document(self) -> dict[str, object]:
        """Give plain values for `compare --json`."""
        return document_of(self)

    def plot_residuals(
        self, over: str | None = None, color_by: str | None = None, explained_um: Numbers | None = None
    ) -> go.Figure:
        """Draw the residual over a variable, or over what it follows most, coloured by another variable.

        Over it what an effect would explain, (n, 3): `explained_um` of a finding.
        """
        return drawn("residual_over", self, over, color_by, explained_um)

    def plot_volume(
        self,
        look: Literal["length", "magnitude", "direction", "region"] = "length",
        exaggeration: float = 1.0,
        explained_um: Numbers | None = None,
        shape_at: Conditions | None = None,
    ) -> go.Figure:
        """Draw every residual at its place: strokes coloured by length or direction, or dots of its magnitude.

        Over it what an effect would explain, (n, 3), `explained_um` of a finding; and the machine's shape at these
        conditions ({} where the model needs none), its errors magnified. By region: the mean of each box of the
        volume beside its spread, alone.
        """
        if look == "region":
            return drawn("residual_of_regions", self, exaggeration=exaggeration)
        return drawn("residual_in_volume", self, look, exaggeration, explained_um, shape_at)

    def plot_regions(self) -> go.Figure:
        """Draw mean, spread and number of rows by region of the volume."""
        return drawn("residual_by_region", self)

    def plot_histogram(self) -> go.Figure:
        """Draw the histogram of each component beside what noise would give."""
        return drawn("residual_histogram", self)

    def _repr_html_(self) -> str:
        """Show how far the model is off, and where most, for a notebook."""
        return comparison_html(self)


def compare(
    model: Model,
    *tables: MeasuredTable,
    refit: bool = False,
    rows: np.ndarray | None = None,
    rig_sensitivity: Numbers | None = None,
    rig_covariance: Numbers | None = None,
    threads: int = 0,
) -> Comparison:
    """Hold a model against measurements.

    Where the measurements are the data that the model was fitted to (its digest says), its own freedom takes part.
    Where they are not, its coefficients stay as they are, and only the pose of each session's measuring frame (and
    the places of targets) is fitted: so that a hot machine's growth is not fitted away.

    Parameters
    ----------
    model
        A fitted model, tables of errors, or a nominal machine.
    tables
        Measured points, circular tests, lengths.
    refit
        Fit the model's coefficients to data that are not its own, too.
    rows : (n,) or None
        Which of the measured rows take part, as `common_rows` gives them: to compare models on the same rows.
    rig_sensitivity, rig_covariance
        The calibration's uncertainty, as for `geoerr.fit_model`: it takes part where the model's own freedom does.
    threads
        0 = all cores.

    Raises
    ------
    GeoerrError
        for a column or a parameter's value that the model needs and that is not there, by name.
    GeometryError
        where nothing can be compared.
    """
    check_model(model, tables, "compare(model, observations)")
    check_tables(tables, "compare(model, observations)", Observations, CircularTest, Lengths)
    terms = all_terms(model)
    sightings = within_the_machine(sightings_of(*tables), model.machine)
    is_own = _is_own_data(model, sightings, terms)
    if rows is not None:
        sightings = _selected(sightings, rows)
    if is_own or refit:
        fitted = own_freedom(
            model.machine,
            sightings,
            terms,
            tables=tables,
            rig_sensitivity=rig_sensitivity,
            rig_covariance=rig_covariance,
            threads=threads,
        )
    else:
        # It takes no part; given amiss it would not with the model's own data either.
        for points in (table for table in tables if isinstance(table, Observations)):
            checked_calibration(rig_sensitivity, rig_covariance, len(points))
        now = since_last_session(_refusing_unknown(model))
        fitted = frames_only(now.machine, sightings, all_terms(now), threads=threads)
    return Comparison(model, "own" if is_own else "refit" if refit else "held", fitted, lengths_of(fitted, sightings))


def common_rows(models: Iterable[Model], *tables: MeasuredTable) -> np.ndarray:
    """Tell which measured rows have the covariates of all models, (n,): models are compared on these."""
    sightings = sightings_of(*tables)
    masks = [has_covariates(model.machine, sightings, all_terms(model)) for model in models]
    return np.asarray(np.all(masks, axis=0)) if masks else np.ones(len(sightings), dtype=bool)


def all_terms(model: Model) -> tuple[Term, ...]:
    """Give everything that a model has as terms: its tables (as polygons), its terms, those of the rig."""
    return terms_of_errors(model.errors) + model.terms


def _is_own_data(model: Model, sightings: Sightings, terms: Sequence[Term]) -> bool:
    """Tell whether these are the data that the model is from, by the digest of the rows that it could use."""
    known = "" if model.errors is None else model.errors.data_digest
    if model.record is not None:
        known = model.record.data_digest
    return bool(known) and digest_of(complete_rows(model.machine, sightings, terms)) == known


def _selected(sightings: Sightings, rows: np.ndarray) -> Sightings:
    mask = np.asarray(rows)
    if mask.dtype != np.bool_ or mask.shape != (len(sightings),):
        raise ShapeError(f"rows must be ({len(sightings)},) of true and false, not {mask.shape} of {mask.dtype}")
    return with_rows(sightings, mask, _OTHER_ROWS)


def _refusing_unknown(model: Model) -> Model:
    """Refuse a model with parameters that have no value yet, by name."""
    unknown = [
        f"{term.id}.{parameter.name}"
        for term in model.terms
        for parameter in (*term.coefficients, *term.inner)
        if math.isnan(parameter.value)
    ]
    if unknown:
        more = f" and {len(unknown) - 3} more" if len(unknown) > 3 else ""
        raise GeoerrError(
            f"{', '.join(unknown[:3])}{more}: no value yet\n"
            "hint: fit the model to measurements, or leave the term out"
        )
    return model
