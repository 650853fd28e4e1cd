"""Runs tutorials, guides and theory and writes what they print into them: `python docs/make_tutorials.py [PAGE...]`.

A page is Markdown. Its blocks run one after the other in a folder of their own, in which `examples` and `validation`
are the project's:

- Python, in one namespace for the whole page;
- `console`: lines that begin with `$ ` are commands, joined where a backslash ends them;
- any block below `<!-- file: NAME -->` is written to that file.

What a block prints stands in a block of text after it. A command that is refused stands below
`<!-- exit status 1 -->`; what only a person can do (cameras, a machine) below `<!-- not run -->`. Blocks below
`<!-- needs GEOERR_TEST_DATA -->` run where that variable names the folder of real data, and else keep what they
printed there. Whoever builds the site runs the pages too (`extensions/run_pages.py`), and so do tests, and both hold
them to what stands in them.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import subprocess
import sys
import tempfile
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

DOCS = Path(__file__).parent
FOLDERS = ("tutorials", "guides", "theory")
_BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^\n]*?) -->\n)?```(?P<language>\w+)\n(?P<code>.*?)```\n(?P<printed>\n```text\n.*?```\n)?",
    re.DOTALL,
)
_REAL_DATA = "<!-- needs GEOERR_TEST_DATA -->"
_COMMAND = re.compile(r"^\$ ((?:.*\\\n)*.*)$", re.MULTILINE)
_FINGERPRINT = re.compile(r"model [0-9a-f]{12}")
_NUMBER = re.compile(r"[−-]?\d+(?:\.\d+)?(?:e[−-]?\d+)?")


class Difference(NamedTuple):
    """A line of a page, from 1 on, and the line that came out in its place."""

    line: int
    there: str
    now: str


def pages() -> list[Path]:
    """Give all pages that run."""
    return [path for folder in FOLDERS for path in sorted((DOCS / folder).glob("*.md"))]


def has_real_data() -> bool:
    """Tell whether GEOERR_TEST_DATA names a folder."""
    return Path(os.environ.get("GEOERR_TEST_DATA") or DOCS / "none").is_dir()


def run_page(page: str, *, with_real_data: bool) -> tuple[str, dict[str, Any]]:
    """Run a page's blocks; give the page with what they printed, and all that they named."""
    own, _, real = page.partition(_REAL_DATA)
    names: dict[str, Any] = {"__name__": "tutorial"}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for shared in ("examples", "validation"):
            (folder / shared).symlink_to(DOCS.parent / shared, target_is_directory=True)
        with contextlib.chdir(folder):
            own = _BLOCK.sub(lambda block: _done(block, names), own)
            if real and with_real_data:
                real = _BLOCK.sub(lambda block: _done(block, names), real)
    return own + (_REAL_DATA + real if real else ""), names


def differences(page: str, made: str) -> list[Difference]:
    """Tell where a page says something else than what came out; of unlike numbers of lines the first place.

    Words count to the letter, numbers to 5 % or two of the last digit: other processors round otherwise.
    """
    # A model's fingerprint has all its digits in it.
    there, now = (_FINGERPRINT.sub("model #", text).splitlines() for text in (page, made))
    lines = enumerate(zip_longest(there, now, fillvalue="(the end)"), start=1)
    found = [Difference(number, *both) for number, both in lines if not _says(*both)]
    return found if len(there) == len(now) else found[:1]


def _says(there: str, now: str) -> bool:
    if _NUMBER.sub("#", there).split() != _NUMBER.sub("#", now).split():
        return False
    return all(map(_near, _NUMBER.findall(there), _NUMBER.findall(now)))


def _near(there: str, now: str) -> bool:
    one, other = (float(text.replace("−", "-")) for text in (there, now))
    # A probability far from any that matters is told by its power of ten.
    if 0.0 < one < 1e-6 and 0.0 < other < 1e-6:
        return math.isclose(math.log(one), math.log(other), rel_tol=0.05)
    digits = len(there.partition("e")[0].partition(".")[2])
    return math.isclose(one, other, rel_tol=0.05, abs_tol=2.0 * 10.0**-digits)


def _done(block: re.Match[str], names: dict[str, Any]) -> str:
    mark, language, code = block["mark"] or "", block["language"], block["code"]
    if mark.startswith("file: "):
        Path(mark.removeprefix("file: ")).write_text(code, encoding="utf-8")
        return block[0]
    if mark == "not run" or language == "text":
        return block[0]
    if language == "python":
        printed = _printed_by_python(code, names)
    elif language == "console":
        printed = _printed_by_commands(code, status=1 if mark == "exit status 1" else 0)
    else:
        return block[0]
    text = "\n".join(line.rstrip() for line in printed.strip("\n").splitlines())
    head = f"<!-- {mark} -->\n" if mark else ""
    return f"{head}```{language}\n{code}```\n" + (f"\n```text\n{text}\n```\n" if text else "")


def _printed_by_python(code: str, names: dict[str, Any]) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "tutorial", "exec"), names)  # the page is ours
    return printed.getvalue()


def _printed_by_commands(code: str, *, status: int) -> str:
    """Run commands as a shell does, on this interpreter's geoerr; what they say and what they refuse in one text."""
    shell = f'python() {{ "{sys.executable}" "$@"; }}; geoerr() {{ python -m geoerr "$@"; }}; set -o pipefail\n'
    commands = [shell + command for command in _COMMAND.findall(code)]
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    # A page is the same, however wide the window is in which it is made.
    environment.pop("COLUMNS", None)
    printed = []
    for number, command in enumerate(commands, start=1):
        done = subprocess.run(
            ["bash", "-c", command],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        printed.append(done.stdout)
        if done.returncode != (status if number == len(commands) else 0):
            raise RuntimeError(f"{command.partition(chr(10))[2]}\nended with {done.returncode}:\n{done.stdout}")
    return "".join(printed)


if __name__ == "__main__":
    for path in [Path(name) for name in sys.argv[1:]] or pages():
        made, _ = run_page(path.read_text(encoding="utf-8"), with_real_data=has_real_data())
        path.write_text(made, encoding="utf-8")
