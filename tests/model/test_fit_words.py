"""A fit's figures in sentences: lack of fit, what uncertainties are made of, what could not be predicted."""

from __future__ import annotations

import math

import pytest

from geoerr.model.fit_words import fit_sentences, lack_of_fit_words


@pytest.mark.parametrize(
    ("p_value", "beyond_um", "is_from_repeats", "expected"),
    [
        (math.nan, math.nan, False, "cannot be told: nothing was measured twice"),
        (0.4, 1.0, True, "what is left is noise, as far as can be told (p = 0.4)"),
        (0.021, 5.0, True, "what is left may be more than noise: chance leaves as much in one case of 48"),
        (1e-5, 3.21, True, "lacks something: the residual is more than repeats scatter, by 3.2 µm rms (p = 1e-05)"),
        (1e-5, 3.21, False, "more than the stated uncertainties allow, by 3.2 µm rms"),
        (1e-5, 0.0, False, "more than the stated uncertainties allow (p = 1e-05)"),
    ],
)
def test_lack_of_fit(p_value: float, beyond_um: float, is_from_repeats: bool, expected: str) -> None:
    assert expected in lack_of_fit_words(p_value, beyond_um, is_from_repeats)


def test_what_uncertainties_are_made_of() -> None:
    assert "1.50 times as far as stated" in next(fit_sentences({}, {"scale": 1.5}))
    assert "as stated or less" in next(fit_sentences({}, {"scale": 1.0}))
    micrometres = next(fit_sentences({}, {"scale": 1.0, "scatter_of_stated": 1e-3}))
    assert micrometres.startswith("the points scatter 1,000 times less than stated: are sx, sy and sz in mm")
    assert "more than 1,000,000 times less" in next(fit_sentences({}, {"scale": 1.0, "scatter_of_stated": 0.0}))
    assert "a measured component scatters 12.3 µm" in next(fit_sentences({}, {"scatter_um": 12.3}))
    assert "calibration" in next(fit_sentences({}, {"calibration_unknowns": 24.0}))
    assert not list(fit_sentences({}, {}))


def test_rows_that_cannot_be_predicted_are_counted() -> None:
    (sentence,) = fit_sentences({"held_out_not_computable": 42.0}, {})
    assert sentence.startswith("42 rows cannot be predicted")
