"""Circular tests as a diagnosis needs them: runs, angles, the radius beyond the model and the set-up.

A run is what was driven once: one set-up, one line, one sense, one feed, one repetition. What of the radius a machine
without errors (or the model that is held) and the free set-up of the bar do not explain is the signal.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl

from geoerr.commanded_circle import (
    circle_through,
    coarse_step_mm,
    far_from_radius,
    no_radius,
    other_radius,
    plane_of,
)
from geoerr.errors import GeometryError
from geoerr.fit import Fitted
from geoerr.fit.sightings import Numbers
from geoerr.fit.variables import times_s
from geoerr.observations import CircularTest
from geoerr.tables import RowProblem

UM_PER_MM = 1e3
# A commanded position farther from its run's circle than this share of the radius is not a point of the circle.
_OFF_CIRCLE = 1e-2
# Shorter arcs lose most of every cause to centre and radius of the set-up.
_LEAST_ARC_RAD = np.pi
_FEWEST_ROWS = 24
# No ball bar runs a smaller circle.
_LEAST_RADIUS_MM = 1.0
# Copies of rows, as a share of a run.
_MANY_REPEATS = 0.4
# A feed and the times of its run disagree where they differ by more than this, as a logarithm: dwells take some.
_OTHER_FEED = 0.5
# Feeds that differ by less than this share are one.
SAME_FEED = 0.02
# Finer than half a degree a bar shows its own noise; and the search's memory grows with the rows of all runs.
_MOST_ROWS, _MOST_ROWS_IN_ALL, _LEAST_ROWS = 720, 3000, 180
# Between runs of one set-up whose clocks start anew.
_PAUSE_S = 1.0
_KEYS = ("session", "line", "repeat", "feed", "dir")


@dataclass(frozen=True, eq=False)
class Runs:
    """Rows of circular tests that take part, run after run.

    Attributes
    ----------
    fitted
        The fit of the set-up: every line of a session has one centre and one radius.
    rows : (n,)
        Their places in `fitted.sightings`; of an average that of its middle row.
    members, counts : (m,), (n,)
        Places of all rows, and how many of them each row is the average of: one, where none is.
    measured_um : (n,)
        Radius as it was read.
    signal_um : (n,)
        Radius beyond the model and the set-up.
    weight : (n,)
        Stated standard uncertainty of each row over the mean one; 1 where none is stated.
    run : (n,)
        Number of each row's run; runs are sorted, rows of a run in the order of measurement.
    angle_rad : (n,)
        Of the commanded position about the commanded centre, from the first axis of the plane to the second.
    travelled_rad : (n,)
        Angle travelled since the run's first row, and rising.
    time_s : (n,)
    doubt_um : (n, k)
        How far a model that is held may be off: each column one standard deviation, independent of the others.
    plane, sense, feed_mm_min, radius_mm, centre_mm, set_up
        Of each run: `xy`, `yz` or `zx`; ±1 (+1 counter-clockwise seen from + of the third axis); NaN where neither a
        feed nor times are known; (m, 3); number of its set-up.
    names
        Of each run.
    has_times
        Whether times are known, stated or by the feed.
    set_aside
        Rows that could not be used.
    notes
        What had to be taken from elsewhere.
    whole
        Of averages the runs that they are of.
    """

    fitted: Fitted
    rows: np.ndarray
    members: np.ndarray
    counts: np.ndarray
    measured_um: Numbers
    signal_um: Numbers
    weight: Numbers
    run: np.ndarray
    angle_rad: Numbers
    travelled_rad: Numbers
    time_s: Numbers
    doubt_um: Numbers
    plane: tuple[str, ...]
    sense: np.ndarray
    feed_mm_min: Numbers
    radius_mm: Numbers
    centre_mm: Numbers
    set_up: np.ndarray
    names: tuple[str, ...]
    has_times: bool
    set_aside: tuple[RowProblem, ...] = ()
    notes: tuple[str, ...] = ()
    whole: Runs | None = None

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def n_runs(self) -> int:
        """Number of runs."""
        return len(self.plane)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Rows of each run."""
        ends = np.searchsorted(self.run, np.arange(self.n_runs + 1))
        return tuple(slice(a, b) for a, b in itertools.pairwise(ends.tolist()))

    @cached_property
    def planes(self) -> tuple[str, ...]:
        """Different planes, in order."""
        return tuple(dict.fromkeys(self.plane))

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that move in some run."""
        return tuple(axis for axis in "xyz" if any(axis in plane for plane in self.planes))

    @cached_property
    def set_up_columns(self) -> Numbers:
        """What the set-up (and a model's own freedom) can do to the radius, (n, r)."""
        fitted = self.fitted
        n = len(fitted.sightings)
        design = fitted.problem.design(fitted.solved.state, np.ones(n), 0, n, fitted.threads)
        scale = fitted.sightings.whitening[:, 0, 0]
        return self.averages_of((design.reshape(n, 3, -1)[:, 0] / scale[:, None])[self.members])

    def averages_of(self, values: Numbers) -> Numbers:
        """Give what the rows have of numbers (m, k) of their members, (n, k)."""
        if len(self.members) == len(self.rows):
            return values
        starts = np.cumsum(self.counts) - self.counts
        return np.asarray(np.add.reduceat(values, starts) / self.counts[:, None])

    def has_both_senses(self, plane: str) -> bool:
        """Tell whether a plane was run in both senses."""
        return len({int(s) for s, p in zip(self.sense, self.plane, strict=True) if p == plane}) == 2

    def feeds(self, plane: str | None = None) -> Numbers:
        """Give the different feeds, (k,), of one plane or of all."""
        own = np.array([plane is None or one == plane for one in self.plane])
        found = np.unique(self.feed_mm_min[own & np.isfinite(self.feed_mm_min)])
        return found[np.concatenate([[True], np.diff(found) > SAME_FEED * found[:-1]])] if len(found) else found

    def without(self, rows: np.ndarray) -> Runs:
        """Give the same without some rows (n,)."""
        kept = ~rows
        names = ("rows", "measured_um", "signal_um", "weight", "run", "angle_rad", "travelled_rad", "time_s")
        own = {name: getattr(self, name)[kept] for name in (*names, "doubt_um", "counts")}
        return replace(self, members=self.members[np.repeat(kept, self.counts)], **own)

    def averaged(self) -> Runs:
        """Give the same with neighbouring rows averaged where there are more than the search needs.

        An average stands where its middle row does; what a cause does to it is averaged likewise (`averages_of`): a
        wave of few rows to an average is flatter there, and not another wave.
        """
        most = max(min(_MOST_ROWS, _MOST_ROWS_IN_ALL // self.n_runs), _LEAST_ROWS)
        if all(own.stop - own.start <= most for own in self.slices):
            return self
        starts = np.concatenate(
            [
                own.start + (np.arange(k) * n) // k
                for own in self.slices
                for n in [own.stop - own.start]
                for k in [min(n, most)]
            ]
        )
        counts = np.diff(np.append(starts, len(self)))
        middle = starts + counts // 2
        measured, signal = (np.add.reduceat(own, starts) / counts for own in (self.measured_um, self.signal_um))
        names = ("rows", "weight", "run", "angle_rad", "travelled_rad", "time_s", "doubt_um")
        note = (
            f"{counts.mean():.1f} neighbouring rows were averaged to one; waves that are too fast for these are "
            "looked for where the rows themselves show one clearly"
        )
        others = {name: getattr(self, name)[middle] for name in names}
        return replace(
            self,
            measured_um=measured,
            signal_um=signal,
            counts=counts,
            notes=(*self.notes, note),
            whole=self,
            **others,
        )


def checked(tests: tuple[CircularTest, ...]) -> tuple[tuple[CircularTest, ...], list[RowProblem], list[str]]:
    """Fill in senses and times, and set aside what is no circular run.

    Raises
    ------
    GeometryError
        where no run can be used.
    """
    problems = [problem for test in tests for problem in test.set_aside]
    notes: dict[str, None] = {}
    result = []
    for test in tests:
        frame = test.frame
        path = test.sources[0] if test.sources else "-"
        if "file_row" not in frame.columns:
            frame = frame.with_columns(pl.int_range(2, frame.height + 2).alias("file_row"))
        frame = _with_senses(frame)
        present = [name for name in _KEYS if name in frame.columns]
        parts = []
        for part in frame.partition_by(present, maintain_order=True):
            kept, found = _usable(part, path)
            problems += found
            if kept is not None:
                parts.append(kept)
        steps_mm = {coarse_step_mm(part.select("x", "y", "z").to_numpy().astype(np.float64)) for part in parts}
        for step in sorted(one for one in steps_mm if one is not None):
            notes[
                f"{path}: commanded positions are whole multiples of {step:g} mm: where the file rounds them and the "
                "program does not, what that leaves at each angle looks like waves of both axes; write them finer"
            ] = None
        turned = sum(_goes_against_dir(part) for part in parts)
        if turned:
            notes[
                f"{path}: in {turned} of {len(parts)} runs the rows go round the other way than dir says, which is "
                "right where they are in the order of their angles; in the order of measurement dir is wrong, and "
                "what differs between the senses (backlash, servo) comes out with the opposite sign"
            ] = None
        others = filter(None, map(_other_radius_of, parts))
        notes |= dict.fromkeys(f"{path}: {other}" for other in others)
        if parts:
            timed, told = _with_times(parts)
            notes |= dict.fromkeys(told)
            result.append(CircularTest(timed, test.sources, test.set_aside))
    if not result:
        why = problems[-1].problem if problems else "there are no rows"
        raise GeometryError(
            f"no run of the circular test can be diagnosed: {why}\n"
            "hint: a run needs half a turn at least, commanded positions x y z on a circle, and the radius r in mm"
        )
    return tuple(result), problems, list(notes)


def runs_of(
    fitted: Fitted,
    problems: list[RowProblem] | None = None,
    notes: list[str] | None = None,
    doubt: Numbers | None = None,
) -> Runs:
    """Sort a fit of circular tests into runs; `doubt` (n, 3, k) is how far a held model may be off (`own_doubt`)."""
    sightings = fitted.sightings
    times = times_s(sightings)
    stated = np.sign(np.nan_to_num(sightings.numbers("dir")))
    feed = sightings.numbers("feed")
    lines = sightings.texts("line") if "line" in sightings.table.columns else [""] * len(sightings)
    order, planes, senses, feeds, radii, centres, set_ups, names = [], [], [], [], [], [], [], []
    by_feed: list[tuple[float, float]] = []
    angle, travelled = np.zeros(len(sightings)), np.zeros(len(sightings))
    for number in range(sightings.n_passes):
        rows = np.flatnonzero(sightings.pass_number == number)
        if not rows.size:
            continue
        rows = rows[np.argsort(times[rows], kind="stable")]
        q = sightings.commanded_mm[rows]
        first, second, third = plane_of(q)
        centre, radius = circle_through(q[:, [first, second]])
        arm = q[:, [first, second]] - centre
        own = np.arctan2(arm[:, 1], arm[:, 0])
        unwrapped = np.unwrap(own)
        # Rows in the order of their angles may go round the other way than the machine did.
        way = float(np.sign(unwrapped[-1] - unwrapped[0])) or 1.0
        sense = float(stated[rows[0]]) or way
        angle[rows], travelled[rows] = own, way * (unwrapped - unwrapped[0])
        known = float(np.nanmedian(feed[rows])) if np.isfinite(feed[rows]).any() else np.nan
        span = float(times[rows[-1]] - times[rows[0]]) if _has_times(fitted) else 0.0
        by_times = 60.0 * radius * float(travelled[rows[-1]]) / span if span > 0.0 else np.nan
        if known > 0.0 and by_times > 0.0 and abs(np.log(by_times / known)) > _OTHER_FEED:
            by_feed.append((known, by_times))
        known = by_times if np.isnan(known) else known
        place = np.zeros(3)
        place[[first, second]], place[third] = centre, float(np.median(q[:, third]))
        order.append(rows)
        planes.append("xyz"[first] + "xyz"[second])
        senses.append(int(sense))
        feeds.append(float(known))
        radii.append(radius)
        centres.append(place)
        set_ups.append(int(sightings.session[rows[0]]))
        words = [lines[rows[0]], f"dir {int(sense):+d}", f"feed {known:.6g}" if np.isfinite(known) else ""]
        names.append(", ".join(word for word in words if word))
    rows = np.concatenate(order)
    std = 1.0 / sightings.whitening[rows, 0, 0]
    return Runs(
        fitted=fitted,
        rows=rows,
        members=rows,
        counts=np.ones(len(rows), dtype=np.int64),
        measured_um=UM_PER_MM * sightings.measured_mm[rows, 0],
        signal_um=UM_PER_MM * fitted.solved.residual_mm[rows, 0],
        weight=std / float(std.mean()),
        run=np.repeat(np.arange(len(order)), [len(own) for own in order]),
        angle_rad=angle[rows],
        travelled_rad=travelled[rows],
        time_s=times[rows],
        doubt_um=np.zeros((len(rows), 0)) if doubt is None else UM_PER_MM * doubt[rows, 0] * std[:, None],
        plane=tuple(planes),
        sense=np.array(senses),
        feed_mm_min=np.array(feeds),
        radius_mm=np.array(radii),
        centre_mm=np.array(centres),
        set_up=np.array(set_ups),
        names=tuple(names),
        has_times=_has_times(fitted),
        set_aside=tuple(problems or ()),
        notes=(*(notes or ()), *_feed_notes(by_feed), *_size_notes(radii)),
    )


def _feed_notes(by_feed: list[tuple[float, float]]) -> list[str]:
    """Say of how many runs the feed is not that of their times, with the first of them."""
    if not by_feed:
        return []
    (stated, by_times), n = by_feed[0], len(by_feed)
    return [
        f"in {n} run{'s' * (n > 1)} the feed is not that of the times ({stated:.4g} and {by_times:.4g} mm/min): what "
        "follows the speed is told by the feed; feed is in mm/min and t in seconds"
    ]


def _has_times(fitted: Fitted) -> bool:
    return bool(np.isfinite(fitted.sightings.numbers("t")).all())


def _with_senses(frame: pl.DataFrame) -> pl.DataFrame:
    """Fill in `dir` from the order of rows where it is not stated."""
    if "dir" in frame.columns and not frame["dir"].null_count() and not (frame["dir"] == 0).any():
        return frame
    keys = [name for name in _KEYS if name in frame.columns and name != "dir"]
    indexed = frame.with_columns(pl.int_range(frame.height).alias("_place"))
    sense = np.zeros(frame.height, dtype=np.int64)
    for part in indexed.partition_by(keys, maintain_order=True) if keys else [indexed]:
        step = _turns(_arms(part)[0])
        steps = np.sign(np.append(step[:1], step))
        sense[part["_place"].to_numpy()] = np.where(steps == 0.0, np.sign(steps.sum()) or 1.0, steps)
    known = pl.Series("dir", sense)
    if "dir" in frame.columns:
        stated = frame["dir"].cast(pl.Int64)
        known = pl.select(pl.when((stated == 0) | stated.is_null()).then(known).otherwise(stated).alias("dir"))["dir"]
    return frame.with_columns(known)


def _other_radius_of(part: pl.DataFrame) -> str | None:
    return other_radius(part["r"].to_numpy().astype(np.float64), _arms(part)[1])


def _size_notes(radii_mm: list[float]) -> list[str]:
    """Say that circles are too small for any machine's."""
    least_mm = min(radii_mm)
    if least_mm >= _LEAST_RADIUS_MM:
        return []
    return [f"the commanded circle has a radius of {least_mm:.3g} mm: x, y, z and r are in millimetres"]


def _without_repeats(part: pl.DataFrame, path: str) -> tuple[list[RowProblem], pl.DataFrame]:
    """Set rows aside that say the same as another of their run in every cell: a file that was appended to itself.

    Without times a further turn may well read the same at some places; not at most.
    """
    told = [name for name in part.columns if name != "file_row"]
    is_first = part.select(pl.struct(told).is_first_distinct()).to_series()
    n_repeats = int((~is_first).sum())
    has_times = "t" in part.columns and not part["t"].null_count()
    if not n_repeats or not (has_times or n_repeats > _MANY_REPEATS * part.height):
        return [], part
    rows = part.filter(~is_first)["file_row"].to_list()
    problem = "another row of the run says the same in every cell: a copy; nothing was read twice"
    return [RowProblem(path, int(row), "r", problem) for row in rows], part.filter(is_first)


def _usable(part: pl.DataFrame, path: str) -> tuple[pl.DataFrame | None, list[RowProblem]]:
    """Give a run's rows on its circle, and what is wrong with the others; None where the run is of no use."""
    row = int(part["file_row"][0])

    def none(problem: str, column: str = "x y z") -> tuple[None, list[RowProblem]]:
        return None, [RowProblem(path, row, column, problem)]

    if part.height < _FEWEST_ROWS:
        return none(f"the run has {part.height} rows, {_FEWEST_ROWS} are needed", "r")
    repeats, part = _without_repeats(part, path)
    if part.height < _FEWEST_ROWS:
        return none(f"the run has {part.height} rows but for repeated ones, {_FEWEST_ROWS} are needed", "r")
    q = part.select("x", "y", "z").to_numpy().astype(np.float64)
    first, second, third = plane_of(q)
    centre, radius = circle_through(q[:, [first, second]])
    distance = np.hypot(*(q[:, [first, second]] - centre).T)
    # One stray row pulls the circle; a second fit without the strays judges all rows.
    stray = np.abs(distance - radius) > 3.0 * float(np.median(np.abs(distance - radius))) + 1e-9
    if stray.any() and (~stray).sum() > part.height / 2:
        centre, radius = circle_through(q[~stray][:, [first, second]])
        distance = np.hypot(*(q[:, [first, second]] - centre).T)
    off = np.abs(distance - radius) > _OFF_CIRCLE * radius
    off |= np.abs(q[:, third] - np.median(q[:, third])) > _OFF_CIRCLE * radius
    if off.sum() * 2 >= part.height:
        return none("most commanded positions lie on no common circle in a plane of the machine")
    measured = part["r"].to_numpy().astype(np.float64)
    remedy = no_radius(measured, radius)
    if remedy is not None:
        return none(f"r is no radius: its median is {np.median(measured):g} mm of {radius:.6g}: {remedy}", "r")
    mistaken = far_from_radius(measured, radius) & ~off
    arm = q[~off][:, [first, second]] - centre
    covered = np.sort(np.mod(np.arctan2(arm[:, 1], arm[:, 0]), 2.0 * np.pi))
    gaps = np.diff(np.append(covered, covered[0] + 2.0 * np.pi))
    if 2.0 * np.pi - float(gaps.max()) < _LEAST_ARC_RAD:
        arc = np.degrees(2.0 * np.pi - gaps.max())
        return none(f"the run covers {arc:.0f}° of the circle, {np.degrees(_LEAST_ARC_RAD):.0f}° are needed")
    if "t" in part.columns and not part["t"].null_count():
        in_time = np.argsort(part["t"].to_numpy()[~off], kind="stable")
        stated, turned = int(np.sign(part["dir"][0])), _sense(arm[in_time])
        if turned not in (0, stated):
            ways = {1: "counter-clockwise", -1: "clockwise"}
            seen = f"seen from + of {'xyz'[third]}"
            return none(
                f"dir says {ways[stated]}, but by its times the run goes {ways[turned]} ({seen}): "
                f"write dir {turned:+d}, or mend t",
                "dir",
            )
    strays = repeats + [
        RowProblem(path, int(part["file_row"][int(index)]), "x y z", "the commanded position is not on the circle")
        for index in np.flatnonzero(off)
    ]
    strays += [
        RowProblem(
            path, int(part["file_row"][int(index)]), "r", f"{measured[index]:g} mm of a radius of {radius:.6g}"
        )
        for index in np.flatnonzero(mistaken)
    ]
    return part.filter(pl.Series(~off & ~mistaken)), strays


def _arms(part: pl.DataFrame) -> tuple[Numbers, float]:
    """Give a run's points from the centre of their circle (n, 2), in its plane's axes, and its radius."""
    q = part.select("x", "y", "z").to_numpy().astype(np.float64)
    first, second, _ = plane_of(q)
    centre, radius = circle_through(q[:, [first, second]])
    return q[:, [first, second]] - centre, radius


def _turns(arm: Numbers) -> Numbers:
    """Give the angle from each point (n, 2) to the next (n − 1,), the shorter way round, rad."""
    return np.asarray(np.angle(np.exp(1j * np.diff(np.arctan2(arm[:, 1], arm[:, 0])))))


def _sense(arm: Numbers) -> int:
    """Give the sense in which points (n, 2) run: +1 counter-clockwise, −1, or 0 where they do not say."""
    turned = float(_turns(arm).sum())
    return int(np.sign(turned)) if abs(turned) > _LEAST_ARC_RAD / 2.0 else 0


def _goes_against_dir(part: pl.DataFrame) -> bool:
    """Tell whether rows without times run in the other sense than is stated."""
    has_times = "t" in part.columns and not part["t"].null_count()
    return not has_times and _sense(_arms(part)[0]) == -int(np.sign(part["dir"][0]))


def _with_times(parts: list[pl.DataFrame]) -> tuple[pl.DataFrame, list[str]]:
    """Give the runs one after the other, with times that rise within each set-up."""
    notes = []
    is_timed = all("t" in part.columns and not part["t"].null_count() for part in parts)
    is_fed = all("feed" in part.columns and not part["feed"].null_count() for part in parts)
    if not is_timed:
        # Without times rows may be in the order of their angles.
        parts = [part.reverse() if _goes_against_dir(part) else part for part in parts]
    if not is_timed and not is_fed:
        drop = [part.drop("t", strict=False) for part in parts]
        return pl.concat(drop, how="diagonal_relaxed"), ["neither times nor feeds are stated"]
    last: dict[tuple[str, str], float] = {}
    result = []
    if not is_timed:
        notes.append("times are not stated: they follow from the feed")
    for part in parts:
        if is_timed:
            part = part.sort("t", maintain_order=True)
            t = part["t"].to_numpy().astype(np.float64)
        else:
            arm, radius = _arms(part)
            turned = np.abs(np.diff(np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))))
            speed = part["feed"].to_numpy().astype(np.float64) / 60.0
            t = np.concatenate([[0.0], np.cumsum(turned * radius / speed[1:])])
        key = tuple(str(part[name][0]) if name in part.columns else "" for name in ("session", "line"))
        before = last.get((key[0], key[1]))
        if before is not None and t[0] <= before:
            t = t - t[0] + before + _PAUSE_S
        last[key[0], key[1]] = float(t[-1])
        result.append(part.with_columns(pl.Series("t", t)))
    return pl.concat(result, how="diagonal_relaxed"), notes
