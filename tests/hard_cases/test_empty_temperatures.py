"""Sensors that are not read in every row: the right one is named, and nothing is unknown that is not."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from validation.hidden_effects.sets import single_set

from geoerr.diagnose.asked import diagnose
from geoerr.fit import FitOptions, fit_terms


@pytest.mark.parametrize("of_all", [True, False])
def test_growth_is_named_where_a_tenth_of_the_readings_is_missing(of_all: bool) -> None:
    """Of all sensors: it was told as unknown. Of the one that it follows: its neighbour was named, alone."""
    case = single_set("thermal-expansion", 1, 4.0).case(3000, is_study=False)
    (truth,) = case.truth
    frame, rng = case.observations.frame, np.random.default_rng(0)
    for name in [name for name in frame.columns if name.startswith("temp_") and (of_all or name == truth.covariate)]:
        values = np.where(rng.random(len(frame)) < 0.1, np.nan, frame[name].to_numpy())
        frame = frame.with_columns(pl.Series(name, values))
    fitted = fit_terms(case.machine, [replace(case.observations, frame=frame)], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    assert str(diagnosis.found[0].reference) == f"{truth.effect}:{truth.axis}@{truth.covariate}"
    assert diagnosis.unknown is None
    n_empty = frame[truth.covariate].is_nan().sum()
    assert any(f"{truth.covariate} is empty in {n_empty} rows: between readings" in note for note in diagnosis.notes)


def test_a_session_without_sensors_hides_no_growth_and_makes_nothing_unknown() -> None:
    """Its rows hold the growth, and were fitted as if it did nothing there; no session is left of a fit with it."""
    case = single_set("thermal-expansion", 2, 4.0).case(4000, is_study=False)
    (truth,) = case.truth
    frame = case.observations.frame
    is_last = pl.col("session") == frame["session"][-1]
    names = [name for name in frame.columns if name.startswith("temp_")]
    frame = frame.with_columns(pl.when(is_last).then(None).otherwise(pl.col(name)).alias(name) for name in names)
    fitted = fit_terms(case.machine, [replace(case.observations, frame=frame)], options=FitOptions(threads=1))
    diagnosis = diagnose(fitted, threads=1)
    first = diagnosis.found[0]
    alike = [first.reference, *(one.reference for one in diagnosis.candidates if one.tied)]
    assert f"{truth.effect}:{truth.axis}@{truth.covariate}" in map(str, alike)
    assert diagnosis.unknown is None
    n_empty = int(frame[names[0]].is_null().sum())
    assert f"the search goes on without {n_empty} rows of unknown temperature" in diagnosis.notes
