"""The search for causes: added, dropped and exchanged one by one while the evidence grows.

A real machine shows several causes at once, so that no single one is judged alone: each is judged with the others in
the model. What is left is then probed for structure without a name, and a name that a probe beats clearly, without
standing out of what the probe does, is taken back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from geoerr.diagnose.circles.bench import Bench, Group, Judged, Null, groups_of
from geoerr.diagnose.circles.causes import Suspect, Way
from geoerr.diagnose.circles.columns import Radii
from geoerr.diagnose.circles.noise import Noise, blocks_of, fit_noise, orthonormal
from geoerr.diagnose.circles.probes import Probe, probes_of
from geoerr.diagnose.circles.runs import Runs
from geoerr.fit.sightings import Numbers

# Family-wise: one half for names, the other for probes.
ALPHA = 0.05
MOST_CAUSES = 12
_MOST_CHANGES = 40
# Another cause takes a cause's place only where the logarithm of the evidence grows by as much.
_EXCHANGE = 1.0
# As in the search over points: a probe has to be this much better, and the name to leave so much of what it does.
_IMPOSTOR, _MOST_OF_IT = 3.0, 0.75
# A name stands out of a probe's many functions where its share would come by chance once in a hundred looks.
_STANDS_OUT = 0.01
# Not told apart: so alike, and so near in the sum of squares (6 is e^3 in likelihood; 20 is decided).
TIED_CORRELATION, _LEAST_CORRELATION = 0.95, 0.5
_LEAST_DIFFERENCE, _MOST_DIFFERENCE = 6.0, 20.0
# Rows farther off than this many standard deviations, alone or two together, are mistakes.
_GROSS, _LONGEST_MISTAKE = 6.0, 2
# Trials that stand for a cause in the estimate of the noise.
_SHAPES_OF_A_CAUSE = 3
# Ways with more trials than this are waves and jumps.
_FEW_TRIALS = 20
# Besides what the catalogue says: with a long decay these are backlash.
_MORE_CASES = {"stick-slip": ("backlash",), "reversal-spike": ("backlash",)}
# Of names whose evidence differs by less the more common one speaks.
_AS_GOOD = 0.5


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


@dataclass(frozen=True, eq=False)
class Rival:
    """A suspect in place of a found cause: how alike, how much worse (in the sum of squares), and whether told apart."""

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
        Rows that count; gross ones are left out.
    noise
        The noise.
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
    rest_um : (n,)
        What is left.
    """

    runs: Runs
    suspects: tuple[Suspect, ...]
    noise: Noise
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
    rest_um: Numbers


def search(runs: Runs, suspects: Sequence[Suspect]) -> Searched:
    """Search, and once more without the rows that turn out to be gross."""
    searched = _Search(runs, suspects).run()
    gross = _gross(searched)
    if not gross.any():
        return searched
    again = _Search(runs.without(gross), suspects).run()
    return replace(again, n_gross=int(gross.sum()))


class _Search:
    def __init__(self, runs: Runs, suspects: Sequence[Suspect]) -> None:
        self.runs, self.suspects, self.probes = runs, tuple(suspects), probes_of(runs)
        self.n = len(runs)
        self.radii = Radii(runs)
        self.groups = groups_of(self.radii, self.suspects)
        self.probe_groups = groups_of(self.radii, self.probes)
        self.n_trials = {number: one.n_trials for number, one in enumerate(self.suspects)}
        self.n_probes = {number: one.n_trials for number, one in enumerate(self.probes)}
        self.blocks = blocks_of(runs)
        self.set_up = orthonormal(runs.set_up_columns)
        self._weigh([])

    def _weigh(self, found: Sequence[Found]) -> None:
        """Estimate the noise anew, and bring everything into its metric."""
        shapes = [self.set_up, *(one.columns for one in found)]
        for group in self.groups:
            if group.by_run or group.n_trials > _FEW_TRIALS:
                # Waves and jumps are many; what of them is there is added when it is found.
                continue
            some = np.unique(np.linspace(0, group.n_trials - 1, _SHAPES_OF_A_CAUSE).astype(np.int64))
            shapes += [group.columns[:, group.k * trial : group.k * (trial + 1)] for trial in some]
        self.noise = fit_noise(self.runs, self.blocks, self.runs.signal_um, np.concatenate(shapes, axis=1))
        slices = self.runs.slices
        self.bench = Bench(self.groups, self.n_trials, self.noise, slices)
        self.probe_bench = Bench(self.probe_groups, self.n_probes, self.noise, slices)
        self.base = self.noise.whiten(self.set_up)
        self.signal = self.noise.whiten(self.runs.signal_um)
        # With the cause itself, so that no other takes its place in memory.
        self.known: dict[int, tuple[Found, Numbers]] = {}

    def _context(self, found: Sequence[Found]) -> tuple[Numbers, Numbers]:
        """Give the orthonormal basis of set-up and causes, and what they leave, whitened."""
        basis = orthonormal(np.concatenate([self.base, *(self._white(one) for one in found)], axis=1))
        return basis, self.signal - basis @ (basis.T @ self.signal)

    def _white(self, one: Found) -> Numbers:
        if id(one) not in self.known:
            self.known[id(one)] = (one, self.noise.whiten(one.columns))
        return self.known[id(one)][1]

    def run(self) -> Searched:
        basis, left = self._context([])
        chance = self.bench.chance(basis, self.n)
        probe_chance = self.probe_bench.chance(basis, self.n)
        judged = sorted(self.bench.judge(basis, left, self.n), key=lambda one: -one.evidence)
        first = tuple((one, min(2.0 * chance.p_value(one.surprise), 1.0)) for one in judged)
        probed = self.probe_bench.judge(basis, left, self.n)
        p_values = [p for _, p in first]
        p_values += [2.0 * probe_chance.p_value(one.surprise) for one in probed]
        seen = {one.what for one in judged}
        invisible = tuple(one for number, one in enumerate(self.suspects) if number not in seen)
        found = self._names(chance)
        found, withdrawn, unknown = self._probed(found, probe_chance)
        found = self._refined(found)
        estimate, covariance = self._joint(found)
        traces = self._traces(found, estimate)
        rest = self.runs.signal_um - self._plain(self.runs.signal_um) - traces.sum(axis=1)
        return Searched(
            self.runs,
            self.suspects,
            self.noise,
            tuple(found),
            tuple(self._rivals(found, place) for place in range(len(found))),
            first,
            unknown,
            tuple(withdrawn),
            invisible,
            min(1.0, *p_values) if p_values else 1.0,
            0,
            estimate,
            covariance,
            traces,
            rest,
        )

    def _names(self, chance: Null) -> list[Found]:
        found: list[Found] = []
        for _ in range(_MOST_CHANGES):
            if len(found) >= MOST_CAUSES:
                break
            basis, left = self._context(found)
            taken = {one.number for one in found}
            judged = [one for one in self.bench.judge(basis, left, self.n) if one.what not in taken]
            judged = [one for one in judged if one.evidence > 0.0 and chance.p_value(one.surprise) <= 0.5 * ALPHA]
            if not judged:
                break
            best = _foremost(judged)
            added = self._settled(best, basis, left, chance.p_value(best.surprise))
            found.append(added)
            if added.judged.group.by_run or added.judged.group.n_trials > _FEW_TRIALS:
                self._weigh(found)
            found = self._exchanged(self._needed(found), chance)
        return found

    def _settled(self, judged: Judged, basis: Numbers, left: Numbers, p_value: float) -> Found:
        """Refine the inner parameters between the neighbours of the best trial."""
        suspect = self.suspects[judged.what]
        way = suspect.ways[judged.group.way]
        inner = list(way.trials[judged.trial])
        for place, values in enumerate(zip(*way.trials, strict=True)):
            tried = sorted(set(values))
            at = tried.index(inner[place])
            low, high = tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]
            if low < high:
                inner[place] = self._best(judged.group, way, inner, place, (low, high), basis, left)
        columns = self._columns(judged.group, way, inner)
        return Found(
            suspect,
            way,
            judged.group.seen,
            tuple(inner),
            columns,
            judged,
            min(2.0 * p_value, 1.0),
            self.n_trials[judged.what],
        )

    def _best(
        self,
        group: Group,
        way: Way,
        inner: Sequence[float],
        place: int,
        ends: tuple[float, float],
        basis: Numbers,
        left: Numbers,
    ) -> float:
        is_log = way.term.inner[place].spacing == "log" and ends[0] > 0.0

        def loss(value: float) -> float:
            trial = [*inner[:place], float(np.exp(value)) if is_log else value, *inner[place + 1 :]]
            return -self._gain(self.noise.whiten(self._columns(group, way, trial)), basis, left)

        low, high = (float(np.log(end)) for end in ends) if is_log else ends
        found = optimize.minimize_scalar(
            loss, bounds=(low, high), method="bounded", options={"xatol": 2e-4 * (high - low)}
        )
        at_start = float(np.log(inner[place])) if is_log else inner[place]
        best = float(found.x) if float(found.fun) < loss(at_start) else at_start
        return float(np.exp(best)) if is_log else best

    def _columns(self, group: Group, way: Way, inner: Sequence[float]) -> Numbers:
        columns = self.radii.columns_um(way.term, inner)[:, list(group.seen)]
        return self.radii.by_run(columns) if group.by_run else columns

    def _gain(self, white: Numbers, basis: Numbers, left: Numbers) -> float:
        beyond = white - basis @ (basis.T @ white)
        size = np.linalg.norm(beyond, axis=0)
        kept = size**2 > 0.002 * np.maximum(np.linalg.norm(white, axis=0) ** 2, 1e-300)
        if not kept.any():
            return 0.0
        own = orthonormal(beyond[:, kept])
        return float(((own.T @ left) ** 2).sum())

    def _evidence(self, one: Found, others: Sequence[Found]) -> tuple[float, float]:
        """Give a cause's evidence and gain with the others in the model."""
        basis, left = self._context(others)
        gain = self._gain(self._white(one), basis, left)
        penalty = 0.5 * one.columns.shape[1] * np.log(self.n) + np.log(one.n_trials)
        return float(0.5 * gain - penalty), gain

    def _needed(self, found: list[Found]) -> list[Found]:
        """Drop what the others make superfluous, the least needed first."""
        while len(found) > 1:
            evidence = [self._evidence(one, [*found[:k], *found[k + 1 :]])[0] for k, one in enumerate(found)]
            worst = int(np.argmin(evidence))
            if evidence[worst] > 0.0:
                break
            found = [*found[:worst], *found[worst + 1 :]]
        return found

    def _exchanged(self, found: list[Found], chance: Null) -> list[Found]:
        """Exchange a cause for a better one, as long as that helps."""
        for _ in range(2 * MOST_CAUSES):
            best: tuple[float, int, Judged] | None = None
            taken = {one.number for one in found}
            for place, one in enumerate(found):
                others = [*found[:place], *found[place + 1 :]]
                basis, left = self._context(others)
                own, _ = self._evidence(one, others)
                # A wave takes the place of a wave only.
                most = None if one.n_trials > _FEW_TRIALS else _FEW_TRIALS
                for other in self.bench.judge(basis, left, self.n, most_trials=most):
                    more = other.evidence - own
                    if other.what not in taken and more > _EXCHANGE and (best is None or more > best[0]):
                        best = (more, place, other)
            if best is None:
                return found
            _, place, judged = best
            others = [*found[:place], *found[place + 1 :]]
            basis, left = self._context(others)
            found = [*others, self._settled(judged, basis, left, chance.p_value(judged.surprise))]
            found = self._needed(found)
        return found

    def _probed(
        self, found: list[Found], chance: Null
    ) -> tuple[list[Found], list[Found], tuple[Probe, float, Numbers] | None]:
        """Look for structure without a name, and take back names that are none."""
        withdrawn: list[Found] = []
        while found:
            worst: tuple[float, int] | None = None
            for place, one in enumerate(found):
                others = [*found[:place], *found[place + 1 :]]
                basis, left = self._context(others)
                own, gain = self._evidence(one, others)
                probe = self._passing(basis, left, chance)
                if probe is None or probe.evidence <= own + _IMPOSTOR or gain >= _MOST_OF_IT * probe.gain:
                    continue
                if self._stands_out(gain, one.columns.shape[1], probe):
                    continue
                if worst is None or probe.evidence - own > worst[0]:
                    worst = (probe.evidence - own, place)
            if worst is None:
                break
            withdrawn.append(found[worst[1]])
            found = [*found[: worst[1]], *found[worst[1] + 1 :]]
        basis, left = self._context(found)
        probe = self._passing(basis, left, chance)
        if probe is None:
            return found, withdrawn, None
        p_value = min(2.0 * chance.p_value(probe.surprise), 1.0)
        return found, withdrawn, (self.probes[probe.what], p_value, self._trace(probe, basis, left))

    def _passing(self, basis: Numbers, left: Numbers, chance: Null) -> Judged | None:
        judged = self.probe_bench.judge(basis, left, self.n)
        judged = [one for one in judged if one.evidence > 0.0 and chance.p_value(one.surprise) <= 0.5 * ALPHA]
        return max(judged, key=lambda one: one.evidence, default=None)

    def _stands_out(self, gain: float, rank: int, probe: Judged) -> bool:
        """Tell whether a name has more of what a probe explains than any direction of it by chance."""
        left = probe.rank - rank
        if left < 1:
            return True
        ratio = (gain / rank) / max((probe.gain - gain) / left, 1e-300)
        return float(stats.f.sf(ratio, rank, left)) * len(self.suspects) < _STANDS_OUT

    def _trace(self, judged: Judged, basis: Numbers, left: Numbers) -> Numbers:
        """Give what a probe explains, µm, off the set-up."""
        first = judged.group.k * judged.trial
        columns = judged.group.columns[:, first : first + judged.group.k]
        white = self.noise.whiten(columns)
        beyond = white - basis @ (basis.T @ white)
        value = np.linalg.lstsq(beyond, left, rcond=1e-6)[0]
        trace = columns @ value
        return trace - self._plain(trace)

    def _refined(self, found: list[Found]) -> list[Found]:
        """Settle inner parameters once more with all the others in the model."""
        for _ in range(2):
            for place, one in enumerate(found):
                if not one.inner:
                    continue
                others = [*found[:place], *found[place + 1 :]]
                basis, left = self._context(others)
                inner = list(one.inner)
                for number, parameter in enumerate(one.way.term.inner):
                    if parameter.low == parameter.high:
                        continue
                    ends = self._around(one, number)
                    inner[number] = self._best(one.judged.group, one.way, inner, number, ends, basis, left)
                columns = self._columns(one.judged.group, one.way, inner)
                found[place] = replace(one, inner=tuple(inner), columns=columns)
        return found

    def _around(self, one: Found, number: int) -> tuple[float, float]:
        tried = sorted({trial[number] for trial in one.way.trials})
        at = int(np.searchsorted(tried, one.inner[number]))
        return tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]

    def _joint(self, found: Sequence[Found]) -> tuple[Numbers, Numbers]:
        """Give all numbers of all causes at once, and their covariance."""
        parts, n_values = [], 0
        for one in found:
            parts.append(one.columns)
        basis, _ = self._context([])
        values = self._solved(parts, basis)[0] if parts else np.zeros(0)
        with_inner, estimate = [], []
        for one in found:
            own = values[n_values : n_values + one.columns.shape[1]]
            n_values += one.columns.shape[1]
            with_inner.append(one.columns)
            estimate.append(own)
            slopes = self._slopes(one, own)
            if slopes.shape[1]:
                with_inner.append(slopes)
                estimate.append(np.array(one.inner))
        if not with_inner:
            return np.zeros(0), np.zeros((0, 0))
        return np.concatenate(estimate), self._solved(with_inner, basis)[1]

    def _slopes(self, one: Found, values: Numbers) -> Numbers:
        """Give the derivatives of a cause's trace by its inner parameters, (n, n_inner); 0 for a fixed one."""
        slopes = np.zeros((self.n, len(one.inner)))
        for number, parameter in enumerate(one.way.term.inner):
            low, high = parameter.low or 0.0, parameter.high or 0.0
            if low == high:
                continue
            step = 1e-4 * (abs(one.inner[number]) if parameter.spacing == "log" else high - low)
            if parameter.name == "P":
                step = 1e-3 * one.inner[number] ** 2 / float(self.runs.radius_mm.max())
            sides = []
            for sign in (1.0, -1.0):
                inner = [*one.inner[:number], one.inner[number] + sign * step, *one.inner[number + 1 :]]
                sides.append(self._columns(one.judged.group, one.way, inner) @ values)
            slopes[:, number] = (sides[0] - sides[1]) / (2.0 * step)
        return slopes

    def _solved(self, parts: Sequence[Numbers], basis: Numbers) -> tuple[Numbers, Numbers]:
        white = self.noise.whiten(np.concatenate(parts, axis=1))
        beyond = white - basis @ (basis.T @ white)
        size = np.sqrt(np.maximum((beyond**2).sum(axis=0), 1e-300))
        inverse = np.linalg.pinv(beyond.T @ beyond / np.outer(size, size), rcond=1e-10, hermitian=True)
        covariance = inverse / np.outer(size, size)
        return covariance @ (beyond.T @ self.signal), covariance

    def _traces(self, found: Sequence[Found], estimate: Numbers) -> Numbers:
        traces, first = np.zeros((self.n, len(found))), 0
        for place, one in enumerate(found):
            k = one.columns.shape[1]
            own = one.columns @ estimate[first : first + k]
            traces[:, place] = own - self._plain(own)
            first += k + len(one.inner)
        return traces

    def _plain(self, values: Numbers) -> Numbers:
        """Give what the set-up takes of values (n,), every row alike."""
        return np.asarray(self.set_up @ (self.set_up.T @ values))

    def _rivals(self, found: Sequence[Found], place: int) -> tuple[Rival, ...]:
        """Look at every other suspect in the place of a found cause."""
        one = found[place]
        others = [*found[:place], *found[place + 1 :]]
        basis, left = self._context(others)
        white = self.noise.whiten(one.columns)
        beyond = white - basis @ (basis.T @ white)
        own = orthonormal(beyond)
        explained = own @ (own.T @ left)
        gain, size = float(explained @ explained), float(np.linalg.norm(explained))
        taken = {other.number for other in found}
        rivals = []
        for judged in self.bench.judge(basis, left, self.n):
            if judged.what in taken or size == 0.0:
                continue
            suspect = self.suspects[judged.what]
            group, trial = judged.group, judged.trial
            columns = group.columns[:, group.k * trial : group.k * (trial + 1)]
            if group.by_run:
                columns = self.radii.by_run(columns)
            theirs = self.noise.whiten(columns)
            theirs = orthonormal(theirs - basis @ (basis.T @ theirs))
            correlation = float(np.linalg.norm(theirs.T @ explained)) / size
            # Of a wider group only what it does in the place of this one counts.
            difference = gain - judged.gain
            alike = correlation > TIED_CORRELATION and difference < _MOST_DIFFERENCE
            near = correlation > _LEAST_CORRELATION and difference < _LEAST_DIFFERENCE
            worse = judged.evidence < self._evidence(one, others)[0] - _MOST_DIFFERENCE / 2.0
            tied = (alike or near) and not worse and not _holds(suspect, one.suspect)
            rivals.append(Rival(suspect, judged, correlation, difference, tied))
        return tuple(sorted(rivals, key=lambda rival: -rival.judged.evidence))


def _holds(wider: Suspect, special: Suspect) -> bool:
    """Tell whether one is a special case of the other: what needs more to explain the same is no rival."""
    contains = (*wider.effect.contains, *_MORE_CASES.get(wider.reference.effect, ()))
    return special.reference.effect in contains and special.reference.axis == wider.reference.axis


def _foremost(judged: Sequence[Judged]) -> Judged:
    """Give the best; of those that are as good the one that comes first."""
    top = max(one.evidence for one in judged)
    return min((one for one in judged if one.evidence > top - _AS_GOOD), key=lambda one: one.what)


def _gross(searched: Searched) -> np.ndarray:
    """Tell which rows stand alone far off their neighbours, (n,): no mistake goes on."""
    noise, runs = searched.noise, searched.runs
    scaled = searched.rest_um / (noise.sigma_um * noise.level)
    result = np.zeros(len(runs), dtype=bool)
    reach = np.array([-3, -2, -1, 1, 2, 3])
    for own in runs.slices:
        n = own.stop - own.start
        # At the ends the nearest rows on the one side that there is.
        middle = np.clip(np.arange(n), 3, n - 4)
        beside = np.median(scaled[own][middle[:, None] + reach], axis=1)
        off = np.abs(scaled[own] - beside)
        spread = float(np.median(off)) / 0.6745
        far = off > _GROSS * max(spread, 1.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], far.astype(np.int8), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start <= _LONGEST_MISTAKE:
                result[own.start + start : own.start + stop] = True
    return result
