"""Waves on one axis, as of a pulley, its belt and the motor's steps: each is looked for beside those before it."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from validation.fine_errors import MACHINE, measured

from geoerr.diagnose import add_effect, diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.diagnose.search import reference_of
from geoerr.diagnose.search.once_more import by_first_names
from geoerr.effects import catalogue
from geoerr.fit import fit_model
from geoerr.model import Model
from geoerr.observations import Observations

Wave = Callable[[np.ndarray], np.ndarray]


def wave(period_mm: float, size_um: float) -> Wave:
    return lambda q: size_um * np.sin(2.0 * np.pi * q / period_mm + 1.0)


def observed(*waves: Wave, noise_um: float = 2.0, seed: int = 5) -> Observations:
    """Measure a machine with waves on X and nothing else."""
    curves = [lambda q: np.sum([one(q) for one in waves], axis=0), np.zeros_like, np.zeros_like]
    return measured(np.random.default_rng(seed), curves, noise_um)


@cache
def diagnosed(*sizes_um: tuple[float, float]) -> Diagnosis:
    """Diagnose a machine with waves of some periods in mm and sizes in µm."""
    data = observed(*(wave(period_mm, size_um) for period_mm, size_um in sizes_um))
    return diagnose(fit_model(MACHINE, data).fitted, threads=1)


def periods(diagnosis: Diagnosis) -> dict[str, float]:
    return {
        str(one.reference): next(parameter.value for parameter in one.parameters if parameter.name == "P")
        for one in diagnosis.found
    }


@pytest.mark.parametrize("sizes_um", [((16.0, 5.0), (5.0, 5.0)), ((40.0, 8.0), (3.2, 3.0))])
def test_both_are_named(sizes_um: tuple[tuple[float, float], ...]) -> None:
    """Of two waves one was named, and nothing said of the other."""
    diagnosis = diagnosed(*sizes_um)
    assert diagnosis.verdict == "missing"
    found = periods(diagnosis)
    assert sorted(found) == ["periodic-second:x", "periodic:x"]
    assert sorted(found.values()) == pytest.approx(sorted(period_mm for period_mm, _ in sizes_um), rel=3e-3)


def test_the_amplitude_is_told_and_its_parts_are_not_judged() -> None:
    """At this phase one part was said to be usual for another machine than the other part of the same wave."""
    for finding in diagnosed((16.0, 5.0), (5.0, 5.0)).found:
        (amplitude,) = finding.amplitudes
        assert abs(1e3 * amplitude.size.value - 5.0) < 3.0 * 1e3 * amplitude.size.std < 3.0
        assert "usual" not in "".join(finding.value_words[:2])
        assert finding.value_words[-1].startswith("amplitude √(A² + B²) = ")
        document = finding.to_document()
        assert document["amplitudes"][0]["value"] == amplitude.size.value
        assert document["parameters"]["A"]["plausible"] is None


def test_a_rival_is_not_held_against_another_fit() -> None:
    """Beside few knots, which leave the waves, what explains none of them seemed to raise the held-out error."""
    diagnosis = diagnosed((40.0, 8.0), (3.2, 3.0))
    before_um = diagnosis.held_out_rmse_um
    assert before_um is not None
    base_um = diagnosis.searched.bench.held_out.um([])
    assert base_um is not None
    assert base_um > 1.2 * before_um
    assert len(diagnosis.candidates) > 1
    for rival in diagnosis.candidates[1:]:
        found = [one for one in diagnosis.found if one.reference == rival.reference]
        assert found or rival.held_out_words is None
    assert diagnosis.found[0].held_out_words is not None


def test_both_are_added_and_nothing_is_left() -> None:
    data = observed(wave(16.0, 5.0), wave(5.0, 5.0))
    first = add_effect(fit_model(MACHINE, data).model, data, reference="periodic:x", threads=1)
    beside_first = diagnose(first.after, threads=1)
    assert list(periods(beside_first)) == ["periodic-second:x"]
    both = add_effect(first.result.model, data, reference="periodic-second:x", threads=1)
    assert {term.id for term in both.result.model.terms} >= {"periodic:x", "periodic-second:x"}
    beside_both = diagnose(both.after, threads=1)
    assert beside_both.verdict == "nothing-missing"
    assert beside_both.held_out_rmse_um is not None
    assert beside_first.held_out_rmse_um is not None
    assert beside_both.held_out_rmse_um < 0.8 * beside_first.held_out_rmse_um
    # 2 µm in each of three components.
    assert beside_both.held_out_rmse_um == pytest.approx(2.0 * np.sqrt(3.0), rel=0.1)


def test_a_second_in_the_model_is_not_looked_for_again() -> None:
    """Two terms of one name were refused when the first was found beside it."""
    data = observed(wave(16.0, 5.0), wave(5.0, 5.0))
    second = add_effect(fit_model(MACHINE, data).model, data, reference="periodic-second:x", threads=1)
    assert list(periods(diagnose(second.after, threads=1))) == ["periodic:x"]


@pytest.mark.parametrize("period_mm", [16.0, 3.2])
def test_one_wave_has_no_second(period_mm: float) -> None:
    diagnosis = diagnosed((period_mm, 5.0))
    assert list(periods(diagnosis)) == ["periodic:x"]
    assert diagnosis.unknown is None
    assert all("periodic-second" not in name for name, _ in diagnosis.not_offered)


def test_a_second_is_no_candidate_without_a_first() -> None:
    diagnosis = diagnosed((5.0, 0.0))
    assert not diagnosis.found
    assert all(one.reference.effect != "periodic-second" for one in diagnosis.candidates)


def test_a_second_without_a_first_is_the_first() -> None:
    found = diagnosed((16.0, 5.0), (5.0, 5.0)).searched.found
    second = next(one for one in found if "second" in str(reference_of(one.judged)))
    (alone,) = by_first_names([second], [], catalogue())
    assert str(reference_of(alone.judged)) == "periodic:x"
    for settled in (alone.settled, alone.at_last):
        assert settled.term is not None
        assert (settled.term.id, settled.term.effect) == ("periodic:x", "periodic")
    assert np.array_equal(alone.settled.raw, second.settled.raw)
    assert by_first_names(found, [], catalogue()) == list(found)
    assert by_first_names([second], ["periodic:x"], catalogue()) == [second]


THREE = ((40.0, 8.0), (2.0, 4.0), (0.8, 3.0))


def test_of_three_all_are_named() -> None:
    """Of a third nothing was said."""
    found = periods(diagnosed(*THREE))
    assert sorted(found) == ["periodic-second:x", "periodic-third:x", "periodic:x"]
    assert sorted(found.values()) == pytest.approx(sorted(period_mm for period_mm, _ in THREE), rel=3e-3)


def test_a_third_without_others_is_the_first() -> None:
    found = diagnosed(*THREE).searched.found
    by_name = {str(reference_of(one.judged)): one for one in found}
    first, third = by_name["periodic:x"], by_name["periodic-third:x"]
    (alone,) = by_first_names([third], [], catalogue())
    assert str(reference_of(alone.judged)) == "periodic:x"
    named = [str(reference_of(one.judged)) for one in by_first_names([third, first], [], catalogue())]
    assert named == ["periodic-second:x", "periodic:x"]
    assert by_first_names(found, [], catalogue()) == list(found)


def of_the_first() -> Model:
    """Give a model that has a wave of 16 mm and 5 µm, fitted to a machine that has it."""
    data = observed(wave(16.0, 5.0))
    return add_effect(fit_model(MACHINE, data).model, data, reference="periodic:x", threads=1).result.model


@pytest.mark.parametrize(
    ("sizes_um", "names"),
    [
        (((16.0, 5.0), (5.0, 5.0)), {"periodic-second:x": 5.0}),
        (((16.0, 9.0),), {"periodic:x": 16.0}),
        (((16.0, 9.0), (5.0, 5.0)), {"periodic:x": 16.0, "periodic-second:x": 5.0}),
        (((16.0, 5.0), (5.0, 5.0), (2.0, 4.0)), {"periodic-second:x": 5.0, "periodic-third:x": 2.0}),
    ],
)
def test_beside_a_model_that_is_held_another_wave_has_another_name(
    sizes_um: tuple[tuple[float, float], ...], names: dict[str, float]
) -> None:
    """It was called the wave that the model has, of another period: adding that would have lost the first."""
    model = of_the_first()
    data = observed(*(wave(period_mm, size_um) for period_mm, size_um in sizes_um), seed=7)
    diagnosis = diagnose(model, data, threads=1)
    assert diagnosis.comparison is not None
    assert diagnosis.comparison.is_held
    assert periods(diagnosis) == pytest.approx(names, rel=3e-3)
    for one in diagnosis.found:
        assert one.in_model == (one.reference.effect == "periodic")
