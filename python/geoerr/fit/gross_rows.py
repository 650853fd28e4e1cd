"""Rows that are mistakes, as against rows that are far off because the model lacks something."""

from __future__ import annotations

import numpy as np

from geoerr.distributions import chi_squared_isf, chi_squared_ppf
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.observations import place_numbers

# Rows whose distance would occur once in ten million by chance are gross: not a tail of the noise, a mistake.
_GROSS = 1e-7
# More rows in a row than this, each once in ten million by chance, are no mistakes.
_LONGEST_MISTAKE = 2
# A row that is so many times as far from each of so many as neighbours are stands alone, whatever run it is in.
_ENOUGH_NEIGHBOURS, _CLEARLY = 4, 2.0
# So many pairs of far neighbours are no coincidence of mistakes.
_MANY_PAIRS = 20
# Rows on either side that a row is held against.
_NEIGHBOURS = 2
# The scale of differences is the larger of what their median and their ninth decile say: where most of them are 0, as
# of a device that counts steps, the median says nothing, and fewer than a tenth of the rows are mistakes.
_SHARES = (0.5, 0.9)
# Where the neighbours themselves are far apart the machine is on its way somewhere: no row of it stands alone.
_TIMES_THE_SPREAD = 2.0


def gross_limit(n_numbers: np.ndarray) -> Numbers:
    """Give the distance, in standard deviations, beyond which a row of so many numbers is gross, (n,)."""
    return np.asarray(np.sqrt(chi_squared_isf(_GROSS, np.arange(4)))[n_numbers])


def robust_scale(distance: Numbers, n_numbers: np.ndarray) -> float:
    """Give the factor by which the whitened residuals exceed 1, from the medians of rows with as many numbers.

    The median of a chi-squared distribution is known for every number of components, so that rows of one, two and
    three components agree; a half of the rows may be wrong.
    """
    ratios, weights = [], []
    for count in np.unique(n_numbers):
        rows = n_numbers == count
        if count == 0 or not rows.any():
            continue
        ratios.append(float(np.median(distance[rows] ** 2)) / float(chi_squared_ppf(0.5, count)))
        weights.append(int(rows.sum()))
    if not ratios:
        return 1.0
    return float(np.sqrt(max(np.average(ratios, weights=weights), 1e-300)))


def stand_alone(sightings: Sightings, whitened: Numbers) -> np.ndarray:
    """Tell which rows lie off by themselves, (n,): far from neighbours in the same pass that agree with each other.

    Against the whole of the data an error that the model does not have would count as gross, and be dropped: the rows
    of a machine that has warmed up, seen with a cold one's model.

    Parameters
    ----------
    whitened : (n, 3)
        Residuals in standard deviations.
    """
    keys = np.column_stack(
        [
            sightings.pass_number,
            sightings.carrier,
            np.round(sightings.offset_mm / SAME_POSITION_MM).astype(np.int64),
        ]
    )
    _, group = np.unique(keys, axis=0, return_inverse=True)
    difference, (spread, but_one) = np.zeros_like(whitened), np.zeros((2, len(sightings)))
    near = np.zeros((len(sightings), 2 * _NEIGHBOURS), dtype=np.int64)
    is_told = np.zeros(len(sightings), dtype=bool)
    reach = np.array([*range(-_NEIGHBOURS, 0), *range(1, _NEIGHBOURS + 1)])
    for number in range(int(group.max(initial=-1)) + 1):
        rows = np.flatnonzero(group.ravel() == number)
        if len(rows) <= len(reach):
            continue
        # At the ends the nearest rows on the one side that there is.
        middle = np.clip(np.arange(len(rows)), _NEIGHBOURS, len(rows) - 1 - _NEIGHBOURS)
        window = middle[:, None] + np.array([0, *reach])
        own = np.arange(len(rows))[:, None]
        others = np.sort(np.where(window == own, np.iinfo(np.int64).max, window), axis=1)[:, : len(reach)]
        beside = whitened[rows[others]]
        difference[rows] = whitened[rows] - np.median(beside, axis=1)
        spread[rows] = _spread(beside)
        but_one[rows] = np.min([_spread(np.delete(beside, k, axis=1)) for k in range(len(reach))], axis=0)
        near[rows] = rows[others]
        is_told[rows] = True
    n_numbers = sightings.is_measured.sum(axis=1)
    square = (difference**2).sum(axis=1)
    scale2 = max(
        (
            float(np.quantile(square[rows], share)) / float(chi_squared_ppf(share, count))
            for count in np.unique(n_numbers)
            if (rows := is_told & (n_numbers == count)).any()
            for share in _SHARES
        ),
        default=0.0,
    )
    if sightings.is_stated:
        scale2 = max(scale2, 1.0)
    if scale2 == 0.0:
        return np.zeros(len(sightings), dtype=bool)
    is_far = is_told & (square > chi_squared_isf(_GROSS, n_numbers) * scale2)
    # Two mistakes beside each other would hide each other.
    spread = np.where(is_far[near].any(axis=1), but_one, spread)
    is_alone = np.asarray(is_far & (square > (_TIMES_THE_SPREAD * spread) ** 2))
    if not is_alone.any():
        return is_alone
    return np.asarray(is_alone & ~Revisits(sightings).confirmed(whitened, is_alone))


def _spread(beside: Numbers) -> Numbers:
    """Give how far neighbours (n, k, 3) are from each other, (n,)."""
    return np.asarray(np.linalg.norm(np.ptp(beside, axis=1), axis=1))


class Neighbours:
    """Who is near whom, in time and in place: rows of one session and target, in the order of measurement."""

    def __init__(self, sightings: Sightings) -> None:
        target = np.round(sightings.offset_mm / SAME_POSITION_MM).astype(np.int64)
        place = np.round(sightings.commanded_mm / SAME_POSITION_MM).astype(np.int64)
        of_target = np.column_stack([sightings.session, sightings.carrier, target])
        self._in_time, self._in_place = _Rows(of_target), _Rows(np.column_stack([of_target, place]))
        self._is_stated = sightings.is_stated
        self._revisits = Revisits(sightings)

    def mistakes(self, whitened: Numbers, n_numbers: np.ndarray, is_far: np.ndarray) -> np.ndarray:
        """Leave of the far rows (n,) those that stand alone: what the model lacks goes on, and comes back.

        A mistake is in no longer run of far rows than two, and is like at most one of its neighbours: of the two rows
        before it and the two after it, and of those that were measured at the same place. What comes back whenever
        the machine comes back the same way is none.

        Parameters
        ----------
        whitened : (n, 3)
            Residuals in standard deviations.
        n_numbers : (n,)
            Measured components.
        """
        if not is_far.any():
            return is_far
        both = (self._in_time, self._in_place)
        counts = [one.alike(whitened, n_numbers, is_far, self._is_stated) for one in both]
        alike, nearly, neighbours = (first + second for first, second in zip(*counts, strict=True))
        is_short = self._in_time.run_length(is_far) <= _LONGEST_MISTAKE
        # Among far rows, too, one that is not even nearly like anything around it is a mistake.
        is_like_none = (nearly == 0) & (neighbours >= _ENOUGH_NEIGHBOURS)
        is_mistake = np.asarray(is_far & ((is_short & (alike < np.clip(neighbours, 1, 2))) | is_like_none))
        return np.asarray(is_mistake & ~self._revisits.confirmed(whitened, is_mistake))


class Revisits:
    """Readings of one place that was reached anew from the same side: rows of one session, target and direction.

    Rows that follow each other at one place are one visit: what disturbed one of them may have disturbed all.
    """

    def __init__(self, sightings: Sightings) -> None:
        target = np.round(sightings.offset_mm / SAME_POSITION_MM).astype(np.int64)
        of_target = np.column_stack([sightings.session, sightings.carrier, target])
        place = np.column_stack([place_numbers(own) for own in sightings.commanded_mm.T])
        here = np.column_stack([place, sightings.directions])
        # In the order of measurement of each target; a visit ends where the place or the direction changes.
        in_time = _Rows(of_target)
        moved = in_time.begins.copy()
        moved[1:] |= (here[in_time.order][1:] != here[in_time.order][:-1]).any(axis=1)
        self._visit = np.empty(len(sightings), dtype=np.int64)
        self._visit[in_time.order] = np.cumsum(moved)
        self._rows = _Rows(np.column_stack([of_target, here, sightings.is_measured]))
        self._n_numbers = sightings.is_measured.sum(axis=1)
        self._is_stated = sightings.is_stated

    def confirmed(self, whitened: Numbers, is_asked: np.ndarray) -> np.ndarray:
        """Tell which of the rows that are asked for (n,) most of the visits before and after agree with.

        Parameters
        ----------
        whitened : (n, 3)
            Residuals in standard deviations.
        """
        found = np.zeros(len(whitened), dtype=bool)
        if not is_asked.any():
            return found
        limit = gross_limit(self._n_numbers) * self._sigma(whitened)
        order, group = self._rows.order, self._rows.group
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        for row in np.flatnonzero(is_asked).tolist():
            first, end = np.searchsorted(group, group[place[row]] + np.array([0, 1]))
            own = order[first:end]
            others = own[self._visit[own] != self._visit[row]]
            # The visits nearest in time: over many of them a machine drifts.
            nearest = np.argsort(np.abs(self._visit[others] - self._visit[row]), kind="stable")[: 2 * _NEIGHBOURS]
            distance = np.sqrt(0.5 * ((whitened[others[nearest]] - whitened[row]) ** 2).sum(axis=1))
            found[row] = 2 * (distance <= limit[row]).sum() > len(nearest)
        return found

    def _sigma(self, whitened: Numbers) -> float:
        """Give how far one visit is from the next, in standard deviations."""
        order, group = self._rows.order, self._rows.group
        is_pair = (group[1:] == group[:-1]) & (self._visit[order][1:] != self._visit[order][:-1])
        distance = np.sqrt(0.5 * ((whitened[order][1:] - whitened[order][:-1]) ** 2).sum(axis=1))[is_pair]
        if not len(distance):
            return 0.0
        sigma = robust_scale(distance, self._n_numbers[order][1:][is_pair])
        # Of a device that counts steps most differences are 0.
        sigma = max(sigma, float(np.quantile(distance, _SHARES[1]))) if not np.median(distance) else sigma
        return max(sigma, 1.0) if self._is_stated else sigma


class _Rows:
    """Rows in groups of the same keys (n, k), each in the order of measurement."""

    def __init__(self, keys: np.ndarray) -> None:
        self.order = np.lexsort((np.arange(len(keys)), *keys.T[::-1]))
        self.begins = np.ones(len(keys), dtype=bool)
        self.begins[1:] = (keys[self.order][1:] != keys[self.order][:-1]).any(axis=1)
        self.group = np.cumsum(self.begins)

    def run_length(self, is_one: np.ndarray) -> np.ndarray:
        """Give the length of the run of equal marks that each row is in, (n,)."""
        marks = is_one[self.order]
        begins = self.begins.copy()
        begins[1:] |= marks[1:] != marks[:-1]
        run = np.cumsum(begins) - 1
        length = np.empty(len(marks), dtype=np.int64)
        length[self.order] = np.bincount(run, minlength=1)[run]
        return length

    def alike(
        self, whitened: Numbers, n_numbers: np.ndarray, is_far: np.ndarray, is_stated: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Count the neighbours of each row that differ from it as neighbours do, or nearly so, and all, (n,) each.

        Far rows that stand beside each other are no mistakes: where many do, it is they who tell how much neighbours
        differ.
        """
        left, counted, far = whitened[self.order], n_numbers[self.order], is_far[self.order]
        alike, nearly, neighbours = np.zeros((3, len(left)), dtype=np.int64)
        sigma = 0.0
        for step in range(1, _LONGEST_MISTAKE + 1):
            is_pair = self.group[step:] == self.group[:-step]
            distance = np.sqrt(0.5 * ((left[step:] - left[:-step]) ** 2).sum(axis=1))
            counts = np.minimum(counted[step:], counted[:-step])
            if step == 1:
                sigma = robust_scale(distance[is_pair], counts[is_pair])
                sigma = max(sigma, 1.0) if is_stated else sigma
                both = is_pair & far[1:] & far[:-1]
                if both.sum() >= max(_MANY_PAIRS, far.sum() // 4):
                    sigma = max(sigma, robust_scale(distance[both], counts[both]))
            limit = gross_limit(counts) * sigma
            is_near, is_nearly = is_pair & (distance <= limit), is_pair & (distance <= _CLEARLY * limit)
            for own in (slice(step, None), slice(None, -step)):
                alike[self.order[own]] += is_near
                nearly[self.order[own]] += is_nearly
                neighbours[self.order[own]] += is_pair
        return alike, nearly, neighbours
