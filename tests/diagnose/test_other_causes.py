"""Two causes that go alike here, one with a number more: it is no wider form of the first, but another cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_machine import Noise, Plan, machine, measure, motion

from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms

PLAN = Plan(n_sessions=3, n_lines=20, n_points=16)
NOISE = Noise(white=(4.0, 4.0, 4.0))
WARM_UP_S, SHIFT_UM = 300.0, 40.0


def _diagnosed(*, cools: bool) -> Diagnosis:
    """Warm up in every session, while a bed warms as quickly; where it cools, it does so from the middle on."""
    rng = np.random.default_rng(5)
    moved = motion(rng, PLAN)
    first = np.array([moved.t[moved.session == one].min() for one in range(PLAN.n_sessions)])
    t = moved.t - first[moved.session]
    share = 1.0 - np.exp(-t / WARM_UP_S)
    bed = 20.0 + 40.0 * share
    if cools:
        half = float(t.max()) / 2.0
        bed = np.where(t > half, 20.0 + (bed - 20.0) * np.exp(-(t - half) / WARM_UP_S), bed)
    moved = replace(moved, t=t, bed=bed, frame=np.full_like(t, 20.0))
    hidden = SHIFT_UM * share[:, None] * np.array([1.0, 0.0, 0.0])
    fitted = fit_terms(machine(), [measure(rng, moved, NOISE, hidden)], options=FitOptions(threads=1))
    return diagnose(fitted, threads=1)


def test_a_warm_up_that_a_temperature_follows_is_tied_with_that_temperature() -> None:
    diagnosis = _diagnosed(cools=False)
    first, tied = diagnosis.found[0], {str(one.reference) for one in diagnosis.tied}
    assert diagnosis.verdict == "ambiguous"
    assert {"thermal-drift:x@temp_bed", "warm-up:x"} <= tied
    # It has a number less, and so comes first; that is no evidence for it.
    assert str(first.reference) == "thermal-drift:x@temp_bed"
    assert first.worth_um == pytest.approx(SHIFT_UM * 0.2, rel=0.6)
    assert first.separate_by


def test_where_the_bed_cools_the_warm_up_is_told_alone() -> None:
    diagnosis = _diagnosed(cools=True)
    assert str(diagnosis.found[0].reference) == "warm-up:x"
    assert "thermal-drift:x@temp_bed" not in {str(one.reference) for one in diagnosis.tied}


def test_a_drift_that_cameras_would_have_as_well_is_not_corrected_before_a_marker_tells() -> None:
    """One session without a marker: cameras that move along x look the same, with more freedom."""
    rng = np.random.default_rng(5)
    moved = motion(rng, Plan(n_sessions=1, n_lines=40, n_points=14))
    hidden = SHIFT_UM * (1.0 - np.exp(-moved.t / 600.0))[:, None] * np.array([1.0, 0.0, 0.0])
    moved = replace(moved, bed=np.full_like(moved.t, 20.0), frame=np.full_like(moved.t, 20.0))
    fitted = fit_terms(machine(), [measure(rng, moved, NOISE, hidden)], options=FitOptions(threads=1))
    (found,) = diagnose(fitted, threads=1).found
    assert str(found.reference) == "warm-up:x"
    assert not found.is_rig
    assert found.device_words is not None
    assert "(camera-drift) would look the same" in found.device_words
    assert "put a marker on the machine's base" in found.device_words
    assert found.device_words[1:] in found.words()
    told_by = {one["effect"]: one["told_by"] for one in found.to_document()["aliases"]}
    assert told_by["camera-drift"].startswith("put a marker")
    assert {words for effect, words in told_by.items() if not catalogue()[effect].is_rig} <= {None}
