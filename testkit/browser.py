"""A headless Chromium, moved by Playwright, for tests, benches and pictures of the console."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser

#: Software drawing, also of WebGL; Chromium does not run its sandbox as root.
FLAGS = ("--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: Chromium's names in the distributions.
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def chromium() -> str | None:
    """The program of an installed browser, or None."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@contextlib.contextmanager
def headless(program: str) -> Iterator[Browser]:
    """The browser `program`, without windows, inside the `with`."""
    from playwright.sync_api import sync_playwright  # imported here: a machine without a browser does not need it

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()
