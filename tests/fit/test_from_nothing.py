"""Whether data tell an effect from nothing: the level by Monte-Carlo, and an effect that is there."""

from __future__ import annotations

import numpy as np
from scipy import stats

import geoerr
from geoerr.fit.from_nothing import chance_of_nothing
from geoerr.observations import Observations, observations_from_columns

MACHINE = geoerr.Machine.from_chain("wZbXYt", (400.0, 400.0, 400.0))
# One coefficient, two of one effect, and one that hangs together with the frame's pose.
EFFECTS = ("backlash:x", "lateral-play:x", "scale:x")
NOISE_MM = 2e-3
N_MACHINES = 120


def there_and_back(rng: np.random.Generator, *, play_mm: float = 0.0) -> Observations:
    """X there and back twice along four edges of the volume, and nothing but noise if there is no play."""
    edge = np.linspace(0.0, 400.0, 7)
    columns: dict[str, list[float]] = {name: [] for name in ("x", "y", "z", "dir_x", "repeat")}
    for repeat in range(2):
        for y, z in ((0.0, 0.0), (400.0, 0.0), (0.0, 400.0), (400.0, 400.0)):
            for sense in (1.0, -1.0):
                for x in edge[:: int(sense)]:
                    for name, value in zip(columns, (x, y, z, sense, repeat), strict=True):
                        columns[name].append(value)
    known = {name: np.array(values) for name, values in columns.items()}
    seen = np.column_stack([known[axis] for axis in "xyz"]) + rng.normal(0.0, NOISE_MM, (len(known["x"]), 3))
    seen[:, 0] -= 0.5 * play_mm * known["dir_x"]
    measured = dict(zip(("mx", "my", "mz"), seen.T, strict=True))
    return observations_from_columns({**known, **measured, "carrier": ["relative"] * len(seen)})


def chances(rng: np.random.Generator, **hidden: float) -> dict[str, float]:
    fitted = geoerr.fit_model(MACHINE, there_and_back(rng, **hidden), components="none", effects=EFFECTS).fitted
    return chance_of_nothing(fitted)


def test_of_nothing_every_probability_is_as_frequent_as_it_says() -> None:
    rng = np.random.default_rng(20)
    drawn = [chances(rng) for _ in range(N_MACHINES)]
    for effect in EFFECTS:
        uniform = stats.kstest([each[effect] for each in drawn], "uniform")
        assert uniform.pvalue > 1e-3, effect


def test_an_effect_that_is_there_is_told_from_nothing_beside_one_that_is_not() -> None:
    found = chances(np.random.default_rng(21), play_mm=0.01)
    assert found["backlash:x"] < 1e-9
    assert found["lateral-play:x"] > 1e-3
