"""Channels through the bindings: a second implementation in NumPy, refusals, threads."""

from __future__ import annotations

import numpy as np
import pytest
from chains import CHAINS, Floats
from scipy.spatial.transform import Rotation

from geoerr import _core
from geoerr.errors import GeometryError, ShapeError

TOOL_OFFSET = (3.0, -20.0, 55.0)


def drawn(n: int, size: float = 1.0) -> tuple[Floats, Floats, Floats]:
    """Positions, offsets and displacements of a very poor machine: 3 mm and 10 mrad."""
    random = np.random.default_rng(5)
    is_angle = np.array([name[1] in "ABC" or name.startswith("S_") for name in _core.CHANNELS[:30]])
    channels = size * random.normal(size=(n, 30)) * np.where(is_angle, 0.01, 3.0)
    return random.uniform(-300, 300, (n, 3)), random.uniform(-200, 200, (n, 3)), channels


def matrix(axis: int, side: int, q: Floats, channels: Floats) -> Floats:
    """One carriage as a 4 by 4 matrix, straight from the definition."""
    cosines = np.cos(np.pi / 2 + channels[18:21])
    y = np.array([cosines[0], np.sqrt(1 - cosines[0] ** 2), 0.0])
    z = np.linalg.solve(np.array([[1.0, 0.0], [y[0], y[1]]]), cosines[1:])
    directions = np.array([[1.0, 0.0, 0.0], y, [*z, np.sqrt(1 - z @ z)]])
    carriage = np.eye(4)
    carriage[:3, :3] = Rotation.from_rotvec(side * channels[6 * axis + 3 : 6 * axis + 6]).as_matrix()
    carriage[:3, 3] = side * (q[axis] * directions[axis] + channels[6 * axis : 6 * axis + 3])
    return carriage


def seen(chain: str, carrier: str, q: Floats, offset: Floats, channels: Floats) -> Floats:
    tool_shift, work_shift, target = channels[21:24], channels[24:27], channels[27:30]
    work_letters, tool_letters = chain[1:-1].split("b")
    tool, work = np.eye(4), np.eye(4)
    tool[:3, 3], work[:3, 3] = tool_shift, work_shift
    for letter in tool_letters:
        tool = tool @ matrix("XYZ".index(letter), 1, q, channels)
    for letter in reversed(work_letters):
        work = work @ matrix("XYZ".index(letter), -1, q, channels)
    if carrier == "base":
        return offset
    place = offset + target + (TOOL_OFFSET if carrier in ("tool", "relative") else np.zeros(3))
    whole = {"tool": tool, "work": work, "relative": np.linalg.inv(work) @ tool}[carrier]
    position: Floats = (whole @ np.append(place, 1.0))[:3]
    return position


@pytest.mark.parametrize("chain", CHAINS)
def test_positions_against_matrices(chain: str) -> None:
    q, offset, channels = drawn(12)
    carriers = np.arange(12, dtype=np.uint8) % 4
    arguments = (carriers, q, offset, TOOL_OFFSET, channels, 1)
    position = _core.chain_positions(chain, "position", *arguments)
    expected = [
        seen(chain, _core.CARRIERS[carrier], *row)
        for carrier, *row in zip(carriers, q, offset, channels, strict=True)
    ]
    # Rounding of some thirty operations on 700 mm.
    np.testing.assert_allclose(position, expected, rtol=0.0, atol=2e-12)
    parts = [_core.chain_positions(chain, what, *arguments) for what in ("nominal", "displacement")]
    np.testing.assert_allclose(parts[0] + parts[1], position, rtol=0.0, atol=2e-13)


@pytest.mark.parametrize("chain", CHAINS)
def test_columns_are_the_limit_of_small_displacements(chain: str) -> None:
    q, offset, channels = drawn(12, 1e-6)
    carriers = np.arange(12, dtype=np.uint8) % 4
    columns = _core.channel_columns(chain, carriers, q, offset, TOOL_OFFSET, 1)
    exact = _core.chain_positions(chain, "displacement", carriers, q, offset, TOOL_OFFSET, channels, 1)
    # Second order: (1e-8 rad)² of a metre, and 3e-6 mm times 1e-8 rad, with dozens of pairs.
    np.testing.assert_allclose(np.einsum("nc,ncb->nb", channels, columns[:, :30]), exact, rtol=0.0, atol=2e-11)


def test_the_rig_against_its_definition() -> None:
    random = np.random.default_rng(6)
    base = random.uniform(-300, 300, (40, 3))
    turn, shift = Rotation.random(random_state=7).as_matrix(), (30.0, -60.0, 800.0)
    rig = random.normal(size=(40, 11)) * ([2.0] * 3 + [0.01] * 3 + [1e-3, 1e-3, 1e-6, 1e-3, 1e-3])
    camera = base @ turn.T + shift
    moved = Rotation.from_rotvec(rig[:, 3:6]).apply(camera) + rig[:, :3]
    ray = np.column_stack([rig[:, 9], rig[:, 10], rig[:, 7]])
    expected = moved * (1 + rig[:, 6:7]) + moved[:, 2:] * (rig[:, 8:9] * moved + ray)
    measured = _core.measured_from_base(turn, shift, rig, base, 1)
    np.testing.assert_allclose(measured, expected, rtol=0.0, atol=2e-12 * 2000)

    columns = _core.rig_columns(turn, shift, base, 1)
    assert columns.shape == (40, len(_core.RIG_COLUMNS), 3)
    named = dict(zip(_core.RIG_COLUMNS, np.moveaxis(columns, 1, 0), strict=True))
    np.testing.assert_allclose(named["rig-scale"], camera, atol=1e-12)
    np.testing.assert_allclose(named["rig-disparity"], camera[:, 2:] * camera, atol=1e-8)
    np.testing.assert_allclose(named["rig-rz"], np.cross([0.0, 0.0, 1.0], camera), atol=1e-12)
    np.testing.assert_allclose(named["rig-ray-x"], camera[:, 2:] * [1.0, 0.0, 0.0], atol=1e-12)


def test_names() -> None:
    assert len(_core.CHANNELS) == len(set(_core.CHANNELS)) == 44
    assert _core.CHANNELS[:6] == ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX")
    assert _core.CHANNELS[18:30:3] == ("S_xy", "tool-x", "work-x", "target-x")
    assert (*_core.BASE_COLUMNS[:30], *_core.RIG_COLUMNS, *_core.BASE_COLUMNS[30:]) == _core.CHANNELS
    assert _core.BASE_COLUMNS[30:] == ("motion-x", "motion-y", "motion-z")
    assert _core.CARRIERS == ("tool", "work", "base", "relative")


def test_same_bytes_from_any_number_of_threads() -> None:
    q, offset, channels = drawn(10_000)
    carriers = np.arange(10_000, dtype=np.uint8) % 4

    def run(threads: int) -> tuple[bytes, bytes]:
        columns = _core.channel_columns("wXbYZt", carriers, q, offset, TOOL_OFFSET, threads)
        seen = _core.chain_positions("wXbYZt", "position", carriers, q, offset, TOOL_OFFSET, channels, threads)
        return columns.tobytes(), seen.tobytes()

    assert run(1) == run(3)


def test_a_bad_row_is_alone() -> None:
    q, offset, channels = drawn(4)
    channels[1, 18], q[2, 0] = 2.0, np.nan
    carriers = np.zeros(4, dtype=np.uint8)
    seen = _core.chain_positions("wbXYZt", "position", carriers, q, offset, TOOL_OFFSET, channels, 1)
    assert np.isfinite(seen[[0, 3]]).all()
    assert np.isnan(seen[[1, 2]]).any(axis=1).all()


def test_refusals() -> None:
    q, offset, channels = drawn(3)
    carriers = np.zeros(3, dtype=np.uint8)
    with pytest.raises(GeometryError, match="4 is not a carrier"):
        _core.channel_columns("wZbXYt", carriers + np.uint8(4), q, offset, TOOL_OFFSET, 1)
    with pytest.raises(GeometryError, match="not a structural code"):
        _core.channel_columns("wZXYt", carriers, q, offset, TOOL_OFFSET, 1)
    with pytest.raises(ShapeError, match="2 carriers for 3 positions"):
        _core.channel_columns("wZbXYt", carriers[:2], q, offset, TOOL_OFFSET, 1)
    with pytest.raises(ShapeError, match="1 offsets for 3 positions"):
        _core.channel_columns("wZbXYt", carriers, q, offset[:1], TOOL_OFFSET, 1)
    with pytest.raises(ShapeError, match="2 channels for 3 positions"):
        _core.chain_positions("wZbXYt", "position", carriers, q, offset, TOOL_OFFSET, channels[:2], 1)
    with pytest.raises(ShapeError, match="what must be position, displacement or nominal"):
        _core.chain_positions("wZbXYt", "place", carriers, q, offset, TOOL_OFFSET, channels, 1)
    with pytest.raises(ShapeError, match="camera_from_base must be a"):
        _core.rig_columns(np.eye(4)[:, :3].copy(), (0.0, 0.0, 0.0), q, 1)
    with pytest.raises(ShapeError, match="2 rig numbers for 3 positions"):
        _core.measured_from_base(np.eye(3), (0.0, 0.0, 0.0), np.zeros((2, 11)), q, 1)
