"""What the data at hand say of how this machine is measured: where, how fast, what pictures show, how noisily."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoerr.column_names import is_temperature
from geoerr.fit.fitted import Fitted
from geoerr.fit.looks import begins_look
from geoerr.fit.noise import NOT_CONDITIONS
from geoerr.fit.noise_model import NoiseModel
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.start import KINDS
from geoerr.fit.variables import clock_s, times_s
from geoerr.machine import AXES, Machine
from geoerr.observations import CARRIERS, PIXELS
from geoerr.terms import session_numbers

# Where the data do not say: a usual feed of printers and small mills, settling and exposure of a picture at rest,
# and pictures in motion.
_USUAL_FEED_MM_MIN = 3000.0
_USUAL_DWELL_S = 3.0
_USUAL_INTERVAL_S = 0.5
_DWELLS_S = (0.3, 30.0)
_INTERVALS_S = (0.1, 5.0)
# A heated part gets at least so much warmer than its coldest, and one that was never seen to change by so much.
_LEAST_WARMING_K, _USUAL_WARMING_K = 10.0, 20.0
# More kinds of target than bits of a whole number: only the commonest is looked at.
_MOST_KINDS = 62


@dataclass(frozen=True, eq=False)
class Target:
    """A target as a picture shows it.

    Attributes
    ----------
    carrier
        Place in `CARRIERS`.
    offset_mm : (3,)
        `tx ty tz`; of a static one its place in the base frame.
    whitening : (3, 3)
        Of its position, per mm; rows of zeros for what is not measured.
    """

    carrier: int
    offset_mm: Numbers
    whitening: Numbers

    @property
    def is_measured(self) -> np.ndarray:
        """Which components are, (3,)."""
        return np.asarray(np.abs(self.whitening).max(axis=1) > 0.0)


@dataclass(frozen=True, eq=False)
class Situation:
    """How a further measurement of this machine would go.

    Attributes
    ----------
    machine
        The machine.
    span_mm : (3, 2)
        Lowest and highest commanded position of each axis in the data.
    feed_mm_min, top_feed_mm_min
        Usual and highest feed.
    is_in_motion
        Whether pictures are taken in motion, too.
    is_circular
        Whether there are circular tests only.
    radius_mm, centre_mm, plane
        Of circular tests; of what a circle could be otherwise.
    dwell_s, interval_s
        Time of a picture at rest, and between two in motion.
    acceleration_mm_s2
        Of the axes; None counts as boundless.
    targets
        What every picture shows.
    kind, rotation, translation_mm
        How the device stands (`KINDS`), as in the last session.
    temperatures
        Column to its coldest and hottest value.
    conditions
        Any other covariate to its usual and its largest value.
    pixels
        Column to coefficients (4,) of X/Z, Y/Z, 1/Z and 1 in the measuring frame.
    sigma, offset, drift : (3,)
        Noise in units of the stated uncertainties: row to row; of a pass and drift in units of `sigma`.
    memory_s : (3,)
        Of the drift.
    clock_s, last_session
        When the data end on the clock of all sessions, and the number of the session in which they do.
    """

    machine: Machine
    span_mm: Numbers
    feed_mm_min: float
    top_feed_mm_min: float
    is_in_motion: bool
    is_circular: bool
    radius_mm: float
    centre_mm: Numbers
    plane: str
    dwell_s: float
    interval_s: float
    acceleration_mm_s2: float | None
    targets: tuple[Target, ...]
    kind: int
    rotation: Numbers
    translation_mm: Numbers
    temperatures: dict[str, tuple[float, float]]
    conditions: dict[str, tuple[float, float]]
    pixels: dict[str, Numbers]
    sigma: Numbers
    offset: Numbers
    drift: Numbers
    memory_s: Numbers
    clock_s: float
    last_session: int

    @property
    def middle_mm(self) -> Numbers:
        """Middle of what was measured, (3,)."""
        return np.asarray(self.span_mm.mean(axis=1))

    @property
    def has_marker(self) -> bool:
        """Whether pictures show a static target already."""
        return any(target.carrier == CARRIERS.index("base") for target in self.targets)

    def moving(self, axes: Sequence[str] = AXES) -> tuple[str, ...]:
        """Give those of some axes that moved at all: of others nobody knows how far they may."""
        return tuple(axis for axis in axes if np.ptp(self.span_mm[AXES.index(axis)]) > 0.0)

    @property
    def is_relative(self) -> bool:
        """Whether only the tool was seen from the work, and so neither of the two from the floor."""
        return all(target.carrier == CARRIERS.index("relative") for target in self.targets)


def situation_of(fitted: Fitted, noise: NoiseModel, *, acceleration_mm_s2: float | None = None) -> Situation:
    """Learn from the data of a fit how a further measurement would go."""
    machine = fitted.machine
    # Lengths were taken on a part, by a device that sees no machine.
    sightings = fitted.sightings.select(~fitted.sightings.of_kind("lengths"), "lengths")
    q = sightings.commanded_mm
    span = np.column_stack([q.min(axis=0), q.max(axis=0)])
    feed = sightings.numbers("feed")
    feed = feed[np.isfinite(feed) & (feed > 0.0)]
    is_circular = bool(sightings.of_kind("circle").all())
    moving = np.nan_to_num(sightings.numbers("moving")) > 0.0
    begins = begins_look(sightings)
    usual = float(np.median(feed)) if feed.size else _USUAL_FEED_MM_MIN
    dwell, interval = _pace(sightings, begins, moving, usual)
    last = int(sightings.session.max())
    state = fitted.solved.state
    sessions_s = [float(np.ptp(part)) for part in _by_session(sightings, times_s(sightings))]
    has_times = "t" in sightings.covariate_columns
    span_s = float(np.median(sessions_s)) if has_times else dwell * float(np.median(_counts(sightings)))
    rotation, translation = state.rotations[last], state.translations_mm[last]
    radius, centre, plane = _circle(sightings, span)
    temperatures, conditions = _covariates(sightings)
    return Situation(
        machine=machine,
        span_mm=span,
        feed_mm_min=usual,
        top_feed_mm_min=float(feed.max()) if feed.size else usual,
        is_in_motion=is_circular or bool(moving.any()),
        is_circular=is_circular,
        radius_mm=radius,
        centre_mm=centre,
        plane=plane,
        dwell_s=dwell,
        interval_s=interval,
        acceleration_mm_s2=acceleration_mm_s2,
        targets=_targets(sightings, begins),
        kind=KINDS[sightings.frames[last]],
        rotation=rotation,
        translation_mm=translation,
        temperatures=temperatures,
        conditions=conditions,
        pixels=_pixels(sightings),
        sigma=noise.sigma,
        offset=noise.offset,
        drift=noise.drift,
        memory_s=np.maximum(noise.memory * max(span_s, 1.0), 1.0),
        clock_s=float(clock_s(sightings).max()),
        last_session=session_numbers(fitted.sightings.set_ups)[-1],
    )


def _by_session(sightings: Sightings, values: Numbers) -> list[Numbers]:
    return [part for part in np.split(values, sightings.starts[1:]) if len(part)]


def _counts(sightings: Sightings) -> Numbers:
    return np.unique(sightings.session, return_counts=True)[1].astype(np.float64)


def _pace(sightings: Sightings, begins: np.ndarray, moving: np.ndarray, usual_feed: float) -> tuple[float, float]:
    """Give the time of a picture at rest beyond the way to it, and between two in motion."""
    if "t" not in sightings.covariate_columns:
        return _USUAL_DWELL_S, _USUAL_INTERVAL_S
    rows = np.flatnonzero(begins)
    times = times_s(sightings)[rows]
    gap = np.diff(times)
    same = np.diff(sightings.session[rows]) == 0
    feed = np.nan_to_num(sightings.numbers("feed")[rows][1:], nan=usual_feed)
    way = np.linalg.norm(np.diff(sightings.commanded_mm[rows], axis=0), axis=1)
    rest = gap - 60.0 * way / np.maximum(feed, 1e-9)
    still, in_motion = same & ~moving[rows][1:], same & moving[rows][1:] & moving[rows][:-1]
    dwell = float(np.median(rest[still])) if still.any() else _USUAL_DWELL_S
    interval = float(np.median(gap[in_motion])) if in_motion.any() else _USUAL_INTERVAL_S
    return float(np.clip(dwell, *_DWELLS_S)), float(np.clip(interval, *_INTERVALS_S))


def _targets(sightings: Sightings, begins: np.ndarray) -> tuple[Target, ...]:
    """Give what the commonest moment shows, and of every other carrier the commonest target."""
    places = np.round(sightings.offset_mm / SAME_POSITION_MM)
    codes = np.zeros(len(sightings), dtype=np.int64)
    for key in (sightings.carrier, *places.T):
        _, own = np.unique(key, return_inverse=True)
        _, codes = np.unique(codes * (int(own.max()) + 1) + own.ravel(), return_inverse=True)
        codes = codes.ravel()
    count = np.bincount(codes)
    shown: set[int] = {int(np.argmax(count))}
    if len(count) <= _MOST_KINDS:
        sets = np.bitwise_or.reduceat(np.int64(1) << codes, np.flatnonzero(begins))
        values, often = np.unique(sets, return_counts=True)
        commonest = int(values[np.argmax(often)])
        shown = {code for code in range(len(count)) if commonest >> code & 1}
    first = np.full(len(count), len(codes))
    np.minimum.at(first, codes, np.arange(len(codes)))
    carrier_of = sightings.carrier[first]
    for carrier in np.unique(carrier_of):
        own = np.flatnonzero(carrier_of == carrier)
        if not shown & set(own.tolist()):
            shown.add(int(own[np.argmax(count[own])]))
    result = []
    for code in sorted(shown, key=lambda code: int(first[code])):
        rows = codes == code
        result.append(
            Target(
                int(carrier_of[code]),
                sightings.offset_mm[first[code]].copy(),
                np.asarray(sightings.whitening[rows].mean(axis=0)),
            )
        )
    return tuple(result)


def _circle(sightings: Sightings, span: Numbers) -> tuple[float, Numbers, str]:
    """Give radius, centre and plane of the last circular test, or of a circle that the data's span has room for."""
    last = int(sightings.session.max())
    if sightings.frames[last] == "circle":
        own = sightings.commanded_mm[sightings.session == last]
        size = np.ptp(own, axis=0)
        still = int(np.argmin(size))
        centre = 0.5 * (own.min(axis=0) + own.max(axis=0))
        return 0.5 * float(size.max()), centre, "".join(axis for n, axis in enumerate(AXES) if n != still)
    length = span[:, 1] - span[:, 0]
    first, second = sorted(np.argsort(-length, kind="stable")[:2].tolist())
    radius = 0.4 * float(min(length[first], length[second]))
    return radius, np.asarray(span.mean(axis=1)), AXES[first] + AXES[second]


def _covariates(sightings: Sightings) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    temperatures: dict[str, tuple[float, float]] = {}
    conditions: dict[str, tuple[float, float]] = {}
    for name in sightings.covariate_columns:
        if name in NOT_CONDITIONS or name in ("feed", "moving"):
            continue
        values = sightings.numbers(name)
        values = values[np.isfinite(values)]
        low, high = float(values.min()), float(values.max())
        if is_temperature(name):
            hot = high if high - low >= _LEAST_WARMING_K else low + _USUAL_WARMING_K
            temperatures[name] = (low, hot)
        else:
            conditions[name] = (float(np.median(values)), high)
    return temperatures, conditions


def _pixels(sightings: Sightings) -> dict[str, Numbers]:
    """Give where in the pictures a point of the measuring frame is seen, as a camera without distortion would."""
    found: dict[str, Numbers] = {}
    complete = sightings.is_measured.all(axis=1)
    for name in PIXELS:
        values = sightings.numbers(name)
        rows = complete & np.isfinite(values) & (np.abs(sightings.measured_mm[:, 2]) > 1.0)
        if rows.sum() < len(PIXELS) * 2:
            continue
        design = pinhole(sightings.measured_mm[rows])
        found[name] = np.asarray(np.linalg.lstsq(design, values[rows], rcond=None)[0], dtype=np.float64)
    return found


def pinhole(points_mm: Numbers) -> Numbers:
    """Give X/Z, Y/Z, 1/Z and 1 of points (n, 3) in the measuring frame, (n, 4)."""
    depth = np.where(np.abs(points_mm[:, 2]) > 1e-9, points_mm[:, 2], 1.0)
    return np.column_stack([points_mm[:, :2] / depth[:, None], 1.0 / depth, np.ones(len(points_mm))])
