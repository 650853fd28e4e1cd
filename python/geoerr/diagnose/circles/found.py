"""What the search for causes holds: causes in the model, rivals of each, and everything that came out."""

from __future__ import annotations

from dataclasses import dataclass

from geoerr.diagnose.circles.bench import Judged
from geoerr.diagnose.circles.causes import Suspect, Way
from geoerr.diagnose.circles.columns import Radii
from geoerr.diagnose.circles.noise import Noise
from geoerr.diagnose.circles.probes import Probe
from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers


@dataclass(frozen=True, eq=False)
class Found:
    """A cause in the model.

    Attributes
    ----------
    suspect, way
        What, and how it is written.
    seen
        Places of its coefficients that move the radius.
    inner
        Values of its inner parameters.
    columns : (n, k)
        In µm for a unit of each seen coefficient (of each run, where it is by run).
    judged
        At the round in which it was added.
    p_value
        Family-wise, then.
    n_trials
        Ways in which it was tried.
    """

    suspect: Suspect
    way: Way
    seen: tuple[int, ...]
    inner: tuple[float, ...]
    columns: Numbers
    judged: Judged
    p_value: float
    n_trials: int

    @property
    def number(self) -> int:
        """Its number among the suspects."""
        return self.judged.what

    def columns_in(self, radii: Radii) -> Numbers:
        """Give its columns in the rows of other runs, (m, k), as `columns` has those of the rows that decide."""
        columns = radii.columns_um(self.way.term, self.inner)[:, list(self.seen)]
        return radii.by_run(columns) if self.judged.group.by_run else columns


@dataclass(frozen=True, eq=False)
class Rival:
    """A suspect in place of a found cause: how alike, how much worse in the sum of squares, whether told apart."""

    suspect: Suspect
    judged: Judged
    correlation: float
    difference: float
    is_tied: bool


@dataclass(frozen=True, eq=False)
class Searched:
    """What the search found.

    Attributes
    ----------
    runs
        Rows that decide; gross ones are left out, and those of which the record does not tell the side of a reversal.
    noise
        The noise, beside causes and structure without a name.
    noise_of_values
        That in which values are estimated: beside the causes alone, so that what has no name is a part of it.
    found
        In the order in which they were added.
    rivals
        Of each found cause, best first.
    first
        All suspects judged against the model as it was, best first, with their p-values.
    unknown
        The probe that explains what is left, with its p-value and its µm in every row; or None.
    withdrawn
        Names that were taken back.
    invisible
        Suspects of which the set-up leaves nothing.
    p_value
        That nothing is missing, for everything that was looked at.
    n_gross
        Rows left out.
    estimate, covariance
        Of all coefficients and inner parameters of the found causes, one cause after the other.
    traces : (n, n_found)
        What each does to the radius, µm, off the set-up.
    whole
        All rows but the gross ones.
    whole_traces : (n_whole, n_found)
        The same as `traces` in those.
    rest_um : (n,)
        What causes leave.
    rest_without_jumps_um : (n,)
        What causes but jumps leave, and structure without a name.
    """

    runs: Runs
    suspects: tuple[Suspect, ...]
    noise: Noise
    noise_of_values: Noise
    found: tuple[Found, ...]
    rivals: tuple[tuple[Rival, ...], ...]
    first: tuple[tuple[Judged, float], ...]
    unknown: tuple[Probe, float, Numbers] | None
    withdrawn: tuple[Found, ...]
    invisible: tuple[Suspect, ...]
    p_value: float
    n_gross: int
    estimate: Numbers
    covariance: Numbers
    traces: Numbers
    whole: Runs
    whole_traces: Numbers
    rest_um: Numbers
    rest_without_jumps_um: Numbers

    def whole_columns(self, place: int) -> Numbers:
        """Give the columns of a found cause in all rows but the gross ones, (n_whole, k): its worth is of these."""
        return self.found[place].columns_in(Radii(self.whole))
