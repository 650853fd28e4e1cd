"""What the benches print is read as it is meant, and what they measure accuracy with measures it."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

BENCHES = Path(__file__).parents[2] / "benches"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHES / "python"))
    monkeypatch.setattr(sys, "path", sys.path)
    results = importlib.import_module("results")
    monkeypatch.setattr(results, "seconds_of_products", lambda flop: 0.1)
    return results


def section(title: str) -> str:
    parts = re.split(r"^## (.*)$", (BENCHES / "RESULTS.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))[title]


RANKED = "ranking of names, with what chance finds"
DIAGNOSIS = [
    (1, "candidates laid out: 160, 14217 ways", 0.124, ""),
    (1, "noise fitted, space whitened", 0.0211, ""),
    (1, RANKED, 0.351, "gains within 1e-04"),
    (1, "add backlash:x", 0.104, "0.01 ± 0.0001 mm, 0.01 hidden; coefficients within 1e-05 std of SciPy's"),
    (1, "peer of add backlash:x: scipy least_squares", 4.16, ""),
    (1, "add thermal-expansion:y@temp_bed", 0.258, "1e-05 ± 1e-07 /K"),
    (2, "candidates laid out: 160, 14217 ways", 0.1234, ""),
    (2, "noise fitted, space whitened", 0.0288, ""),
    (2, RANKED, 0.1954, "gains within 1e-04"),
    (2, "add backlash:x", 0.0679, "0.01 ± 0.0001 mm, 0.01 hidden"),
    (2, "add thermal-expansion:y@temp_bed", 0.16, ""),
]
PEERS = [(1, f"peer of the ranking: {name}", seconds, "") for name, seconds in (("OMP", 48.0), ("LassoLarsIC", 27.0))]


def test_rows_of_a_diagnosis_have_accuracy_peers_and_what_is_not_in_them(bench: ModuleType) -> None:
    lines = [(n, *one) for n in (10_000, 100_000) for one in DIAGNOSIS] + [(10_000, *one) for one in PEERS]
    printed = "".join(f"| {n} | {threads} | {step} | {s} | {s} | {said} |\n" for n, threads, step, s, said in lines)
    small, large, play, _ = bench.rows_of_diagnosis(printed)
    assert small.reached == "0.195 s on two threads, without candidates (0.123 s, once) and noise model (0.0288 s)"
    assert small.accuracy == "gains within 1e-04 of NumPy's"
    assert small.peer == "LassoLarsIC: 27 s, OMP: 48 s"
    assert small.times_peer == pytest.approx(27.0 / 0.351)
    assert small.share_of_limit == pytest.approx(0.05 / 0.1954)
    assert large.peer == ""
    assert large.times_peer is None
    assert play.peer == "scipy least_squares: 4.16 s"
    assert play.times_peer == pytest.approx(40.0)
    assert play.accuracy.endswith("of SciPy's")
    assert bench.summary_table([small, large, play]).count("\n") == 5


def test_the_first_fit_is_read_from_the_joint_fit(bench: ModuleType) -> None:
    (row,) = bench.rows_of_joint_fit(section("Joint fit of 21 spline functions"))
    assert row.aim == "0.5"
    # Whether it is reached is told by the results, at whichever hour they were made, and is no test.
    assert row.share_of_aim == pytest.approx(0.5 / float(row.reached.split()[0]), rel=2e-3)
    assert re.fullmatch(r"coefficients within \de-0\d std of SciPy's, bases given", row.accuracy)
    assert row.times_peer > 10.0


def test_least_squares_are_read_as_they_are_printed(bench: ModuleType) -> None:
    rows = bench.rows_of_least_squares(section("Least squares, 30,000 × 300"))
    assert all(row.accuracy.startswith("error ") and row.times_peer > 1.0 for row in rows)


def test_the_processor_and_its_registers_are_named(bench: ModuleType) -> None:
    processor, registers = bench.processor_and_registers()
    assert processor
    assert "registers" in registers or registers.startswith(("kernels in AVX2 + FMA", "kernels in SSE2"))


def test_what_a_written_program_misses_is_measured(bench: ModuleType) -> None:
    """Moves whose commands are exact but for what is put in: 0.3 µm at an end."""
    programs = importlib.import_module("programs")
    model = programs.bent()
    # Short ones: a straight move between exact ends leaves its line by less than a micrometre.
    meant = np.array([[100.0, 100.0, 5.0], [100.4, 100.0, 5.0], [100.4, 100.4, 5.0], [100.2, 100.2, 5.2]])
    commands = model.commands_for(meant)
    before = "G28\nG1 Z5 F1200\n" + written(meant)
    ends_um, path_um = programs.closeness_um(model, before, written(commands))
    assert ends_um < 1e-3
    assert 1e-4 < path_um < 1.0
    # A move in two pieces is one move.
    halves = np.insert(commands, 2, 0.5 * (commands[1] + commands[2]), axis=0)
    assert programs.closeness_um(model, before, written(halves)) == pytest.approx((ends_um, path_um), abs=1e-2)
    commands[-1, 2] += 3e-4
    assert programs.closeness_um(model, before, written(commands))[0] == pytest.approx(0.3, abs=0.01)
    commands[-1, 2] += 0.05
    with pytest.raises(ValueError, match="4 moves, of which the written ones reach 3"):
        programs.closeness_um(model, before, written(commands))
    with pytest.raises(ValueError, match="3 moves, of which the written ones reach 3"):
        programs.closeness_um(model, "G28\nG1 Z5 F1200\n" + written(meant[:3]), written(commands))


def written(places: np.ndarray) -> str:
    return "".join(f"G1 X{x:.9f} Y{y:.9f} Z{z:.9f} E.1\n" for x, y, z in places)


def test_a_program_that_was_not_built_is_told_before_anything_is_measured(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last path of half an hour ended with a FileNotFoundError, and nothing was written of the others."""
    scaling, programs = importlib.import_module("scaling"), importlib.import_module("programs")
    monkeypatch.setattr(programs, "BINARY", tmp_path / "gcode_stream")
    monkeypatch.setattr(scaling, "SETTINGS", {})
    monkeypatch.setattr(scaling, "all_taken", lambda name, sizes: pytest.fail(f"{name} is measured"))
    monkeypatch.setattr(sys, "argv", ["scaling.py", "--to", str(tmp_path)])
    with pytest.raises(SystemExit):
        scaling.main()
    assert "cargo build --release -p geoerr-bench --bin gcode_stream" in capsys.readouterr().err


def test_a_folder_that_is_not_there_is_made(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It was missed when all had been measured."""
    scaling = importlib.import_module("scaling")
    taken = [scaling.Taken(10**power, 1e-6 * 3**power, 1.0, 1.0) for power in (1, 2)]
    monkeypatch.setattr(scaling, "SETTINGS", {})
    monkeypatch.setattr(scaling, "all_taken", lambda name, sizes: (taken, ""))
    monkeypatch.setattr(
        sys, "argv", ["scaling.py", "--path", "lines of 50 points", "--to", str(tmp_path / "new" / "er")]
    )
    scaling.main()
    assert "| lines of 50 points | 100 |" in (tmp_path / "new" / "er" / "SCALING.md").read_text()


def test_rows_of_paths_that_are_not_asked_for_stay(
    bench: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    scaling = importlib.import_module("scaling")
    of_path = {"lines of 50 points": 1e-6, "straightness, trapezoid": 2e-6}
    monkeypatch.setattr(scaling, "SETTINGS", {})
    monkeypatch.setattr(
        scaling,
        "all_taken",
        lambda name, sizes: (
            [scaling.Taken(size, of_path[name] * (size / 10) ** 1.2, 1.0, 1.0) for size in (10, 1000)],
            f"all of {of_path[name]} left out.",
        ),
    )
    for name in ("straightness, trapezoid", "lines of 50 points"):
        monkeypatch.setattr(sys, "argv", ["scaling.py", "--path", name, "--to", str(tmp_path)])
        scaling.main()
    first = (tmp_path / "SCALING.md").read_text()
    assert "| straightness, trapezoid | 10 | 2e-06 |" in first
    assert "- straightness, trapezoid: all of 2e-06 left out." in first
    of_path["straightness, trapezoid"] = 3e-6
    monkeypatch.setattr(sys, "argv", ["scaling.py", "--path", "straightness, trapezoid", "--to", str(tmp_path)])
    scaling.main()
    second = (tmp_path / "SCALING.md").read_text()
    assert "| straightness, trapezoid | 10 | 3e-06 |" in second
    assert "- straightness, trapezoid: all of 3e-06 left out." in second
    assert [line for line in second.splitlines() if "straight" not in line] == [
        line for line in first.splitlines() if "straight" not in line
    ]
