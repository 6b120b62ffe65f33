# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the pictures of docs/review.md: ``python -m benchmark.tutorial``.

It needs a Chromium, as the tests of the page do. It takes the shipped drive through the commands of
the page, and photographs what a person sees.
"""

import tempfile
from pathlib import Path

from linkage_vibration.cli.main import main as command
from linkage_vibration.support.resources import config_file
from test.support.browser import Browser

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"


def main() -> None:
    """Make the page, and draw it as a whole, at its beginning, on a phone, and at a moment."""
    with tempfile.TemporaryDirectory() as name:
        log, page = Path(name) / "log.mcap", Path(name) / "page.html"
        command(["replay", str(config_file("drives/hitch_duty_cycle.mcap")), "-o", str(log)])
        command(["review", str(log), "-o", str(page)])
        with Browser(1280, 900) as browser:
            browser.open(page)
            browser.settle()
            browser.screenshot(PICTURES / "tutorial_answer.png")
            browser.screenshot(PICTURES / "review.png", whole=True)
            browser.evaluate("document.querySelector('#table-sources tbody tr').click()")
            browser.evaluate("document.querySelector('#toolbar').scrollIntoView()")
            browser.settle()
            browser.screenshot(PICTURES / "tutorial_moment.png")
            browser.resize(390, 800, mobile=True)
            browser.open(page)
            browser.settle()
            browser.screenshot(PICTURES / "tutorial_phone.png")
            assert not browser.problems, browser.problems


if __name__ == "__main__":
    main()
