"""Effects added to a model that was fitted with its calibration, and taken away: the calibration stays part of it."""

from __future__ import annotations

import numpy as np
import pytest
from budget_scenes import fit_of_nine_lines

from geoerr.diagnose import compare
from geoerr.diagnose.change import add_effect, remove_terms
from geoerr.fit.result import CALIBRATION_UNKNOWNS
from geoerr.observations import observations_from_columns
from geoerr.vision.sensitivity import sensitivity_of_points


def test_a_change_keeps_the_calibration_where_it_is_given() -> None:
    told, rig = fit_of_nine_lines(with_rig=True)
    assert rig is not None
    sightings = told.fitted.sightings
    numbers = ("repeat", "x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz", "cxx", "cxy", "cxz", "cyy", "cyz", "czz")
    table = observations_from_columns(
        {name: sightings.texts(name) for name in ("line", "session", "carrier", "target")}
        | {name: sightings.numbers(name) for name in numbers}
    )
    calibration = {
        "rig_sensitivity": sensitivity_of_points(rig, table.measured_mm), "rig_covariance": rig.covariance
    }  # fmt: skip
    start = told.model
    assert start.record is not None
    assert start.record.noise[CALIBRATION_UNKNOWNS] == 24.0
    q = [[300.0, 200.0, 250.0]]
    with_it = add_effect(start, table, reference="backlash:x", **calibration).result
    without = add_effect(start, table, reference="backlash:x").result
    assert with_it.model.record is not None
    assert with_it.model.record.noise[CALIBRATION_UNKNOWNS] == 24.0
    assert without.model.record is not None
    assert CALIBRATION_UNKNOWNS not in without.model.record.noise
    at = {"d_x": 1.0}
    variances = [
        np.trace(one.prediction_covariance_mm2(q, at=at)[0]) for one in (start, with_it.model, without.model)
    ]
    # One unknown more leaves more doubt; a rig that counts as perfect leaves less, whatever is added.
    assert variances[1] >= variances[0] * (1.0 - 1e-9)
    assert variances[2] < variances[0]
    back = remove_terms(with_it.model, [table], "backlash:x", **calibration).result.model
    assert back.record is not None
    # Rows that were reached from an unknown side take no part in either fit.
    assert back.record.noise[CALIBRATION_UNKNOWNS] == 24.0
    assert np.trace(back.prediction_covariance_mm2(q)[0]) >= variances[0] * (1.0 - 1e-9)
    own = compare(start, table, **calibration)
    assert own.points.covariance == pytest.approx(start.record.covariance, rel=1e-6, abs=1e-18)
