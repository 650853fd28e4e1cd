"""Structure without a name: what is left is probed, and names that a probe beats are taken back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoerr.diagnose.circles.bench import Judged, Null
from geoerr.diagnose.circles.causes import DECAYS
from geoerr.diagnose.circles.found import Found
from geoerr.diagnose.circles.noise import orthonormal
from geoerr.diagnose.circles.probes import Probe
from geoerr.diagnose.circles.state import ALPHA, State
from geoerr.diagnose.circles.values import sizes_of
from geoerr.distributions import f_sf
from geoerr.fit.sightings import Numbers

# As in the search over points: a probe has to be this much better, and the name to leave so much of what it does;
# several names, which could be parts of anything, to leave hardly anything.
_IMPOSTOR, _MOST_OF_IT, _NEARLY_ALL = 3.0, 0.75, 0.9
# A name lies within a kind of structure that holds so much of it.
_WITHIN = 0.7
_MOST_PROBES = 4
# Of effects with a decay on one axis one that is smaller than this share of another mends its shape.
_CORRECTION = 0.45
# What a cause's formula may be off by, as a share of its trace: friction and play are rounder than formulas.
_DOUBT = {**dict.fromkeys(DECAYS, 0.15), "vibration": 0.1, "periodic": 0.05, "screw-wobble": 0.05}
_USUAL_DOUBT = 0.03
# A name stands out of a probe's many functions where its share would come by chance once in a hundred looks.
_STANDS_OUT = 0.01


class Structure:
    """The search for structure, from one state."""

    def __init__(self, state: State, chance: Null) -> None:
        self.state, self.chance = state, chance
        # What was found has these columns, (n, k); none where nothing was.
        self.columns: Numbers = np.zeros((state.n, 0))

    def probed(self, found: list[Found]) -> tuple[list[Found], list[Found], tuple[Probe, float, Numbers] | None]:
        """Look for structure without a name, and take back names that are none."""
        found, withdrawn = self._without_corrections(found)
        probe = self._probe(found)
        while probe is not None:
            doubtful = self._doubtful(found, probe)
            if not doubtful:
                doubtful = self._shaken(found, probe)
            if not doubtful:
                break
            withdrawn += doubtful
            found = [one for one in found if all(one is not other for other in doubtful)]
            probe = self._probe(found)
        if probe is None:
            return found, withdrawn, None
        described, self.columns = self._described(probe, found)
        return found, withdrawn, described

    def _probe(self, found: Sequence[Found]) -> Judged | None:
        """Give the best probe of what causes leave; None where chance explains that."""
        return self._passing(*self.state.context(found))

    def _without_corrections(self, found: list[Found]) -> tuple[list[Found], list[Found]]:
        """Take back what only mends the shape of larger causes.

        A real spike is no exponential: what its formula is off by would be given small names.
        """
        size = sizes_of(self.state, found)
        order = sorted(range(len(found)), key=lambda place: -size[place])
        kept: list[int] = []
        for place in order:
            one = found[place].suspect.reference
            doubt = sum((_doubt_of(found[other]) * size[other]) ** 2 for other in kept)
            is_shape = one.effect in DECAYS and any(
                found[other].suspect.reference.effect in DECAYS
                and found[other].suspect.reference.axis == one.axis
                and size[place] < _CORRECTION * size[other]
                for other in kept
            )
            if size[place] ** 2 > doubt and not is_shape:
                kept.append(place)
        return (
            [one for place, one in enumerate(found) if place in kept],
            [one for place, one in enumerate(found) if place not in kept],
        )

    def _doubtful(self, found: Sequence[Found], probe: Judged) -> list[Found]:
        """Give the names that structure without a name, which is there, explains better.

        Those that lie within the same kind of structure, and do not stand out of it.
        """
        kind = self._kind_of(probe)
        inside = [one for one in found if self._is_within(self.state.white(one), kind)]
        if not inside:
            return []
        others = [one for one in found if all(one is not each for each in inside)]
        basis, left = self.state.context(others)
        judged = self.state.probe_bench.judge(basis, left, self.state.n, only=kind)
        judged = [one for one in judged if self.chance.p_value(one.surprise) <= 0.5 * ALPHA]
        whole = max(judged, key=lambda one: one.evidence, default=None)
        if whole is None:
            return []
        _, rest = self.state.context(found)
        together = float(left @ left - rest @ rest)
        if together >= (_MOST_OF_IT if len(inside) == 1 else _NEARLY_ALL) * whole.gain:
            return []
        doubtful = []
        for one in inside:
            evidence, gain = self.state.evidence(one, others)
            is_better = whole.evidence > evidence + _IMPOSTOR
            if is_better and not self._stands_out(gain, one.columns.shape[1], whole):
                doubtful.append(one)
        return doubtful

    def _kind_of(self, probe: Judged) -> int:
        """Give the probe of the radius that a probe belongs to: a function of one axis is one of the angle."""
        white = self.state.noise.whiten(self._probe_columns(probe))
        wide = [number for number, one in enumerate(self.state.probes) if one.component == "r"]
        return next((number for number in wide if self._is_within(white, number)), probe.what)

    def _is_within(self, white: Numbers, kind: int) -> bool:
        columns = next(group.columns for group in reversed(self.state.probe_groups) if group.what == kind)
        within = orthonormal(np.concatenate([self.state.base_q, self.state.noise.whiten(columns)], axis=1))
        own = orthonormal(white - self.state.base_q @ (self.state.base_q.T @ white))
        return bool(own.shape[1]) and float(((within.T @ own) ** 2).sum()) > _WITHIN * own.shape[1]

    def _described(self, probe: Judged, found: Sequence[Found]) -> tuple[tuple[Probe, float, Numbers], Numbers]:
        """Say on what the structure depends: what one probe leaves, another may explain."""
        basis, left = self.state.context(found)
        p_value = min(2.0 * self.chance.p_value(probe.surprise), 1.0)
        names = set(self.state.probes[probe.what].depends_on)
        component = self.state.probes[probe.what].component
        columns = [self._probe_columns(probe)]
        while len(columns) < _MOST_PROBES:
            white = self.state.noise.whiten(np.concatenate(columns, axis=1))
            wider = orthonormal(np.concatenate([basis, white], axis=1))
            rest = left - wider @ (wider.T @ left)
            more = self._passing(wider, rest)
            if more is None:
                break
            names |= set(self.state.probes[more.what].depends_on)
            component = component if self.state.probes[more.what].component == component else "r"
            columns.append(self._probe_columns(more))
        joined = np.concatenate(columns, axis=1)
        trace = self._trace(joined, found, basis, left)
        return (Probe(tuple(sorted(names)), component, ()), p_value, trace), joined

    def _shaken(self, found: Sequence[Found], probe: Judged) -> list[Found]:
        """Give the names that are nothing once the structure is in the model, and no longer in the noise.

        Those that lie within its kind are left: with all of it in the model they would be nothing by construction.
        """
        kind = self._kind_of(probe)
        outside = [one for one in found if not self._is_within(self.state.white(one), kind)]
        if not outside:
            return []
        before = self.state.noise
        _, structure = self._described(probe, found)
        self.state.use(self.state.noise_beside(found, structure))
        white = self.state.noise.whiten(structure)
        shaken = []
        for one in outside:
            others = [self.state.white(other) for other in found if other is not one]
            basis = orthonormal(np.concatenate([self.state.base, white, *others], axis=1))
            left = self.state.signal - basis @ (basis.T @ self.state.signal)
            if 0.5 * self.state.gain(self.state.white(one), basis, left) <= self.state.penalty(one):
                shaken.append(one)
        self.state.use(before)
        return shaken

    def _probe_columns(self, judged: Judged) -> Numbers:
        first = judged.group.k * judged.trial
        return judged.group.columns[:, first : first + judged.group.k]

    def _passing(self, basis: Numbers, left: Numbers) -> Judged | None:
        judged = self.state.probe_bench.judge(basis, left, self.state.n)
        judged = [one for one in judged if one.evidence > 0.0 and self.chance.p_value(one.surprise) <= 0.5 * ALPHA]
        return max(judged, key=lambda one: one.evidence, default=None)

    def _stands_out(self, gain: float, rank: int, probe: Judged) -> bool:
        """Tell whether a name has more of what a probe explains than any direction of it by chance."""
        left = probe.rank - rank
        if left < 1:
            return True
        ratio = (gain / rank) / max((probe.gain - gain) / left, 1e-300)
        return float(f_sf(ratio, rank, left)) * len(self.state.suspects) < _STANDS_OUT

    def _trace(self, columns: Numbers, found: Sequence[Found], basis: Numbers, left: Numbers) -> Numbers:
        """Give what columns explain beyond set-up and causes, µm."""
        inside = orthonormal(np.concatenate([self.state.set_up, *(one.columns for one in found)], axis=1))
        size = np.linalg.norm(columns, axis=0)
        scaled = columns[:, size > 0.0] / size[size > 0.0]
        own, singular, _ = np.linalg.svd(scaled - inside @ (inside.T @ scaled), full_matrices=False)
        own = own[:, singular > 1e-3]
        white = self.state.noise.whiten(own)
        value = np.linalg.lstsq(white - basis @ (basis.T @ white), left, rcond=1e-6)[0]
        return np.asarray(own @ value)


def _doubt_of(one: Found) -> float:
    return _DOUBT.get(one.suspect.reference.effect, _USUAL_DOUBT)
