"""What verbs print fits a terminal of eighty columns; a line to copy may go on, and what has no space in it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from geoerr.cli.main import app
from geoerr.cli.text_tables import WIDTH, say

ROOT = Path(__file__).parents[2]
MILL = ("observations.csv", "--machine", "machine.toml")
HOT = ("--at", "temp_bed=90")
PROGRAM = "G21\nG90\nG0 X20 Y60 Z50\nG1 X380 Y380 F1200\n"
LENGTHS = "feature,x1,y1,z1,x2,y2,z2,measured,group,d_x,temp_bed\n" + "".join(
    f"bar {number},0,0,0,{100 * number},0,0,{100 * number + 0.01 * number},a group with quite a long name,1,20\n"
    for number in (1, 2, 3)
)
VERBS = {
    "fit": ("fit", *MILL),
    "identify": ("identify", *MILL),
    "identify, nine lines": ("identify", *MILL, "--method", "nine-line"),
    "compare": ("compare", "model.json", "observations.csv"),
    "compare, with lengths": ("compare", "model.json", "observations.csv", "lengths.csv"),
    "compare, without errors": ("compare", "machine.toml", "observations.csv"),
    "diagnose": ("diagnose", "model.json", "observations.csv", "--verbose"),
    "diagnose a circle": ("diagnose", "circles/machine.toml", "circles/circle.csv"),
    "add": ("add", "model.json", "observations.csv", "empirical:z@x*y"),
    "remove": ("remove", "model.json", "observations.csv", "backlash:x"),
    "report": ("report", "model.json", "observations.csv", "--no-search"),
    "states": ("states", "20=observations.csv", "60=observations.csv", "90=observations.csv", *MILL[1:]),
    "budget": ("budget", "model.json", *HOT, "--at-std", "temp_bed=2"),
    "budget of places": ("budget", "model.json", *HOT, "--place", "200,150,80", "--place", "10,10,10"),
    "compensate": ("compensate", "model.json", "line.gcode", "-o", "out.gcode", "--at", "temp_bed=40"),
    "verify path": ("verify", "path", "model.json", "line.gcode", "line.gcode", "--at", "temp_bed=40"),
    "verify ballbar": ("verify", "ballbar", "model.json", "--radius", "100", *HOT),
    "verify ballbar of a trace": ("verify", "ballbar", "circles/machine.toml", "--trace", "circles/circle.csv"),
    "verify workpiece": ("verify", "workpiece", "lengths.csv", "lengths.csv"),
    "doctor": ("doctor", "observations.csv", "a-file-with-a-long-name-that-is-not-there.csv"),
    "refused": ("fit", "observations.csv", "--machine", "observations.csv"),
}


def too_wide(text: str) -> list[str]:
    lines = [re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line) for line in text.splitlines()]
    return [line for line in lines if len(line) > WIDTH and " " in line.strip() and not line.startswith("  geoerr ")]


@pytest.fixture(scope="module")
def mill(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a mill's measurements and model, lengths, a program, and another machine's circles."""
    folder = tmp_path_factory.mktemp("mill")
    for name, place in (("warm-mill", folder), ("circles", folder / "circles")):
        command = [sys.executable, str(ROOT / "examples" / "virtual_machines.py"), name, str(place)]
        subprocess.run(command, check=True)
    (folder / "line.gcode").write_text(PROGRAM, encoding="utf-8")
    (folder / "lengths.csv").write_text(LENGTHS, encoding="utf-8")
    effects = ("--add", "backlash:x", "--add", "thermal-expansion:y@temp_bed")
    with pytest.MonkeyPatch.context() as moved:
        moved.chdir(folder)
        done = CliRunner().invoke(app, ["fit", *MILL, "--components", "12", *effects, "-o", "model.json"])
    assert done.exit_code == 0, done.output
    return folder


@pytest.mark.parametrize("name", VERBS)
def test_nothing_is_wider_than_a_terminal(name: str, mill: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(mill)
    monkeypatch.setenv("COLUMNS", str(WIDTH))
    done = CliRunner().invoke(app, list(VERBS[name]))
    assert done.exit_code == (1 if name in ("doctor", "refused") else 0), done.output
    assert not too_wide(done.output)


@pytest.mark.skipif(os.name != "posix", reason="no terminal that a test could make")
def test_a_terminal_says_how_wide_it_is(mill: Path) -> None:
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 60, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    command = [sys.executable, "-m", "geoerr", *VERBS["compensate"]]
    with subprocess.Popen(command, cwd=mill, env=environment, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        text = b""
        while True:
            try:
                part = os.read(ours, 1 << 16)
            except OSError:
                break
            if not part:
                break
            text += part
    os.close(ours)
    assert process.returncode == 0
    lines = [line for line in text.decode().splitlines() if "\x1b" not in line]
    assert any(line.startswith("note: left as it is") for line in lines)
    assert max(map(len, lines)) <= 60


def test_what_is_copied_is_not_broken(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    command = f"  geoerr add {'a' * 30}.json {'b' * 30}.csv backlash:x"
    address = f"http://127.0.0.1:8050/{'c' * 60}"
    say(f"to add it:\n{command}\nnote: {address} is open, and what else there is to say of it stands below")
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == command
    assert f"  {address}" in lines
    assert lines[-1] == "  is open, and what else there is to say of it stands below"
