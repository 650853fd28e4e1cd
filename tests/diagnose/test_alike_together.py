"""An effect of all axes alike beside those of each axis, which only together do the same."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from hidden_machine import Motion, Noise, Plan, machine, measure, motion

from geoerr.cli.diagnose_text import diagnosis_lines, remedy_lines
from geoerr.diagnose.advice import Advice
from geoerr.diagnose.asked import diagnose
from geoerr.diagnose.diagnosis import Diagnosis
from geoerr.effects import catalogue
from geoerr.fit import FitOptions, fit_terms, refit
from geoerr.observations import Observations

PLAN = Plan(n_sessions=3, n_lines=20, n_points=16)
NOISE = Noise(white=(4.0, 4.0, 4.0))
COLD_C = 20.0
SCALE_PER_K = 6e-6
GROWTH = [f"thermal-expansion:{axis}@temp_bed" for axis in "xyz"]


def _seen_by_warm_cameras(measured: Observations, moved: Motion) -> Observations:
    """Let the base line of the cameras grow with the bed: everything seems nearer."""
    scale = pl.Series(1.0 + SCALE_PER_K * (moved.bed - COLD_C))
    return replace(
        measured, frame=measured.frame.with_columns(*(pl.col(name) * scale for name in ("mx", "my", "mz")))
    )


def _diagnosed(hidden: np.ndarray | None, *, warm_cameras: bool) -> Diagnosis:
    rng = np.random.default_rng(7)
    moved = motion(rng, PLAN)
    measured = measure(rng, moved, NOISE, hidden)
    if warm_cameras:
        measured = _seen_by_warm_cameras(measured, moved)
    return diagnose(fit_terms(machine(), [measured], options=FitOptions(threads=1)), threads=1)


@cache
def _of_cameras() -> Diagnosis:
    return _diagnosed(None, warm_cameras=True)


def test_scale_of_cameras_is_tied_with_the_growth_of_all_three_axes() -> None:
    diagnosis = _of_cameras()
    assert str(diagnosis.found[0].reference) == "rig-scale-thermal@temp_bed"
    assert diagnosis.verdict == "ambiguous"
    together = [one for one in diagnosis.tied if one.together]
    assert sorted(str(one.reference) for one in together) == GROWTH
    for one in together:
        assert one.together == ("x", "y", "z")
        (alias,) = (alias for alias in one.aliases if alias.reference == diagnosis.found[0].reference)
        assert alias.correlation > 0.99
        explained, could = diagnosis.compared(str(diagnosis.found[0].reference), str(one.reference))
        cosines = [np.linalg.norm(columns.T @ explained) / np.linalg.norm(explained) for columns in could]
        assert cosines == pytest.approx([alias.correlation], rel=1e-9)


def test_they_are_told_as_one() -> None:
    diagnosis = _of_cameras()
    assert f"of x, y and z together ({', '.join(GROWTH[:2])} and {GROWTH[2]})" in diagnosis.sentence
    assert diagnosis.sentence.count("thermal expansion") == 1
    assert "together with that of y and z" in " ".join(
        "\n".join(diagnosis_lines(diagnosis, "geoerr diagnose", "")).split()
    )
    documents = {one["axis"]: one for one in diagnosis.to_document()["candidates"] if one["tied"] and one["together"]}
    assert set(documents) == {"x", "y", "z"}


def test_a_bar_in_view_is_advised() -> None:
    """No run of the machine tells them: what has a length of its own does, while the temperature changes."""
    advice = _of_cameras().found[0].separate_by
    assert isinstance(advice, Advice)
    assert advice.plan is not None
    assert "Stand a scale bar of Invar" in advice.plan
    assert "heat what temp_bed measures" in advice.plan
    assert advice.expected_delta_chi2 is not None
    assert advice.same_again_delta_chi2 is not None
    assert advice.expected_delta_chi2 > 4.0 * advice.same_again_delta_chi2


def test_a_pose_of_cameras_is_told_along_axes_of_their_frame() -> None:
    """A jump along x, y and z was told beside places of the machine, as if these were the same axes."""
    scale = _of_cameras().found[0]
    assert scale.frame_words is None
    for name, is_pose in (("step", True), ("camera-drift", True), ("rig-pixel-locking", False)):
        found = replace(scale, term=catalogue()[name].term(None, None, machine()))
        assert (found.frame_words is not None) == is_pose, name
        assert ("Its x, y and z are the axes of the measuring frame" in found.words()) == is_pose
        assert ("axes of the measuring frame" in " ".join(remedy_lines(found, "the cameras"))) == is_pose


@pytest.mark.parametrize("axis", [0, 2])
def test_growth_of_one_axis_is_its_own(axis: int) -> None:
    rng = np.random.default_rng(7)
    moved = motion(rng, PLAN)
    hidden = 12e-3 * ((moved.bed - COLD_C) * moved.q[:, axis])[:, None] * np.eye(3)[axis]
    diagnosis = _diagnosed(hidden, warm_cameras=False)
    assert str(diagnosis.found[0].reference) == GROWTH[axis]
    assert "rig-scale-thermal@temp_bed" not in {str(one.reference) for one in diagnosis.tied}


def test_values_that_are_told_together_are_estimated_together() -> None:
    """Each was estimated alone: of 17 for all three axes 20, −9 and 4 were told, and fixed points at an end."""
    rng = np.random.default_rng(7)
    moved = motion(rng, PLAN)
    hidden_um = 17e-3 * (moved.bed - COLD_C)[:, None] * moved.q
    diagnosis = _diagnosed(hidden_um, warm_cameras=False)
    together = [one for one in diagnosis.tied if one.together]
    assert sorted(str(one.reference) for one in together) == GROWTH
    joint = refit(diagnosis.fitted, [*diagnosis.fitted.terms, *(one.term for one in together)])
    by_id = {term.id: term for term in joint.terms}
    for one in together:
        of_joint = by_id[str(one.reference)]
        for told, fitted in zip(one.parameters, (*of_joint.coefficients, *of_joint.inner), strict=True):
            truth = {"alpha": 17e-6, "q_fixed": 0.0}[told.name]
            assert abs(told.value - truth) < 4.0 * told.std
            # The search counts a drift that the fit does not: it is less sure.
            assert abs(told.value - fitted.value) < told.std
