"""One machine at several temperatures: each state's 21 errors, from fits that can be compared number by number."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from geoerr.drawing import drawn
from geoerr.error_functions import ErrorFunctions
from geoerr.errors import GeoerrError, GeometryError, NotDeterminedError, ShapeError
from geoerr.fit import FitOptions, Fitted
from geoerr.fit.sightings import Numbers
from geoerr.machine import Machine
from geoerr.model.called import check_machine, kind_of
from geoerr.observations import Observations
from geoerr.states.common import common_bases, functions_of
from geoerr.states.common_range import called, within_common_range
from geoerr.states.difference import Difference
from geoerr.states.functions import Estimate, Functions
from geoerr.states.joint import TemperatureFit, fit_temperature
from geoerr.states.left_out import LeftOut, leave_one_out
from geoerr.states.one_temperature import at_one_temperature
from geoerr.states.repeats import Repeat, repeats_of, session_name
from geoerr.states.state_fit import fit_state
from geoerr.states.temperature_model import TemperatureModel, temperature_model
from geoerr.states.temperatures import with_temperatures
from geoerr.states.text import states_report
from geoerr.states.weights import Weights, weights_of
from geoerr.summaries import sentences_html, summary_html, table_html
from geoerr.terms import BasisSpec, is_column

if TYPE_CHECKING:
    import plotly.graph_objects as go


# Reasons that a sentence gives.
_SPOKEN = 3
# A state is named by a round number.
_ROUNDED_DEGC = 1.0


@dataclass(frozen=True, eq=False)
class State:
    """The machine at one temperature.

    Attributes
    ----------
    temperature_degc
        As it was named.
    mean_degc
        Mean of the temperature's column: what the models with temperature are made with.
    observations
        Its rows, in sessions of its own.
    fitted
        The joint fit, with the bases that all states share.
    errors
        The 21 errors at the common positions, with standard uncertainties.
    estimate
        Parameters of the fit with their covariance.
    sensitivity : (n, 3, p)
        What was found of offsets of passes: unknowns of unit variance and how they move the rows.
    """

    temperature_degc: float
    mean_degc: float
    observations: Observations
    fitted: Fitted
    errors: ErrorFunctions
    estimate: Estimate
    sensitivity: Numbers

    @property
    def is_named_otherwise(self) -> bool:
        """Whether its name is another temperature than it had, by more than what a name rounds off."""
        return abs(self.mean_degc - self.temperature_degc) > _ROUNDED_DEGC


@dataclass(frozen=True, eq=False)
class States:
    """One machine at several temperatures; `identify_states` makes it.

    Attributes
    ----------
    machine
        The machine.
    covariate
        Column that holds the temperature, °C.
    functions
        What all states are made of, and can be compared by.
    states
        Coldest first.
    notes
        Sentences for the reader.
    as_given
        The tables as they were given, coldest first, where all that they hold took part as it stands.
    repeats
        Sessions of one temperature against each other.
    weights
        Of rows that state no uncertainty.
    """

    machine: Machine
    covariate: str
    functions: Functions
    states: tuple[State, ...]
    notes: tuple[str, ...] = ()
    threads: int = 0
    as_given: tuple[Observations, ...] = ()
    repeats: tuple[Repeat, ...] = ()
    weights: Weights = field(default_factory=Weights)

    @property
    def temperatures_degc(self) -> tuple[float, ...]:
        """Temperatures of the states, rising."""
        return tuple(state.temperature_degc for state in self.states)

    def _repr_html_(self) -> str:
        """Show the states, for a notebook."""
        rows = [
            (
                f"{state.temperature_degc:g}",
                f"{state.mean_degc:.1f}",
                str(len(state.observations)),
                f"{state.fitted.scale:.2f}" if state.fitted.sightings.is_stated else "–",
            )
            for state in self.states
        ]
        header = ("state, °C", f"mean of {self.covariate}, °C", "rows", "scatter ÷ stated")
        return summary_html(
            f"{self.machine.name} at {len(self.states)} temperatures",
            table_html(header, rows),
            sentences_html(*self.notes),
        )

    def __getitem__(self, temperature_degc: float) -> State:
        """Give the state of a temperature.

        Raises
        ------
        GeoerrError
            where there is none, naming those that there are.
        """
        for state in self.states:
            if state.temperature_degc == temperature_degc:
                return state
        known = ", ".join(f"{value:g}" for value in self.temperatures_degc)
        raise GeoerrError(f"there is no state at {temperature_degc:g} °C\nhint: there are {known} °C")

    def plot_errors(self) -> go.Figure:
        """Draw the 21 errors at every temperature."""
        return drawn("state_curves", self)

    def difference(self, first_degc: float, second_degc: float) -> Difference:
        """Compare two states: the second minus the first; see `Difference`."""
        first, second = self[first_degc], self[second_degc]
        if first is second:
            raise GeoerrError(f"the state at {first_degc:g} °C does not differ from itself\nhint: name two states")
        return Difference(
            f"{first.temperature_degc:g} °C",
            f"{second.temperature_degc:g} °C",
            self.functions,
            first.estimate,
            second.estimate,
            self.threads,
        )

    @cached_property
    def temperature_fit(self) -> TemperatureFit:
        """How the errors follow temperature: terms chosen by evidence from the states' estimates."""
        return fit_temperature(self.functions, self.estimates, self.machine.reference_temperature_degc)

    @cached_property
    def model(self) -> TemperatureModel:
        """One model with temperature in it, those terms fitted to all observations at once."""
        return temperature_model(
            self.machine,
            self.covariate,
            self.functions,
            self.temperature_fit,
            [state.observations for state in self.states],
            [state.sensitivity for state in self.states],
            self.weights,
            as_given=self.as_given,
            threads=self.threads,
        )

    @cached_property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Every state predicted from the others, terms chosen anew without it; none of fewer than three states."""
        return leave_one_out(
            self.functions,
            self.estimates,
            {state.mean_degc: state.fitted for state in self.states},
            self.machine.reference_temperature_degc,
            threads=self.threads,
        )

    def report(self) -> str:
        """Give all of it in words and numbers, at most 100 columns wide."""
        return states_report(self)

    def to_document(self) -> dict[str, Any]:
        """Give plain values, for `--json`; the difference is that of the hottest and the coldest state."""
        difference = self.difference(self.temperatures_degc[0], self.temperatures_degc[-1])
        try:
            volume = difference.volume().to_document()
        except NotDeterminedError:
            volume = None
        return {
            "temperatures_degc": list(self.temperatures_degc),
            "states": [state.errors.to_document() for state in self.states],
            "difference": {**difference.to_document(), "volume": volume},
            "temperature_terms": [term.to_document() for term in self.model.temperature_terms],
            "misfit_p_value": self.temperature_fit.misfit.p_value,
            "astray": [{"name": name, "p_value": one} for name, one in self.temperature_fit.astray.items()],
            "left_out": [one.to_document() for one in self.left_out],
            "repeats": [one.to_document() for one in self.repeats],
            "notes": [*self.notes, *self.model.notes],
        }

    @property
    def estimates(self) -> dict[float, Estimate]:
        """Mean temperature to estimate."""
        return {state.mean_degc: state.estimate for state in self.states}


def identify_states(
    observations: Mapping[float, Observations | Sequence[Observations]],
    machine: Machine,
    *,
    covariate: str = "temp",
    bases: Mapping[str, BasisSpec] | None = None,
    threads: int = 0,
) -> States:
    """Find the 21 errors of a machine at each of several temperatures.

    Parameters
    ----------
    observations
        Temperature in °C to what was measured at it; two tables of one temperature are two sessions.
    machine
        The machine.
    covariate
        Column of the temperature. Where the tables have it, the joint model takes their numbers, and empty cells are
        filled from their neighbours in time; where they do not, it is filled with the state's temperature.
    bases
        Bases by ISO name; what is not named is chosen by the data, the same for all states.
    threads
        0 = all cores.

    Returns
    -------
    States
        Over the range of axis positions that all states share; rows far outside of it take no part, for bases must
        be the same.

    Raises
    ------
    GeoerrError
        for fewer than two temperatures, a name that is none, or a column that contradicts the temperatures.
    GeometryError
        where a state cannot be fitted, or the states share no range.

    Notes
    -----
    Li et al. 2023, §5.2 (room temperature and 120 °C). All states have the same bases, chosen by their
    evidence together: what these cannot follow is the same in every state, and cancels in differences. Offsets of
    passes are found by restricted likelihood and are part of every uncertainty. Rows of a state whose temperature was
    not steady are referred to its mean. The calibration of the cameras is no part of uncertainties: it is the same in
    all states, and cancels. Verified: tests/states, validation/hot_and_cold.py.
    """
    call = "identify_states({20.0: cold, 90.0: hot}, machine)"
    check_machine(machine, [observations], call)
    if not isinstance(observations, Mapping):
        raise ShapeError(f"{kind_of(observations)} was given where tables by temperature are needed\nhint: {call}")
    _refuse_one_temperature(observations)
    if not is_column(covariate):
        raise GeoerrError(f"{covariate!r} cannot be a column's name\nhint: letters, digits and underscores, as temp")
    given = {
        float(temperature): _parts(float(temperature), tables) for temperature, tables in sorted(observations.items())
    }
    parts, filled = with_temperatures(given, covariate)
    tables = {temperature: _one_table(temperature, own) for temperature, own in parts.items()}
    _refuse_contradictions(tables, covariate)
    n_rows = sum(map(len, tables.values()))
    tables, range_mm, notes = within_common_range(tables)
    weights = weights_of(machine, tables, bases or {}, threads)
    common = common_bases(machine, tables, range_mm, dict(bases or {}), threads, weights)
    options = FitOptions(bases=common.bases, threads=threads)
    fits = {temperature: fit_state(machine, table, options, weights) for temperature, table in tables.items()}
    files = {temperature: [part.sources for part in own] for temperature, own in given.items()}
    repeats = repeats_of(machine, tables, files, common, covariate, options, weights)
    fits, referred = at_one_temperature(machine, covariate, tables, fits, common, options, weights)
    functions = functions_of(machine, {called(one, tables[one]): fit.fitted for one, fit in fits.items()}, common)
    if not functions.names:
        raise _nothing_common(functions)
    states = []
    for temperature, one in fits.items():
        errors = functions.tables(one.estimate, "joint", (f"at {temperature:g} °C",))
        table = tables[temperature]
        mean = float(np.nanmean(table.numbers(covariate)[:, 0]))
        states.append(State(temperature, mean, table, one.fitted, errors, one.estimate, one.sensitivity))
    notes = (
        *filled,
        *notes,
        *weights.notes,
        *referred,
        *(_other_mean(state, covariate) for state in states if state.is_named_otherwise),
        *(repeat.sentence for repeat in repeats),
    )
    is_as_given = not filled and sum(map(len, tables.values())) == n_rows
    as_given = tuple(part for own in given.values() for part in own) if is_as_given else ()
    return States(machine, covariate, functions, tuple(states), notes, threads, as_given, repeats, weights)


def _nothing_common(functions: Functions) -> GeometryError:
    why = Counter(item.why for item in functions.not_determined)
    said = "; ".join(["no error is determined in all states", *(reason for reason, _ in why.most_common(_SPOKEN))])
    return GeometryError(f"{said}\nhint: measure all axes at every temperature")


def _other_mean(state: State, covariate: str) -> str:
    return (
        f"the state called {state.temperature_degc:g} °C had {covariate} = {state.mean_degc:.1f} °C on average: that "
        "is what the model and its predictions reckon with"
    )


def _refuse_one_temperature(observations: Mapping[float, Observations | Sequence[Observations]]) -> None:
    if len(observations) >= 2:
        return
    for temperature, given in observations.items():
        if not isinstance(given, Observations) and len(given) > 1:
            raise GeoerrError(
                f"all {len(given)} tables carry the same temperature, {temperature:g} °C: a comparison needs two "
                "temperatures or more\nhint: name each table by the temperature that it was measured at"
            )
    raise GeoerrError("a comparison needs two temperatures or more\nhint: give one table for each temperature")


def _parts(temperature: float, given: Observations | Sequence[Observations]) -> list[Observations]:
    if not math.isfinite(temperature):
        raise GeoerrError(f"{temperature} is no temperature in °C\nhint: name each state by the number")
    parts = [given] if isinstance(given, Observations) else list(given)
    if not parts:
        raise GeoerrError(f"nothing was measured at {temperature:g} °C\nhint: give a table, or leave it out")
    return parts


def _one_table(temperature: float, parts: Sequence[Observations]) -> Observations:
    """Join the tables of one temperature: every table's sessions stay its own."""
    frames = [
        part.frame.with_columns(session_name(temperature, number).alias("session"))
        for number, part in enumerate(parts)
    ]
    return Observations(
        pl.concat(frames, how="diagonal_relaxed"),
        tuple(source for part in parts for source in part.sources),
        tuple(problem for part in parts for problem in part.set_aside),
    )


def _refuse_contradictions(tables: Mapping[float, Observations], covariate: str) -> None:
    """Refuse a column that lies nearer to another state's temperature than to its own: files were swapped."""
    for temperature, table in tables.items():
        values = table.numbers(covariate)[:, 0]
        if not np.isfinite(values).any():
            raise GeoerrError(
                f"the column {covariate} of the state at {called(temperature, table)} is empty\n"
                "hint: fill it, leave it out (the state's temperature is then taken), or name another with covariate"
            )
        mean = float(np.nanmean(values))
        nearest = min(tables, key=lambda other: abs(other - mean))
        if nearest != temperature:
            raise GeoerrError(
                f"the state at {called(temperature, table)} has {covariate} = {mean:.1f} °C on average, nearer to "
                f"{nearest:g}\n"
                "hint: check which table belongs to which temperature, or name the column that tells it"
            )
