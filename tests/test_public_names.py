"""What `import geoerr` offers: every name there, lazily, and stubs that agree with the compiled core."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import geoerr
from geoerr.error_functions import LINEAR_AND_ANGULAR
from geoerr.observations import observations_from_columns


def test_every_public_name_is_there() -> None:
    assert set(geoerr._HOMES) | {"__version__"} == set(geoerr.__all__)
    for name in geoerr.__all__:
        assert getattr(geoerr, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = geoerr.no_such_name  # type: ignore[attr-defined]  # the point of the test


def test_li_dobariya_and_a_machine_that_nobody_listed_are_one_line_each() -> None:
    """Points of a volume with a target at three places, and what each model is made of."""
    rng = np.random.default_rng(0)
    q_mm, place_mm = rng.uniform(0.0, 250.0, (200, 3)), 100.0 * np.eye(3)[rng.integers(0, 3, 200)]
    seen_mm = q_mm + place_mm + rng.normal(0.0, 1e-3, q_mm.shape)
    names = ("x", "y", "z", "tx", "ty", "tz", "mx", "my", "mz")
    columns = dict(zip(names, np.hstack([q_mm, place_mm, seen_mm]).T, strict=True))
    observations = observations_from_columns(columns | {"carrier": ["relative"] * 200})
    machine = geoerr.Machine.from_chain("wZbXYt", (400.0, 400.0, 400.0))

    li = geoerr.fit_model(machine, observations)
    dobariya = geoerr.fit_model(machine, observations, components="12")
    unlisted = geoerr.fit_model(geoerr.Machine.from_chain("wYbZXt", (400.0, 300.0, 250.0)), observations)

    squareness = ("S_xy", "S_xz", "S_yz")
    assert {term.id for term in li.model.terms} == {*LINEAR_AND_ANGULAR, *squareness}
    assert {term.id for term in dobariya.model.terms} == {f"E{b}{a}" for a in "XYZ" for b in "XYZ"} | set(squareness)
    assert {term.id for term in unlisted.model.terms} == {term.id for term in li.model.terms}
    assert unlisted.model.machine.chain == "wYbZXt"
    by_options = geoerr.fit_model(machine, observations, options=geoerr.FitOptions("12"))
    assert by_options.to_document() == dobariya.to_document()
    with_effect = geoerr.fit_model(machine, observations, components="none", effects=("scale:x",))
    assert [term.id for term in with_effect.model.terms] == ["scale:x"]


def test_importing_geoerr_loads_no_heavy_library() -> None:
    heavy = "('cv2', 'polars', 'plotly', 'reportlab')"
    code = f"import sys, geoerr; sys.exit(any(name in sys.modules for name in {heavy}))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_stubs_agree_with_the_compiled_core(tmp_path: Path) -> None:
    allowed = tmp_path / "allowed.txt"
    # pyo3 makes `__all__` by itself.
    allowed.write_text("geoerr._core.__all__\n")
    command = [sys.executable, "-m", "mypy.stubtest", "geoerr._core", "--allowlist", str(allowed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
