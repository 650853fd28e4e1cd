"""The workbench and its report in a browser that draws no 3-D pictures: each says so, and the rest works.

    python validation/workbench/without_webgl.py machine.toml observations.csv OUT [--browser /usr/bin/chromium]

Writes screenshots to OUT. Fails where the page reports an error, shows Plotly's own message, or where marks, causes
and regions do not work. Needs Playwright and a Chromium.
"""

from __future__ import annotations

import sys

from story import PATIENCE_MS, Story, arguments, brush, walk

FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-3d-apis")


def tell(story: Story, url: str) -> None:
    """Walk through what a browser without WebGL can do."""
    page = story.page
    story.do("load", lambda: page.goto(url), until="#residual .scatterlayer")
    assert not page.evaluate("Boolean(document.createElement('canvas').getContext('webgl'))"), "there is WebGL"
    page.wait_for_selector("#volume >> text=no WebGL")
    story.do("fit the 21 errors", lambda: page.click("text=Fit the 21 errors"), until="text=2. 21 errors fitted")
    brush(story)
    story.shoot("without-webgl-marked")
    story.do("look for what is missing", lambda: page.click("text=Look for what is missing"), until=".verdict")
    page.hover("#missing .card >> nth=0")
    page.wait_for_selector("#residual .legend >> text=explained", timeout=PATIENCE_MS)
    page.click("label:has-text('regions')")
    page.wait_for_selector("#regions table")
    story.shoot("without-webgl-regions")
    assert page.locator(".no-webgl").count() == 0, "Plotly's own message is shown"
    write = "#reports li:has-text('How far and where') >> text=Write"
    story.do("write a report", lambda: page.click(write), until="#reports >> text=Open: How far and where")
    with page.context.expect_page() as opened:
        page.click("text=Open: How far and where")
    report = opened.value
    report.wait_for_load_state()
    report.locator(".unseen").first.scroll_into_view_if_needed()
    assert report.locator(".unseen >> text=no WebGL").count() == report.locator(".unseen").count() > 0
    assert report.locator(".plot .scatterlayer").count() > 0, "the report's other figures are not drawn"
    assert report.locator(".no-webgl").count() == 0, "Plotly's own message is shown in the report"
    report.screenshot(path=story.out / f"{story.width_px}-without-webgl-report.png")


def main() -> int:
    """Run it."""
    given = arguments(__doc__, "machine", "observations")
    return walk([given.machine, given.observations], given.out, given.browser, tell, FLAGS)


if __name__ == "__main__":
    sys.exit(main())
