"""Two waves on one axis, as of a pulley and of the motor's steps: the second is looked for beside the first."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from validation.fine_errors import MACHINE, measured, nothing

from geoerr.diagnose import add_effect, diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.search.once_more import by_first_names
from geoerr.effects import catalogue
from geoerr.fit import fit_model
from geoerr.observations import Observations

Wave = Callable[[np.ndarray], np.ndarray]


def wave(period_mm: float, size_um: float) -> Wave:
    return lambda q: size_um * np.sin(2.0 * np.pi * q / period_mm + 1.0)


def observed(*waves: Wave, noise_um: float = 2.0) -> Observations:
    """Measure a machine with waves on X and nothing else."""
    curves = [lambda q: np.sum([one(q) for one in waves], axis=0), np.zeros_like, np.zeros_like]
    return measured(np.random.default_rng(5), curves, noise_um)


def periods(diagnosis: Diagnosis) -> dict[str, float]:
    return {
        str(one.reference): next(parameter.value for parameter in one.parameters if parameter.name == "P")
        for one in diagnosis.found
    }


@pytest.mark.parametrize(
    ("first_mm", "first_um", "second_mm", "second_um"), [(16.0, 5.0, 5.0, 5.0), (40.0, 8.0, 3.2, 3.0)]
)
def test_both_are_named(first_mm: float, first_um: float, second_mm: float, second_um: float) -> None:
    """Of two waves one was named, and nothing said of the other."""
    data = observed(wave(first_mm, first_um), wave(second_mm, second_um))
    diagnosis = diagnose(fit_model(MACHINE, data).fitted, threads=1)
    assert diagnosis.verdict == "missing"
    found = periods(diagnosis)
    assert sorted(found) == ["periodic-second:x", "periodic:x"]
    assert sorted(found.values()) == pytest.approx(sorted([first_mm, second_mm]), rel=3e-3)


def test_both_are_added_and_nothing_is_left() -> None:
    data = observed(wave(16.0, 5.0), wave(5.0, 5.0))
    model = fit_model(MACHINE, data).model
    held_out_um = []
    for name in ("periodic:x", "periodic-second:x"):
        change = add_effect(model, data, reference=name, threads=1)
        model = change.result.model
        held_out_um.append(diagnose(change.after, threads=1).held_out_rmse_um)
    assert {term.id for term in model.terms} >= {"periodic:x", "periodic-second:x"}
    assert held_out_um[1] is not None
    assert held_out_um[0] is not None
    assert held_out_um[1] < 0.8 * held_out_um[0]
    assert diagnose(change.after, threads=1).verdict == "nothing-missing"
    # 2 µm in each of three components.
    assert held_out_um[1] == pytest.approx(2.0 * np.sqrt(3.0), rel=0.1)


def test_beside_a_wave_in_the_model_the_second_is_looked_for() -> None:
    data = observed(wave(16.0, 5.0), wave(5.0, 5.0))
    change = add_effect(fit_model(MACHINE, data).model, data, reference="periodic:x", threads=1)
    assert list(periods(diagnose(change.after, threads=1))) == ["periodic-second:x"]


@pytest.mark.parametrize("period_mm", [16.0, 3.2])
def test_one_wave_has_no_second(period_mm: float) -> None:
    diagnosis = diagnose(fit_model(MACHINE, observed(wave(period_mm, 5.0))).fitted, threads=1)
    assert list(periods(diagnosis)) == ["periodic:x"]
    assert diagnosis.unknown is None
    assert all("periodic-second" not in name for name, _ in diagnosis.not_offered)


def test_nothing_is_looked_for_twice_where_nothing_is() -> None:
    diagnosis = diagnose(fit_model(MACHINE, observed(nothing(np.random.default_rng(0)))).fitted, threads=1)
    assert not diagnosis.found
    assert all(one.reference.effect != "periodic-second" for one in diagnosis.candidates)


def test_a_second_without_a_first_is_the_first() -> None:
    data = observed(wave(16.0, 5.0), wave(5.0, 5.0))
    found = diagnose(fit_model(MACHINE, data).fitted, threads=1).searched.found
    second = next(one for one in found if "second" in str(one.judged.what.reference))  # type: ignore[union-attr]
    (alone,) = by_first_names([second], [], catalogue())
    assert str(alone.judged.what.reference) == "periodic:x"  # type: ignore[union-attr]
    for settled in (alone.settled, alone.at_last):
        assert settled.term is not None
        assert (settled.term.id, settled.term.effect) == ("periodic:x", "periodic")
    assert np.array_equal(alone.settled.raw, second.settled.raw)
    assert by_first_names(found, [], catalogue()) == list(found)
    assert by_first_names([second], ["periodic:x"], catalogue()) == [second]
    assert replace(second) != alone
