"""What `import geoerr` offers: every name there, lazily, and stubs that agree with the compiled core."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import geoerr


def test_every_public_name_is_there() -> None:
    assert set(geoerr._HOMES) | {"__version__"} == set(geoerr.__all__)
    for name in geoerr.__all__:
        assert getattr(geoerr, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = geoerr.no_such_name  # type: ignore[attr-defined]  # the point of the test


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
