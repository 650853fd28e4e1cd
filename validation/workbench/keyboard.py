"""Everything on the workbench is reached with Tab, in the order of the page, and what has the focus can be seen.

    python validation/workbench/keyboard.py machine.toml observations.csv OUT [--browser /usr/bin/chromium]

Walks with Tab through the page with a model and a diagnosis on it. Fails where something that can be clicked is never
reached, where the focus shows by nothing, or lies out of sight. Needs Playwright and a Chromium.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from typing import Any

from story import Story, arguments, walk

_MOST_TABS, _MOMENT_MS = 300, 250
# What can be clicked or typed into; of radio buttons Tab reaches one, arrows the others.
_REACHABLE = """() => {
  const seen = (one) => one.checkVisibility({ visibilityProperty: true }) && one.getClientRects().length > 0;
  const all = document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0'], [role='slider']");
  const groups = new Set();
  return [...all].filter((one) => {
    // A list's own search field stands for nothing while the list is closed.
    if (one.classList.contains("dash-dropdown-focus-target")) return false;
    if (one.disabled || !seen(one) || one.tabIndex < 0) return false;
    if (one.type !== "radio") return true;
    const group = one.closest("[role='radiogroup'], fieldset, [id]");
    const isFirst = !groups.has(group);
    groups.add(group);
    return isFirst;
  }).map((one) => { one.dataset.walk = one.dataset.walk || "unseen"; return true; }).length;
}"""
# What has the focus, and whether what had it before looks otherwise now, itself or what stands around it.
_FOCUSED = """() => {
  const look = (one) => {
    const parts = [];
    for (let at = one, up = 0; at && up < 3; up += 1, at = at.parentElement) {
      const style = getComputedStyle(at);
      const outline = style.outlineStyle === "none" ? "" : style.outline;
      parts.push(outline, style.boxShadow, style.borderColor, style.backgroundColor);
    }
    return parts.join("|");
  };
  const before = window.walked;
  const lastIsShown = before ? look(before.one) !== before.look || !before.one.isConnected : null;
  const one = document.activeElement;
  if (!one || one === document.body) return { name: null, lastIsShown };
  if (one.dataset.walk) one.dataset.walk = "reached";
  window.walked = { one, look: look(one) };
  const box = one.getBoundingClientRect();
  const text = (one.innerText || one.getAttribute("aria-label") || one.id || one.className || one.tagName).trim();
  return {
    name: `${one.tagName.toLowerCase()} ${one.type || ""} “${text.slice(0, 50)}”`,
    lastIsShown,
    isInSight: box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth && box.width > 0,
  };
}"""
_UNSEEN = """() => [...document.querySelectorAll("[data-walk='unseen']")].map((one) =>
  `${one.tagName.toLowerCase()} ${one.type || ""} “${(one.innerText || one.id || one.className).slice(0, 50)}”`)"""


def tell(story: Story, url: str) -> None:
    """Bring the page to where all of it is there, and walk through it."""
    page = story.page
    story.do("load", lambda: page.goto(url), until="#residual .scatterlayer, #residual .gl-canvas")
    story.do("fit the 21 errors", lambda: page.click("text=Fit the 21 errors"), until="text=2. 21 errors fitted")
    story.do("look for what is missing", lambda: page.click("text=Look for what is missing"), until=".verdict")
    story.shoot("keyboard")
    page.evaluate("document.activeElement.blur()")
    page.mouse.click(1, 1)
    n_reachable = page.evaluate(_REACHABLE)
    walked = _walked(page)
    unreached = page.evaluate(_UNSEEN)
    dark = sorted({one["name"] for one, after in pairwise(walked) if after["lastIsShown"] is False})
    walked = [one for one in walked if one["name"] is not None]
    hidden = sorted({one["name"] for one in walked if not one["isInSight"]})
    print(f"{story.width_px:5d}  {n_reachable} things to reach, {len(walked)} steps of Tab")
    for what, names in (("not reached", unreached), ("focus not shown", dark), ("focus out of sight", hidden)):
        story.errors += [f"{what}: {name}" for name in names]


def _walked(page: Any) -> list[Any]:
    """Press Tab until the walk leaves the page, and give what had the focus."""
    walked = []
    for _ in range(_MOST_TABS):
        page.keyboard.press("Tab")
        # A change of colour takes a moment.
        page.wait_for_timeout(_MOMENT_MS)
        walked.append(page.evaluate(_FOCUSED))
        if walked[-1]["name"] is None:
            break
    return walked


def main() -> int:
    """Run it."""
    given = arguments(__doc__, "machine", "observations")
    return walk([given.machine, given.observations], given.out, given.browser, tell)


if __name__ == "__main__":
    sys.exit(main())
