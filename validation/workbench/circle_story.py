"""Circular tests on the workbench, in a browser without a screen: drop, see, learn what, add, look again.

    python validation/workbench/circle_story.py machine.toml circle.csv OUT [--browser /usr/bin/chromium]

As story.py: screenshots of every stage at both sizes in OUT, the seconds of each step, and a failure where the page
reports an error or asks another host. The circular test is dropped on the page, not named on the command line.
"""

from __future__ import annotations

import sys
from pathlib import Path

from story import Story, arguments, walk


def tell(story: Story, url: str, circle: Path) -> None:
    """Walk through the page."""
    page = story.page
    story.do("load", lambda: page.goto(url), until="#files")
    with page.expect_file_chooser() as chooser:
        page.click("text=Add files")
    story.do("take the circles", lambda: chooser.value.set_files(circle), until="#volume .polar")
    story.shoot("circle")
    story.do("look for what is missing", lambda: page.click("text=Look for what is missing"), until=".verdict")
    story.shoot("missing")
    page.hover("#missing .card >> nth=0")
    story.shoot("pointed")
    page.mouse.move(5, 5)
    page.locator("#missing summary >> nth=-1").scroll_into_view_if_needed()
    story.shoot("causes")
    number = 2
    while page.locator("#missing .card button.main:enabled").count() and number < 5:
        add = page.locator("#missing .card button.main:enabled").first
        story.do("add", lambda add=add: add.click(), until=f".history button:has-text('{number}. +')")
        story.do("look again", lambda: page.click("text=Look for what is missing"), until=".verdict")
        story.shoot(f"added-{number - 1}")
        number += 1


def main() -> int:
    """Walk at each size, with a server of its own."""
    given = arguments(__doc__, "machine", "circle")
    return walk([given.machine], given.out, given.browser, lambda story, url: tell(story, url, given.circle))


if __name__ == "__main__":
    sys.exit(main())
