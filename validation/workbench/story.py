"""The whole story on the workbench, in a browser without a screen: load, see, learn, add, watch, correct, print.

    python validation/workbench/story.py machine.toml observations.csv part.gcode OUT [--browser /usr/bin/chromium]

Writes a screenshot of every stage at 1366 × 768 and 1920 × 1080 to OUT and prints how long each step took, from the
click to the page's own answer. Fails where the page asks anything of another host or reports an error. Needs
Playwright and a Chromium.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

SIZES = ((1366, 768), (1920, 1080))
# Of a window that is turned, or of two above each other: its lower half is to be used too.
TALL_PX = 1500
_MOST_EMPTY_PX = 40
# Drawing without a graphics card.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# Searching a large data set on two cores.
PATIENCE_MS = 600_000
# A look at the pictures.
_SEEN_MS = 2000
NO_HARM = ("willReadFrequently", "GPU stall", "GL Driver Message")

# Notes when the mouse is let go, and when a part of the page first says something else, and what is waited for.
_CLOCK = """([part, text]) => {
  window.answeredMs = 0;
  const released = () => { window.releasedMs = performance.now(); };
  document.addEventListener("mouseup", released, { once: true, capture: true });
  const watched = document.querySelector(part);
  new MutationObserver(() => {
    if (!window.answeredMs && watched.innerText.includes(text)) { window.answeredMs = performance.now(); }
  }).observe(watched, { childList: true, subtree: true, characterData: true });
}"""


class Story:
    """One walk through the page at one size."""

    def __init__(self, page: Any, out: Path, width_px: int) -> None:
        self.page, self.out, self.width_px = page, out, width_px
        self.number = 0
        self.outside: list[str] = []
        self.errors: list[str] = []
        page.on("request", self._asked)
        page.on("console", self._said)
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def _asked(self, request: Any) -> None:
        if not request.url.startswith(("http://127.0.0.1", "data:", "blob:")):
            self.outside.append(request.url)

    def _said(self, message: Any) -> None:
        if message.type == "error" and not any(text in message.text for text in NO_HARM):
            self.errors.append(message.text)

    def shoot(self, name: str, *, is_whole: bool = False) -> None:
        """Take a screenshot when the pictures have settled."""
        self.number += 1
        self.page.wait_for_timeout(1200)
        self.page.screenshot(path=self.out / f"{self.width_px}-{self.number:02d}-{name}.png", full_page=is_whole)

    def ready(self) -> None:
        """Wait until no work is under way."""
        self.page.wait_for_selector("#status >> text=ready", timeout=PATIENCE_MS)

    def do(self, name: str, act: Callable[[], None], until: str | None = None) -> float:
        """Do something and wait until it is done; print the seconds."""
        began = time.monotonic()
        act()
        refused = self.page.locator(".problem")
        if until is not None:
            self.page.locator(until).or_(refused).first.wait_for(timeout=PATIENCE_MS)
        self.ready()
        assert refused.count() == 0, f"{name}: {refused.first.inner_text()}"
        took_s = time.monotonic() - began
        print(f"{self.width_px:5d}  {name:<28} {took_s:7.2f} s")
        return took_s


def brush(story: Story) -> None:
    """Drag a box over the upper half of the first component; tell the time until the page says what is marked.

    By the page's own clock: what drives the browser waits for every picture to be drawn.
    """
    box = story.page.locator("#residual .draglayer .xy .nsewdrag").first.bounding_box()
    mouse = story.page.mouse
    mouse.move(box["x"] + 0.55 * box["width"], box["y"] + 4)
    mouse.down()
    mouse.move(box["x"] + 0.95 * box["width"], box["y"] + 0.9 * box["height"], steps=5)
    story.page.evaluate(_CLOCK, ["#marked", ""])
    mouse.up()
    tell_the_clock(story, "brush to answer")
    story.page.wait_for_selector("#marked >> text=rows marked", timeout=PATIENCE_MS)


def brush_the_volume(story: Story) -> None:
    """Mark rows by boxes over the volume: the two halves of the picture hold what the whole holds; then by keys."""
    page = story.page
    page.click("label:has-text('mark by a box')")
    sheet = page.locator("#view-box-sheet")
    sheet.wait_for()
    at = sheet.bounding_box()
    # Below the line that says how.
    top, middle, foot = at["y"] + 40, at["x"] + 0.47 * at["width"], at["y"] + at["height"] - 2
    left, right = at["x"] + 2, at["x"] + at["width"] - 2
    counts = []
    for begin, end in ((left, right), (middle, left), (middle, right)):
        page.mouse.move(begin, top)
        page.mouse.down()
        page.mouse.move(end, foot, steps=5)
        page.evaluate(_CLOCK, ["#marked", ""])
        page.mouse.up()
        tell_the_clock(story, "box over the volume to answer")
        counts.append(_n_marked(page))
    whole, *halves = counts
    assert sum(halves) == whole, f"a box over the volume marks {whole} rows, its halves {halves}"
    story.shoot("marked-in-volume")
    page.focus("#marks-by-box input")
    page.keyboard.press("Tab")
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowDown")
    page.evaluate(_CLOCK, ["#marked", ""])
    page.keyboard.press("Enter")
    page.wait_for_function("window.answeredMs", timeout=PATIENCE_MS)
    assert 0 < _n_marked(page) < whole, "a box by keys marks no part of the volume"
    story.shoot("marked-in-volume-by-keys")
    page.click("label:has-text('mark by a box')")


def _n_marked(page: Any) -> int:
    return int(page.inner_text("#marked").partition(" ")[0].replace(",", ""))


def look_and_see_what_rests(page: Any) -> None:
    """Begin a search; what would begin other work is off meanwhile."""
    page.click("text=Look for what is missing")
    page.wait_for_selector("#stop button")
    page.wait_for_selector("button.rests:enabled", state="detached")


def tell_the_clock(story: Story, name: str) -> None:
    """Wait for the answer that the page's clock waits for, and print how long it took."""
    story.page.wait_for_function("window.answeredMs", timeout=PATIENCE_MS)
    took_ms = story.page.evaluate("window.answeredMs - window.releasedMs")
    print(f"{story.width_px:5d}  {name:<28} {1e-3 * took_ms:7.2f} s")


def fill_a_tall_window(story: Story) -> None:
    """Insist that pictures reach the lower part of a tall window, and that the lower part can be seen."""
    page, height_px = story.page, story.page.viewport_size["height"]
    page.set_viewport_size({"width": story.width_px, "height": TALL_PX})
    story.shoot("tall")
    ends = page.evaluate("""() => ["#fall", "main", "#program"].map(
        (name) => document.querySelector(name).getBoundingClientRect().bottom)""")
    assert ends[1] - ends[0] < _MOST_EMPTY_PX, f"the middle ends {ends[1] - ends[0]:.0f} px above its end"
    assert ends[2] < TALL_PX, "where a program is corrected is out of sight"
    page.set_viewport_size({"width": story.width_px, "height": height_px})


def without_mouse(story: Story) -> None:
    """Mark rows and turn the volume by keys alone."""
    page = story.page
    # The empty fields show the ends of what the residual is drawn over.
    low, high = (float(page.get_attribute(f"#mark-{end}", "placeholder").replace("−", "-")) for end in ("from", "to"))
    page.focus("#mark-from")
    # The lower half: of a direction, which has but two values, too.
    page.keyboard.type(f"{1.1 * low - 0.1 * high:.4g}")
    page.keyboard.press("Tab")
    page.keyboard.type(f"{0.5 * low + 0.5 * high:.4g}")
    page.keyboard.press("Enter")
    page.wait_for_selector("#marked >> text=rows marked", timeout=PATIENCE_MS)
    page.focus("button:has-text('above')")
    page.keyboard.press("Enter")
    story.shoot("by-keys")
    page.focus("button:has-text('a corner')")
    page.keyboard.press("Enter")


def tell(story: Story, url: str, program: Path) -> None:
    """Walk through the page."""
    page = story.page
    story.do("load", lambda: page.goto(url), until="#residual .scatterlayer, #residual .gl-canvas")
    story.shoot("load")
    story.do("fit the 21 errors", lambda: page.click("text=Fit the 21 errors"), until="text=2. 21 errors fitted")
    story.shoot("fitted")
    fill_a_tall_window(story)
    brush(story)
    story.shoot("marked")
    page.click("text=Unmark")
    without_mouse(story)
    page.click("text=Unmark")
    brush_the_volume(story)
    page.click("text=Unmark")
    page.click("label:has-text('regions')")
    page.wait_for_selector("#volume-caption >> text=Mean residual of each region")
    story.shoot("regions")
    page.click("label:has-text('vs ★')")
    page.wait_for_selector("#volume-caption >> text=beyond")
    story.shoot("difference")
    page.click("label:has-text('direction')")
    page.wait_for_selector("#volume-caption >> text=where it points")
    story.shoot("direction")
    page.click("label:has-text('arrows')")
    story.do("look for what is missing", lambda: look_and_see_what_rests(page), until=".verdict")
    story.ready()
    assert page.locator("button.rests:enabled").count(), "buttons that rested while work was under way rest still"
    story.shoot("missing")
    page.hover("#missing .card >> nth=0")
    story.shoot("pointed")
    page.mouse.move(5, 5)
    over = page.inner_text("#variable")
    number = 3
    while page.locator("#missing .card button.main:enabled").count() and number < 6:
        add = page.locator("#missing .card button.main:enabled").first
        # Whoever adds something has pointed at it before, and has seen what it would explain.
        add.hover()
        page.wait_for_timeout(_SEEN_MS)
        # With what was added ahead nothing is under way: the list of models tells when it is there.
        page.evaluate(_CLOCK, ["#given", f"{number}. +"])
        story.do("add", lambda add=add: add.click(), until=f".history button:has-text('{number}. +')")
        tell_the_clock(story, "add to answer")
        story.shoot(f"added-{number - 2}")
        story.do("look again", lambda: page.click("text=Look for what is missing"), until=".verdict")
        number += 1
    story.shoot("nothing-left")
    if page.inner_text("#variable") != over:
        assert page.input_value("#mark-from") == "", "limits that were typed for another variable stay"
    page.fill("#own-formula", "c*(q - 200)^2")
    story.do("try a formula", lambda: page.click("#own-try"), until="#own-result .card")
    story.shoot("own-formula")
    with page.expect_file_chooser() as chooser:
        page.click("text=Choose a program")
    story.do("correct a program", lambda: chooser.value.set_files(program), until="text=Download")
    page.locator("#program-result").scroll_into_view_if_needed()
    story.shoot("program")
    with page.expect_download() as download:
        page.click("text=Download")
    download.value.save_as(story.out / f"{story.width_px}-{download.value.suggested_filename}")
    write = "#reports li:has-text('What is missing, and how sure') >> text=Write"
    story.do("write a report", lambda: page.click(write), until="#reports >> text=Open: What is missing")
    with page.context.expect_page() as opened:
        page.click("text=Open: What is missing, and how sure")
    opened.value.wait_for_load_state()
    opened.value.wait_for_timeout(1500)
    opened.value.screenshot(path=story.out / f"{story.width_px}-report.png")
    opened.value.close()
    before = page.locator(".history tr").count()
    story.do("reload", lambda: page.reload(), until="#residual .scatterlayer, #residual .gl-canvas")
    assert page.locator(".history tr").count() == before, "the history was lost by a reload"
    story.shoot("reloaded", is_whole=True)


def walk(
    files: Sequence[Path],
    out: Path,
    browser_path: str | None,
    tell_it: Callable[[Story, str], None],
    flags: Sequence[str] = FLAGS,
) -> int:
    """Tell a story at each size, with a server of its own that was given the files; 1 where anything went wrong."""
    from playwright.sync_api import sync_playwright

    out.mkdir(parents=True, exist_ok=True)
    problems: list[str] = []
    with sync_playwright() as playwright:
        for width_px, height_px in SIZES:
            command = [sys.executable, "-u", "-m", "geoerr", "workbench", *map(str, files), "--no-open", "--quiet"]
            server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            try:
                assert server.stdout is not None
                url = server.stdout.readline().strip()
                browser = playwright.chromium.launch(executable_path=browser_path, args=list(flags))
                page = browser.new_page(viewport={"width": width_px, "height": height_px})
                story = Story(page, out, width_px)
                tell_it(story, url)
                problems += [f"asked another host: {one}" for one in story.outside] + story.errors
                browser.close()
            finally:
                server.terminate()
                server.wait()
    for problem in problems:
        print(f"problem: {problem}", file=sys.stderr)
    return 1 if problems else 0


def arguments(description: str | None, *files: str) -> argparse.Namespace:
    """Read a walk's command line: its files by name, the folder `out` for pictures, and the browser."""
    parser = argparse.ArgumentParser(description=description)
    for name in (*files, "out"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--browser", help="Chromium to use; Playwright's own where none is named.")
    return parser.parse_args()


def main() -> int:
    """Run the story."""
    given = arguments(__doc__, "machine", "observations", "program")
    files = [given.machine, given.observations]
    return walk(files, given.out, given.browser, lambda story, url: tell(story, url, given.program))


if __name__ == "__main__":
    sys.exit(main())
