"""How much the same point scatters when it is measured again: the noise floor, without any model.

Rows count as repeats where pose, direction of approach and target agree and the covariates nearly do, across passes.
The floor is the pooled standard deviation (n − 1) of each component, summed as the root mean square error is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy

from geoerr.column_names import is_temperature
from geoerr.fit.alike import numbers_of_alike, scatter_in_groups
from geoerr.fit.lengths import of_the_headline, other_ends_mm
from geoerr.fit.reversals import unstated_turns
from geoerr.fit.sightings import SAME_POSITION_MM, Numbers, Sightings
from geoerr.fit.variables import times_s
from geoerr.observations import CARRIERS, PIXELS
from geoerr.summaries import listed

# Covariates are alike where they differ by less than this share of their spread: a twentieth of the spread changes a
# linear effect by a twentieth, well below the noise wherever the effect itself is not far above it.
_ALIKE = 0.05
# Less than this is no other condition however small the spread: 0.1 K moves the end of 400 mm of aluminium by 0.9 µm,
# and of anything else a thousandth of its size is a sensor's last digit.
_ALIKE_K = 0.1
_ALIKE_SHARE = 1e-3
_UM_PER_MM = 1e3
# Offsets of passes are solved for to this share.
_SOLVED = 1e-8
# Columns without which a smaller share of the rows would be repeats are in nobody's way.
_REPEATED = 0.05
# Columns that identify or order rows; they say nothing about the conditions.
NOT_CONDITIONS = {
    *("x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz", "sx", "sy", "sz", "repeat", "t", "r", "file_row"),
    *("cxx", "cxy", "cxz", "cyy", "cyz", "czz", "dir_x", "dir_y", "dir_z", "dir"),
    *("measured", "s_measured"),
    *PIXELS,
}


@dataclass(frozen=True, eq=False)
class Repeats:
    """Rows that measured the same thing, by component.

    Attributes
    ----------
    group : (n,)
        Number of the group of every row.
    dof : (3,)
        Repeats beyond the first, by component.
    variance_mm2 : (3,)
        Pooled variance in base axes, NaN without repeats.
    within_pass_variance_mm2 : (3,)
        The same with each pass's own mean taken off first.
    within_pass_dof : (3,)
        Its degrees of freedom.
    """

    group: np.ndarray
    dof: np.ndarray
    variance_mm2: Numbers
    within_pass_variance_mm2: Numbers
    within_pass_dof: np.ndarray

    @property
    def floor_um(self) -> float | None:
        """Noise floor across passes, µm; None without repeats."""
        return _floor(self.variance_mm2, self.dof)

    @property
    def within_pass_floor_um(self) -> float | None:
        """Noise floor within passes, µm; None without repeats."""
        return _floor(self.within_pass_variance_mm2, self.within_pass_dof)


def _floor(variance_mm2: Numbers, dof: np.ndarray) -> float | None:
    if not (dof > 0).any():
        return None
    return math.sqrt(float(np.nansum(np.where(dof > 0, variance_mm2, 0.0)))) * _UM_PER_MM


def _known_directions(sightings: Sightings) -> Numbers:
    """Give directions (n, 3), 0 where an axis that was looked at again may have come back from beyond the place.

    What stands on the base does not ask where an axis came from.
    """
    turned = unstated_turns(sightings, times_s(sightings))
    on_base = sightings.carrier == CARRIERS.index("base")
    return np.where(turned & ~on_base[:, None], 0.0, sightings.directions)


def groups_of(sightings: Sightings) -> np.ndarray:
    """Give every row the number of its group, (n,): the same thing measured under nearly the same conditions."""
    return numbers_of_alike([*_places(sightings), *_conditions(sightings).values()])


def in_the_way_of_repeats(sightings: Sightings) -> Iterator[str]:
    """Name columns but for which visits of a place would be repeats: counts of rows, or one or two that differ."""
    few = _REPEATED * len(sightings)
    n_repeated = _n_repeated(sightings.once("groups", groups_of))
    if n_repeated > few:
        return
    conditions = _conditions(sightings)

    def n_repeated_without(names: Sequence[str]) -> int:
        others = [own for name, own in conditions.items() if name not in names]
        return _n_repeated(numbers_of_alike([*_places(sightings), *others]))

    if n_repeated_without(list(conditions)) <= few:
        return
    visits = f"{'hardly any' if n_repeated else 'no'} visit of a place counts as a repeat of another"
    columns = _condition_columns(sightings)
    counting = [
        name for name in columns if not is_temperature(name) and (np.diff(sightings.numbers(name)) > 0.0).all()
    ]
    if counting and n_repeated_without(counting):
        yield (
            f"{visits}, for {listed(counting)} rises from row to row and is "
            "taken for a condition: leave a running number out"
        )
        return
    # What is set once for many rows was changed on purpose; what differs in most rows may be of no matter.
    restless = [
        name
        for name in columns
        if name in conditions
        and not is_temperature(name)
        and np.diff(conditions[name][:, 0]).astype(bool).mean() > 0.5
    ]
    if not restless:
        return
    others = [name for name in columns if name in conditions]
    sets = [*((name,) for name in restless), *(pair for pair in combinations(others, 2) if set(pair) & set(restless))]
    for names in sets:
        if n_repeated_without(names) > few:
            differ = "differs from row to row and is a condition" if len(names) == 1 else "differ and are conditions"
            yield (
                f"{visits}, for {listed(names)} {differ}: without repeats "
                "nothing tells the noise; leave a column out that nothing can depend on"
            )
            return


def _n_repeated(group: np.ndarray) -> int:
    """Count the rows that repeat another."""
    return len(group) - int(group.max(initial=-1)) - 1


def _places(sightings: Sightings) -> list[np.ndarray]:
    return [
        np.round(sightings.commanded_mm / SAME_POSITION_MM),
        np.round(sightings.offset_mm / SAME_POSITION_MM),
        _known_directions(sightings),
        sightings.carrier[:, None].astype(np.float64),
        sightings.session[:, None].astype(np.float64),
        # At the place where a circle is run back both senses have one derived direction.
        np.nan_to_num(sightings.numbers("dir"))[:, None],
        # Corners are shared.
        np.round(other_ends_mm(sightings) / SAME_POSITION_MM),
    ]


def _condition_columns(sightings: Sightings) -> list[str]:
    return [name for name in sightings.covariate_columns if name not in NOT_CONDITIONS]


def _conditions(sightings: Sightings) -> dict[str, np.ndarray]:
    keys: dict[str, np.ndarray] = {}
    for name in _condition_columns(sightings):
        values = sightings.numbers(name)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        least = _ALIKE_K if name.startswith("temp") else _ALIKE_SHARE * max(abs(low), abs(high))
        step = max(_ALIKE * (high - low), least)
        if high > low:
            # Counted from the lowest value, so that a spread within one step is one condition.
            keys[name] = np.nan_to_num(np.floor((values - low) / step), nan=-1e9)[:, None]
    if "target" in sightings.table.columns:
        names = np.asarray(sightings.texts("target"))
        keys["target"] = np.unique(names, return_inverse=True)[1].reshape(-1, 1).astype(np.float64)
    return keys


def repeats_of(sightings: Sightings, residual_mm: Numbers, used: np.ndarray) -> Repeats:
    """Pool the scatter of repeated rows.

    Parameters
    ----------
    residual_mm : (n, 3)
        Measured minus predicted in base axes; the prediction of repeats is the same, so that only their scatter
        counts, and frames of different sessions do not.
    used : (n,)
        Rows that count (no outliers).
    """
    group = sightings.once("groups", groups_of)
    is_seen = of_the_headline(sightings) & used[:, None]
    variance, dof = _pooled(residual_mm, is_seen, group)
    within, within_dof = _within_passes(residual_mm, is_seen, group, sightings.pass_number)
    return Repeats(group, dof, variance, within, within_dof)


def where(mask: np.ndarray) -> np.ndarray | slice:
    """Give what selects these rows (n,): of all of them nothing is copied."""
    return slice(None) if mask.all() else mask


def _pooled(values: Numbers, is_seen: np.ndarray, group: np.ndarray) -> tuple[Numbers, np.ndarray]:
    variance, dof = np.full(3, np.nan), np.zeros(3, dtype=np.int64)
    for component in range(3):
        seen = where(is_seen[:, component])
        total, dof[component] = scatter_in_groups(values[seen, component], group[seen])
        if dof[component]:
            variance[component] = total / dof[component]
    return variance, dof


def _within_passes(
    values: Numbers, is_seen: np.ndarray, group: np.ndarray, pass_number: np.ndarray
) -> tuple[Numbers, np.ndarray]:
    """Pool what is left beside a mean of each group and an offset of each pass: least squares in two ways.

    A pass takes a degree of freedom where its rows repeat others', less one for all passes that hang together.
    """
    variance, dof = np.full(3, np.nan), np.zeros(3, dtype=np.int64)
    for component in range(3):
        rows = np.flatnonzero(is_seen[:, component])
        rows = rows[np.bincount(group[rows], minlength=1)[group[rows]] > 1]
        if not len(rows):
            continue
        left, n_free = _two_ways(values[rows, component], group[rows], pass_number[rows])
        dof[component] = n_free
        if n_free > 0:
            variance[component] = float(left @ left) / n_free
    return variance, dof


def _two_ways(values: Numbers, group: np.ndarray, pass_number: np.ndarray) -> tuple[Numbers, int]:
    """Give what means of groups and offsets of passes leave of values (n,), and its degrees of freedom."""
    group, of_pass = (np.unique(number, return_inverse=True)[1] for number in (group, pass_number))
    shared = scipy.sparse.csr_array((np.ones(len(values)), (group, of_pass)))
    n_together = scipy.sparse.csgraph.connected_components(
        scipy.sparse.block_array([[None, shared], [shared.T, None]])
    )[0]
    count = np.bincount(group)

    def beside_groups(own: Numbers) -> Numbers:
        return np.asarray(own - (np.bincount(group, weights=own) / count)[group])

    def normal(offset: Numbers) -> Numbers:
        return np.asarray(np.bincount(of_pass, weights=beside_groups(offset[of_pass])), dtype=np.float64)

    n_passes = shared.shape[1]
    beside = beside_groups(values)
    system = scipy.sparse.linalg.LinearOperator((n_passes, n_passes), matvec=normal, dtype=np.float64)
    # What round-off leaves of passes that share nothing is not solved for.
    enough = _SOLVED * float(np.linalg.norm(beside))
    offset, _ = scipy.sparse.linalg.cg(system, np.bincount(of_pass, weights=beside), rtol=_SOLVED, atol=enough)
    return beside - beside_groups(offset[of_pass]), len(values) - len(count) - n_passes + int(n_together)


def is_static(sightings: Sightings) -> np.ndarray:
    """Tell which rows are of static reference targets (`carrier` = `base`), (n,)."""
    return np.asarray(sightings.carrier == CARRIERS.index("base"))
