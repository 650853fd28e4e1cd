"""The site: it is built without a warning, asks nothing of another host, and has every public name and verb."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import geoerr
from geoerr.cli.main import VERBS

ROOT = Path(__file__).parents[2]
# What is fetched to show a page, as against what is followed when it is clicked on.
FETCHED = {"script": "src", "img": "src", "source": "src", "iframe": "src", "object": "data", "link": "href"}
_ELSEWHERE = re.compile(r"(?:https?:)?//")
_IN_STYLES = re.compile(r"(?:url\(|@import)\s*['\"]?((?:https?:)?//[^'\")\s]+)")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    # Members in the tree beside a page take a sixth of the time, and nothing that is tested here; what pages print is
    # tested page by page.
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-c", "docs"]
    command += ["-D", "toc_object_entries=0", "-D", "run_pages=0", ".", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_nothing_is_asked_of_another_host(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    asked = {target for page in pages for target in fetched_by(page.read_text(encoding="utf-8"))}
    asked |= {
        target for style in site.rglob("*.css") for target in _IN_STYLES.findall(style.read_text(encoding="utf-8"))
    }
    assert not asked


def test_equations_and_pictures_are_on_their_pages(site: Path) -> None:
    assert "<math" in (site / "docs" / "theory" / "equations.html").read_text(encoding="utf-8")
    gallery = (site / "docs" / "gallery.html").read_text(encoding="utf-8")
    pictures = set(re.findall(r'src="(\.\./_images/[^"]+\.svg)"', gallery))
    assert len(pictures) == len(list((ROOT / "docs" / "gallery").glob("*.svg")))
    assert all((site / "docs" / picture).is_file() for picture in pictures)


def test_every_verb_and_every_public_name_is_described(site: Path) -> None:
    commands = (site / "docs" / "reference" / "commands.html").read_text(encoding="utf-8")
    assert set(VERBS) <= set(re.findall(r'id="geoerr-([a-z]+)"', commands))
    described = {
        name
        for page in (site / "docs" / "reference" / "python").glob("*.html")
        for name in re.findall(r'<dt [^>]*id="geoerr\.(\w+)"', page.read_text(encoding="utf-8"))
    }
    assert set(geoerr.__all__) - {"__version__"} <= described


def fetched_by(page: str) -> list[str]:
    """Give what a page has fetched from elsewhere, in its elements and in its styles."""
    reader = _Fetched()
    reader.feed(page)
    return [target for target in reader.targets if _ELSEWHERE.match(target)] + _IN_STYLES.findall(page)


class _Fetched(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        target = dict(attrs).get(FETCHED.get(tag, ""))
        if target:
            self.targets.append(target)


def test_what_would_be_fetched_is_seen() -> None:
    elsewhere = "https://example.org/a"
    assert fetched_by(f'<script src="{elsewhere}"></script><a href="{elsewhere}">to click on</a>') == [elsewhere]
    assert fetched_by('<style>@import "//example.org/b";</style><img src="c.svg">') == ["//example.org/b"]


@pytest.mark.parametrize("run_pages", [True, False])
def test_a_page_that_tells_something_else_stops_the_build(tmp_path: Path, run_pages: bool) -> None:
    docs = tmp_path / "docs"
    (docs / "guides").mkdir(parents=True)
    for name in ("make_tutorials.py", "extensions/run_pages.py"):
        shutil.copy(ROOT / "docs" / name, docs)
    conf = "import sys\nsys.path.insert(0, 'docs')\nextensions = ['myst_parser', 'run_pages']\n"
    (docs / "conf.py").write_text(conf + "root_doc = 'docs/guides/right'\nexclude_patterns = ['site']\n")
    told = "# A page\n\n```python\nprint(6 * 7)\n```\n\n```text\n{}\n```\n"
    tree = "\n```{toctree}\nwrong\nbroken\n```\n"
    pages = {"right": told.format(42) + tree, "wrong": told.format(54), "broken": told.replace("6", "six").format(42)}
    for name, page in pages.items():
        (docs / "guides" / f"{name}.md").write_text(page)
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", "-c", "docs"]
    command += [*([] if run_pages else ["-D", "run_pages=0"]), ".", "site"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode != 0) == run_pages, done.stderr
    assert ("wrong.md:8: WARNING: says '54', and what comes out is '42'" in done.stderr) == run_pages
    assert ("broken.md: WARNING: does not run: NameError: name 'six' is not defined" in done.stderr) == run_pages
    assert "right.md" not in done.stderr
    assert {name: (docs / "guides" / f"{name}.md").read_text() for name in pages} == pages
