"""Lines of few places that cross at another one: of as many functions as places each had one that nothing told."""

import numpy as np
import pytest

from geoerr.fit import FitOptions, fit_terms
from geoerr.fit.classic import names_of
from geoerr.machine import Machine
from geoerr.observations import Observations, observations_from_columns

TRAVEL_MM = np.array([400.0, 300.0, 250.0])
MACHINE = Machine.from_chain("wbXYZt", (400.0, 300.0, 250.0))
NOISE_MM = 0.001


def seen(n_places: tuple[int, int, int], rng: np.random.Generator) -> Observations:
    """A line along each axis through the middle, four times there and back, with a curve in each translation."""
    places, names, repeats = [], [], []
    for axis, count in enumerate(n_places):
        for repeat in range(4):
            share = np.linspace(0.0, 1.0, count)
            q = np.tile(0.5 * TRAVEL_MM, (2 * count, 1))
            q[:, axis] = TRAVEL_MM[axis] * np.concatenate([share, share[::-1]])
            places.append(q)
            names += ["XYZ"[axis]] * len(q)
            repeats += [repeat] * len(q)
    q = np.concatenate(places)
    measured = q + NOISE_MM * rng.normal(size=q.shape)
    for axis in range(3):
        measured += 0.01 * (q[:, axis : axis + 1] / TRAVEL_MM[axis]) ** 2 * np.array([1.0, -0.5, 0.7])
    columns: dict[str, object] = {"carrier": ["relative"] * len(q), "line": names, "repeat": repeats}
    columns |= {name: q[:, index] for index, name in enumerate("xyz")}
    columns |= {f"m{name}": measured[:, index] for index, name in enumerate("xyz")}
    return observations_from_columns(columns | {f"s{name}": np.full(len(q), NOISE_MM) for name in "xyz"})


@pytest.mark.parametrize("n_places", [(4, 4, 4), (21, 4, 4), (4, 5, 6)])
def test_all_translations_are_determined(n_places: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(1)
    fitted = fit_terms(MACHINE, [seen(n_places, rng)], options=FitOptions(components="12", threads=1))
    assert not set(fitted.undetermined.names) & set(names_of("12"))
    assert fitted.scale == pytest.approx(1.0, abs=0.2)
    choices = {choice.name: choice for choice in fitted.choices}
    # Of 10 µm that are bent: what is known is known to the noise of some rows, not to the size of the error.
    for term in fitted.terms:
        if term.id in choices:
            assert max(one.std for one in term.coefficients) < 0.01, term.id
