"""100,000 observations on the workbench: how long a brush and an Add take, by the page's own clock.

    PYTHONPATH=. python validation/workbench/large.py OUT [--browser /usr/bin/chromium]

A machine of the study of hidden effects with a play and a growth that lags behind a temperature, written as a user
has it. Prints seconds, at both sizes, from the click until the page says "ready" again. Needs Playwright and a
Chromium.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from story import PATIENCE_MS, Story, arguments, brush, walk
from validation.hidden_effects.generate import Hidden, generate

from geoerr.machine import write_machine
from geoerr.observations import write_observations

N_ROWS = 100_000
SEED = 7_060_708
HIDDEN = ("backlash", "thermal-expansion-lagged")
# As many sensors as a machine that is looked at in a shop has.
SENSORS = ("temp_bed", "temp_frame", "temp_motor")
STRENGTH_UM = 8.0

# Notes the click, and when the page last said "ready" after it had said something else.
_CLOCK = """() => {
  window.clickedMs = window.readyMs = 0;
  let wasBusy = false;
  const status = document.querySelector("#status");
  document.addEventListener("click", () => { window.clickedMs = performance.now(); }, { once: true, capture: true });
  new MutationObserver(() => {
    const isReady = status.innerText.trim() === "ready";
    if (isReady && wasBusy) window.readyMs = performance.now();
    wasBusy = wasBusy || !isReady;
  }).observe(status, { childList: true, subtree: true, characterData: true });
}"""


def tell(story: Story, url: str) -> None:
    """Walk through the page."""
    page = story.page
    story.do("load", lambda: page.goto(url), until="#residual .scatterlayer, #residual .gl-canvas")
    story.do("fit the 21 errors", lambda: page.click("text=Fit the 21 errors"), until="text=2. 21 errors fitted")
    for number in (3, 4):
        # A picture takes a box once it is drawn.
        story.shoot(f"before-{number - 2}")
        brush(story)
        page.click("text=Unmark")
        story.do("look", lambda: page.click("text=Look for what is missing"), until=".verdict")
        add(story, number)
        story.shoot(f"added-{number - 2}")


def add(story: Story, number: int) -> None:
    """Add what comes first; tell the seconds from the click to "ready", and until it is drawn."""
    page = story.page
    button: Any = page.locator("#missing .card button.main:enabled").first
    name = page.locator("#missing .card").first.inner_text().splitlines()[0]
    page.evaluate(_CLOCK)
    button.click()
    page.wait_for_selector(f".history button:has-text('{number}. +')", timeout=PATIENCE_MS)
    page.wait_for_function("window.readyMs", timeout=PATIENCE_MS)
    took_ms = page.evaluate("window.readyMs - window.clickedMs")
    print(f"{story.width_px:5d}  add: {name:<28} {1e-3 * took_ms:7.2f} s", flush=True)


def main() -> int:
    """Write the data, and walk."""
    given = arguments(__doc__)
    case = generate(SEED, None, "mixed", "gauss-10", tuple(map(Hidden, HIDDEN)), STRENGTH_UM, N_ROWS)
    given.out.mkdir(parents=True, exist_ok=True)
    files: list[Path] = [given.out / "machine.toml", given.out / "observations.csv"]
    write_machine(files[0], case.machine)
    frame = case.observations.frame
    others = [name for name in frame.columns if name.startswith("temp") and name not in SENSORS]
    write_observations(files[1], replace(case.observations, frame=frame.drop(others)))
    return walk(files, given.out, given.browser, tell)


if __name__ == "__main__":
    sys.exit(main())
