"""Machines with large squarenesses and angles: what first-order arithmetic neglects is taken off."""

from __future__ import annotations

import numpy as np
import pytest

from geoerr.error_functions import ALL_NAMES, ErrorFunctions, is_angular
from geoerr.identify import identify_nine_line
from geoerr.observations import observations_from_columns
from geoerr.simulate.nine_lines import NineLines, nine_line_plan
from geoerr.simulate.pictures import true_centres_mm
from geoerr.simulate.scene import Scene
from geoerr.simulate.truth import truth_of


def worst(found: ErrorFunctions, truth: ErrorFunctions) -> dict[bool, float]:
    """Largest error of a translation (False, mm) and of an angle (True, rad)."""
    differences: dict[bool, list[float]] = {False: [], True: []}
    for name in ALL_NAMES:
        if name in found.squareness:
            difference = np.array([found.squareness[name].value_rad - truth.squareness[name].value_rad])
        else:
            difference = found.functions[name].value - truth.functions[name].value
        differences[is_angular(name)].append(float(np.abs(difference).max()))
    return {kind: max(values) for kind, values in differences.items()}


@pytest.mark.parametrize("seed", [1, 2])
def test_exact_points_give_the_truth_to_third_order(seed: int) -> None:
    plan = nine_line_plan(NineLines(seed=seed, n_points=6, both_directions=False))
    scene = Scene(plan)
    rows = []
    for index in range(len(scene)):
        centres = true_centres_mm(scene, index)
        for target in plan.targets:
            place = (*scene.moments.q_mm[index], *target.offset_mm, *centres[(target.dictionary, target.id)])
            rows.append((scene.moments.line[index], target.carrier, target.name, *place))
    names = ("line", "carrier", "target", "x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz")
    columns = {
        name: list(values) if isinstance(values[0], str) else np.array(values)
        for name, values in zip(names, zip(*rows, strict=True), strict=True)
    }
    observations = observations_from_columns(columns)
    truth = truth_of(scene).errors
    plain = worst(identify_nine_line(observations, plan.machine, first_order=True), truth)
    exact = worst(identify_nine_line(observations, plan.machine), truth)
    # Third order: squareness² × angle (25e-6 × 0.5 mrad) over a lever of 400 mm, and a few such terms.
    assert exact[False] < 1e-4
    assert exact[True] < 1e-6
    assert exact[False] < 0.25 * plain[False]
    assert exact[True] < 0.5 * plain[True]
