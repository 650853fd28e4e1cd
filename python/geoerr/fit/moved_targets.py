"""Targets that moved on what carries them, while the others stayed: somebody touched a plate, or its glue let go.

No formula of a machine or of its cameras moves one plate of several. Left in its old place it is lost steps, a tilt
and a step of the rig, whatever explains a part of it. So it is told before anything is fitted, from visits of one
place, approached from one side, before and after a moment k: with place means m̄ and the jump d,

    m_i = μ_place(i) + d · 1[i ≥ k],   gain(k) = |Σ_{i≥k} w_i (m_i − m̄_place(i))|² / Σ_p b_p a_p / (b_p + a_p)

is what a jump takes off the sum of squares (a, b: weights of a place's visits after and before), exactly, for every k
in one pass. It is a plate's own where the others that come back, too, did not move, and no turn of the carrier
explains it. From then on it is another target, with a place of its own to be fitted (`start.target_places`): all rows
stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from geoerr.fit.sightings import SAME_POSITION_MM, SEE_POSITIONS, Integers, Numbers, Sightings
from geoerr.geometry import rigid_columns
from geoerr.observations import CARRIERS
from geoerr.summaries import counted

# What a jump takes off the sum of squares, in variances of what is left: ten standard errors.
_GAIN = 100.0
# And so much more than what moves slowly.
_ABRUPT = 25.0
# Others did not move where they moved by less than this share of it, or by no more than chance does (in variances).
_STAYED, _CHANCE = 0.2, 16.0
# Rows that are off by more than so many times the median count as no more; and of the visits so many say the same.
_WILD, _MOST = 5.0, 0.75
# Of the jumps of all targets on a carrier a turn of it explains less than this share.
_TURNED = 0.8
# And with growth less than this: one that stands far from the others moves nearly alone when its carrier grows.
_GROWN = 0.95
# Targets lie beside one line where their second spread is this share of the first.
_FLAT = 0.05
# What is left of exact data, as a share of the sum of squares.
_ROUND_OFF = 1e-15
# Places that are visited before and after, rows on either side of a fixed target, and others to compare with.
_LEAST_PLACES, _LEAST_ROWS, _LEAST_OTHERS = 4, 5, 2
# Looks from which how a target stands to others tells a moment: twice the numbers of three cubics. What is nothing
# beside the largest of them.
_LEAST_LOOKS, _NOTHING = 20, 1e-9
# Others that are hidden in more looks than this share are left out of what it stands to.
_OFTEN = 0.5


@dataclass(frozen=True, eq=False)
class MovedTarget:
    """A target that moved.

    Attributes
    ----------
    rows
        Its rows from then on.
    last
        The last of its rows before.
    by_mm
        How far, (3,) in the measuring frame.
    """

    rows: Integers
    last: int
    by_mm: Numbers


def moved_targets(sightings: Sightings) -> tuple[MovedTarget, ...]:
    """Find the targets that moved; `sightings.once` keeps them."""
    found: list[MovedTarget] = []
    target = sightings.once("targets", numbers_of_targets)
    for own, kind in zip(sightings.rows_of_sessions, sightings.frames, strict=True):
        if kind in SEE_POSITIONS:
            found += _moved_in(sightings, target, np.arange(own.start, own.stop))
    return tuple(found)


def times_moved(sightings: Sightings) -> Integers:
    """Give how often each row's target had moved by then, (n,)."""
    times = np.zeros(len(sightings), dtype=np.int64)
    for one in sightings.once("moved_targets", moved_targets):
        times[one.rows] += 1
    return times


def targets_that_moved(sightings: Sightings) -> Iterator[str]:
    """Say of each which it is, when it moved and how far."""
    has_names = "target" in sightings.table.columns
    t_s = sightings.numbers("t")
    for one in sightings.once("moved_targets", moved_targets):
        row = int(one.rows[0])
        name = sightings.texts("target")[row] if has_names else ""
        is_fixed = CARRIERS[sightings.carrier[row]] == "base"
        where = "on the base" if is_fixed else f"at {sightings.place_of_target(row)}"
        when = f"between rows {sightings.source_row[one.last] + 1} and {sightings.source_row[row] + 1}"
        if np.isfinite(t_s[[one.last, row]]).all():
            when = f"between t = {t_s[one.last]:g} and {t_s[row]:g} s"
        named = f"{name!r} " if name else ""
        its_rows = f"{counted(len(one.rows), 'row')} from then on {'has' if len(one.rows) == 1 else 'have'}"
        yield (
            f"the target {named}{where} moved by {np.linalg.norm(one.by_mm):.2g} mm {when}, while the others stayed: "
            f"its {its_rows} a place of their own; fasten it"
            + ("" if is_fixed else ", and state its offset as it is now")
        )


def numbers_of_targets(sightings: Sightings) -> Integers:
    """Give every target a number, (n,): by what carries it and its offset, on the base by its name."""
    on_base = sightings.carrier == CARRIERS.index("base")
    offset = np.where(on_base[:, None], 0.0, sightings.offset_mm)
    keys = [sightings.carrier.astype(np.int64), *np.round(offset / SAME_POSITION_MM).astype(np.int64).T]
    if on_base.any() and "target" in sightings.table.columns:
        names = np.unique(np.asarray(sightings.texts("target")), return_inverse=True)[1]
        keys.append(np.where(on_base, names, 0))
    return _numbered(keys)


def _numbered(keys: Sequence[npt.NDArray[np.int64]]) -> Integers:
    return np.unique(np.stack(keys, axis=1), axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _moved_in(sightings: Sightings, target: Integers, rows: Integers) -> Iterator[MovedTarget]:
    """Find those of one session, the clearest first; each is two targets afterwards."""
    rows = rows[sightings.is_measured[rows].all(axis=1)]
    own = target[rows].copy()
    while len(np.unique(own)) > 1:
        visits = {number: _Visits.of(sightings, rows[own == number]) for number in np.unique(own).tolist()}
        best = _clearest(sightings, visits)
        if best is None:
            return
        yield best
        own[np.isin(rows, best.rows)] = own.max() + 1


def _clearest(sightings: Sightings, visits: dict[int, _Visits]) -> MovedTarget | None:
    """Give the target that moved most clearly while the others stayed; None where none did."""
    clear = []
    for number, own in visits.items():
        place = own.clearest()
        if place is not None and _moved_alone(sightings, visits, number, own.rows[place]):
            clear.append((own.gain[place - 1] / own.left(place), number, place))
    if not clear:
        return None
    _, number, found = max(clear)
    own = visits[number]
    place = _moment(sightings, [one for other, one in visits.items() if other != number], own, found)
    return MovedTarget(own.rows[place:], int(own.rows[place - 1]), own.jump_mm(found))


def _moment(sightings: Sightings, others: Sequence[_Visits], own: _Visits, place: int) -> int:
    """Give where a target jumped, which visits leave open where only few places are come back to.

    How it stands to others on its carrier, at every look at all, knows no places: the jump is in it, and of the
    machine how the carrier turns from place to place. Both count by what they leave.
    """
    if own.is_fixed:
        return place
    relative_mm = _beside_others(sightings, own, [one for one in others if one.carrier == own.carrier])
    seen = np.flatnonzero(np.isfinite(relative_mm).all(axis=1))
    if len(seen) < _LEAST_LOOKS:
        return place
    # Cubics of each axis; of one that rests nothing.
    q = sightings.commanded_mm[own.rows[seen]]
    q = (q - q.mean(axis=0)) / np.maximum(np.ptp(q, axis=0), SAME_POSITION_MM)
    turned, size, _ = np.linalg.svd(np.column_stack([np.ones(len(q)), q, q**2, q**3]), full_matrices=False)
    turned = turned[:, size > _NOTHING * size[0]]
    dof = 3 * (len(seen) - turned.shape[1])
    left = relative_mm[seen] - turned @ (turned.T @ relative_mm[seen])
    # |P (r − 1[i ≥ k] d)|² for every k at once: P takes the cubics out, and sums run from behind.
    behind = np.cumsum(np.column_stack([left, turned])[::-1], axis=0)[::-1]
    by_mm, count = own.jump_mm(place), np.arange(len(seen), 0, -1)
    rest = (left**2).sum() - 2.0 * behind[:, :3] @ by_mm
    rest += (by_mm @ by_mm) * (count - (behind[:, 3:] ** 2).sum(axis=1))
    is_open = [own.is_comparable(int(one)) for one in seen]
    if not any(is_open) or not rest[is_open].min() > 0.0:
        return place
    moments, rest = seen[is_open], rest[is_open]
    likely = own.gain[moments - 1] / own.left(place) - rest * dof / rest.min()
    return int(moments[np.argmax(likely)])


def _beside_others(sightings: Sightings, own: _Visits, others: Sequence[_Visits]) -> Numbers:
    """Give where a target stands to the mean of others that were seen with it, (n, 3); NaN where none was."""
    here = sightings.commanded_mm[own.rows]
    seen: list[np.ndarray] = []
    stands_mm: list[Numbers] = []
    for one in others:
        # The row of the same look is a neighbour in the table.
        behind = np.searchsorted(one.rows, own.rows)
        near = np.stack([np.clip(behind - 1, 0, len(one.rows) - 1), np.clip(behind, 0, len(one.rows) - 1)])
        off = np.abs(one.rows[near] - own.rows)
        there = np.abs(sightings.commanded_mm[one.rows[near]] - here).max(axis=2)
        off = np.where(there <= SAME_POSITION_MM, off, len(sightings))
        row = one.rows[np.take_along_axis(near, np.argmin(off, axis=0)[None], axis=0)[0]]
        is_seen = off.min(axis=0) < len(sightings)
        # One that was touched itself is two, each of which is there for a part of the time.
        if is_seen.mean() > _OFTEN:
            seen.append(is_seen)
            stands_mm.append(sightings.measured_mm[row])
    if not seen:
        return np.full((len(own.rows), 3), np.nan)
    # A mean of others than before would be another place.
    mean_mm = np.where(np.all(seen, axis=0)[:, None], np.mean(stands_mm, axis=0), np.nan)
    return np.asarray(sightings.measured_mm[own.rows] - mean_mm)


def _moved_alone(sightings: Sightings, visits: dict[int, _Visits], number: int, moment: int) -> bool:
    """Tell whether the others that come back after a row stayed where they were, and the carrier did not turn."""
    own = visits[number]
    place = own.place_of(moment)
    by_mm = own.jump_mm(place)
    is_fixed = own.is_fixed
    others = []
    for other, one in visits.items():
        at = one.place_of(moment)
        if other == number or not one.is_comparable(at) or not (is_fixed or one.carrier == own.carrier):
            continue
        if one.jumps_elsewhere(at):
            # It moved, too, at another time, and says nothing of this.
            continue
        moved_mm = one.jump_mm(at)
        stayed = np.linalg.norm(moved_mm) <= _STAYED * np.linalg.norm(by_mm)
        if not stayed and one.gain[at - 1] > _CHANCE * one.left(at):
            return False
        others.append((one, moved_mm))
    if len(others) < _LEAST_OTHERS:
        return False
    if is_fixed:
        return (
            own.is_abrupt(place) and _unturned_share(own, place, [one for one, _ in others], moment) > 1.0 - _TURNED
        )
    together = [own, *(one for one, _ in others)]
    jumps_mm = np.array([by_mm, *(moved_mm for _, moved_mm in others)])
    turned, grown = _shares(sightings, together, jumps_mm)
    limit = _GROWN if own.is_abrupt(place) else _TURNED
    return turned < _TURNED and grown < limit


def _unturned_share(own: _Visits, place: int, others: Sequence[_Visits], moment: int) -> float:
    """Give the share of a fixed target's jump that no turn of the cameras explains which the others saw, too."""
    seen = [(one, one.place_of(moment)) for one in others]
    points = np.concatenate([one.stands_mm(at) for one, at in seen])
    jumps = np.concatenate([one.jumps_mm(at) for one, at in seen])
    middle = points.mean(axis=0)
    columns = rigid_columns(points - middle)
    rigid = np.linalg.lstsq(columns, jumps.reshape(-1), rcond=None)[0]
    by_mm = own.jump_mm(place)
    left = by_mm - rigid_columns(own.stands_mm(place)[:1] - middle) @ rigid
    return float((left**2).sum() / (by_mm**2).sum())


def _shares(sightings: Sightings, targets: Sequence[_Visits], jumps_mm: Numbers) -> tuple[float, float]:
    """Give the share of the squares of jumps (k, 3) that a shift and a turn explain; and these and growth."""
    offset_mm = np.array([sightings.offset_mm[one.rows[0]] for one in targets])
    offset_mm -= offset_mm.mean(axis=0)
    seen = _stand_mm(sightings, targets)
    if seen is None:
        # Nobody knows how the measuring frame stands to the carrier: it may have turned.
        return 1.0, 1.0
    spread, along = np.linalg.svd(offset_mm, full_matrices=False)[1:]
    if spread[1] > _FLAT * spread[0]:
        turn = Rotation.align_vectors(seen - seen.mean(axis=0), offset_mm)[0].as_matrix()
        turned = rigid_columns(offset_mm @ turn.T)
        grown = np.column_stack([turned, (offset_mm @ turn.T).reshape(-1)])
    else:
        # On one line: whatever grows along it.
        shift = np.tile(np.eye(3), (len(targets), 1))
        turned = grown = np.column_stack([shift, np.kron(offset_mm @ along[:1].T, np.eye(3))])
    return _explained(turned, jumps_mm), _explained(grown, jumps_mm)


def _explained(columns: Numbers, jumps_mm: Numbers) -> float:
    flat = jumps_mm.reshape(-1)
    left = flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]
    return 1.0 - float((left**2).sum() / (flat**2).sum())


def _stand_mm(sightings: Sightings, targets: Sequence[_Visits]) -> Numbers | None:
    """Give how targets stand to each other (k, 3), in the measuring frame, where all were seen; None where never."""
    places = [np.round(sightings.commanded_mm[one.rows] / SAME_POSITION_MM).astype(np.int64) for one in targets]
    numbers = np.split(_numbered([*np.concatenate(places).T]), np.cumsum([len(own) for own in places])[:-1])
    first = [dict(zip(own[::-1].tolist(), range(len(own) - 1, -1, -1), strict=True)) for own in numbers]
    common = sorted(set(first[0]).intersection(*first[1:]))
    if not common:
        return None
    rows = [one.rows[[at[place] for place in common]] for one, at in zip(targets, first, strict=True)]
    return np.array([sightings.measured_mm[own].mean(axis=0) for own in rows])


@dataclass(frozen=True, eq=False)
class _Visits:
    """What visits of one place differ by, for a target of one session.

    Attributes
    ----------
    rows : (n,)
        In the order of measurement.
    carrier
        Place in `CARRIERS`.
    gain : (n − 1,)
        What a jump before row 1, 2, ... takes off the sum of squares.
    straddling : (n − 1,)
        Places that are visited before and after.
    smooth
        What a cubic in the order of the rows takes off the sum of squares.
    place : (n,)
        Number of the place of each.
    first_mm, measured_mm : (3,), (n, 3)
        Where it was first, and what was measured from there.
    total
        Sum of squares off the means of places.
    dof
        Numbers that are left beside a jump.
    """

    rows: Integers
    carrier: int
    place: Integers
    first_mm: Numbers
    measured_mm: Numbers
    gain: Numbers
    straddling: Integers
    smooth: float
    total: float
    dof: int

    @classmethod
    def of(cls, sightings: Sightings, rows: Integers) -> _Visits:
        """Work it out for rows (n,)."""
        carrier = int(sightings.carrier[rows[0]])
        place = np.zeros(len(rows), dtype=np.int64)
        if carrier != CARRIERS.index("base"):
            q = np.round(sightings.commanded_mm[rows] / SAME_POSITION_MM).astype(np.int64)
            place = _numbered([*q.T, *_way_there(q).T])
        w = np.einsum("nij,nij->n", sightings.whitening[rows], sightings.whitening[rows]) / 3.0
        whole = np.bincount(place, w)
        measured = sightings.measured_mm[rows] - sightings.measured_mm[rows[0]]
        mean = np.stack([np.bincount(place, w * values) / whole for values in measured.T], axis=1)
        off = _without_wild(measured - mean[place])
        # A sum over the visits of a place is 0 again: what the gain of a jump rests on.
        off -= np.stack([np.bincount(place, w * values) / whole for values in off.T], axis=1)[place]
        # Weight of the earlier visits of each row's place, by the rows of each place in their order.
        order = np.argsort(place, kind="stable")
        first = np.flatnonzero(np.diff(place[order], prepend=-1))
        counts = np.diff([*first, len(rows)])
        before_all = np.cumsum(w[order]) - w[order]
        before = np.empty(len(rows))
        before[order] = before_all - np.repeat(before_all[first], counts)
        begins, ends = np.zeros(len(rows), dtype=np.int64), np.zeros(len(rows), dtype=np.int64)
        begins[order[first]] = 1
        ends[order[first + counts - 1]] = 1
        rest = whole[place] - before
        weight = np.cumsum(((before + w) * (rest - w) - before * rest) / whole[place])[:-1]
        moment = -np.cumsum(w[:, None] * off, axis=0)[:-1]
        straddling = np.cumsum(begins - ends)[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = np.where(straddling > 0, (moment**2).sum(axis=1) / weight, 0.0)
        total = float((w * (off**2).sum(axis=1)).sum())
        dof = 3 * (len(rows) - len(whole) - 1)
        order_of = np.linspace(-1.0, 1.0, len(rows))
        cubic = np.stack([order_of, order_of**2, order_of**3], axis=1)
        cubic -= np.stack([np.bincount(place, w * values) / whole for values in cubic.T], axis=1)[place]
        root = np.sqrt(w)[:, None]
        left = root * (off - cubic @ np.linalg.lstsq(root * cubic, root * off, rcond=None)[0])
        smooth = total - float((left**2).sum())
        return cls(
            rows, carrier, place, sightings.measured_mm[rows[0]], measured, gain, straddling, smooth, total, dof
        )

    @property
    def is_fixed(self) -> bool:
        """Whether it sits on the base, and every row is a visit of its place."""
        return self.carrier == CARRIERS.index("base")

    def place_of(self, row: int) -> int:
        """Give the place of the first of these rows that is not before a row of the session."""
        return int(np.searchsorted(self.rows, row))

    def is_comparable(self, place: int) -> bool:
        """Tell whether visits before and after a place say by how much it moved between."""
        if not 0 < place < len(self.rows) or self.dof < 1:
            return False
        if self.is_fixed:
            return min(place, len(self.rows) - place) >= _LEAST_ROWS
        return bool(self.straddling[place - 1] >= _LEAST_PLACES)

    def clearest(self) -> int | None:
        """Give where a jump takes most off, if that is no chance."""
        if len(self.gain) == 0 or self.dof < 1:
            return None
        place = int(np.argmax(self.gain)) + 1
        is_clear = self.is_comparable(place) and self.gain[place - 1] > _GAIN * self.left(place)
        if not is_clear or not self._is_seen_everywhere(place):
            return None
        # Data without noise differ by round-off.
        return place if float(np.linalg.norm(self.jump_mm(place))) > SAME_POSITION_MM else None

    def left(self, place: int) -> float:
        """Give the variance of a number beside a jump, in the unit of the weights."""
        return max(self.total - float(self.gain[place - 1]), _ROUND_OFF * self.total) / self.dof

    def is_abrupt(self, place: int) -> bool:
        """Tell whether it jumped, by more than chance can be told from what moves slowly."""
        return bool(self.gain[place - 1] - self.smooth > _ABRUPT * self.left(place))

    def jumps_elsewhere(self, place: int) -> bool:
        """Tell whether it jumped itself, and not there: with the other jump most is left, and with its own little."""
        own = self.clearest()
        return own is not None and own != place and self.is_abrupt(own) and self.left(own) < 0.5 * self.left(place)

    def jump_mm(self, place: int) -> Numbers:
        """Give by how much it moved, (3,), as most of its places say."""
        return np.asarray(np.median(self.jumps_mm(place), axis=0))

    def _is_seen_everywhere(self, place: int) -> bool:
        """Tell whether most visits say the same: a wild row makes a jump of a few places."""
        jumps = self.jumps_mm(place)
        by_mm = np.median(jumps, axis=0)
        is_alike = np.linalg.norm(jumps - by_mm, axis=1) < 0.5 * np.linalg.norm(by_mm)
        return bool(is_alike.mean() > _MOST)

    def stands_mm(self, place: int) -> Numbers:
        """Give where the places are that say something of a jump, (k, 3), in the order of `jumps_mm`."""
        if self.is_fixed:
            return np.asarray(self.first_mm + self.measured_mm[place:])
        before, after = (
            np.bincount(self.place[rows], minlength=int(self.place.max()) + 1) for rows in self._sides(place)
        )
        first = np.unique(self.place, return_index=True)[1]
        return np.asarray(self.first_mm + self.measured_mm[first[(before > 0) & (after > 0)]])

    @staticmethod
    def _sides(place: int) -> tuple[slice, slice]:
        return slice(None, place), slice(place, None)

    def jumps_mm(self, place: int) -> Numbers:
        """Give what every place says of a jump, (k, 3); of a fixed target every row behind it."""
        if self.is_fixed:
            return np.asarray(self.measured_mm[place:] - np.median(self.measured_mm[:place], axis=0))
        n_places = int(self.place.max()) + 1
        means, counts = [], []
        for rows in self._sides(place):
            count = np.bincount(self.place[rows], minlength=n_places)
            sums = [np.bincount(self.place[rows], values, n_places) for values in self.measured_mm[rows].T]
            means.append(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])
            counts.append(count)
        return np.asarray((means[1] - means[0])[(counts[0] > 0) & (counts[1] > 0)])


def _way_there(q: Integers) -> Integers:
    """Give which way each axis went to positions (n, 3) in their order, 0 where it rested: play shows by it.

    From where a resting axis once came is no matter here: that would move all targets alike.
    """
    way = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    last = np.maximum.accumulate(np.where(way.any(axis=1), np.arange(len(q)), 0))
    return np.asarray(way[last])


def _without_wild(off_mm: Numbers) -> Numbers:
    """Give deviations (n, 3) no longer than rows usually are off, several times over."""
    length = np.linalg.norm(off_mm, axis=1)
    far = length > 0.0
    most = _WILD * float(np.median(length[far])) if far.any() else 0.0
    with np.errstate(divide="ignore"):
        return off_mm * np.minimum(most / np.where(far, length, 1.0), 1.0)[:, None]
