"""A user's hands and eyes on the pages of the console, in a real headless browser."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from re import Pattern

from playwright.sync_api import ConsoleMessage, Dialog, Locator, Page, expect

from robocorba.testing.browser import headless

#: Timeout of every wait, for busy machines [s].
LIMIT_S = 90.0


class Operator:
    """A user who only clicks, types and looks. `troubles` holds what went wrong in the browser: exceptions, console
    errors, dialogs."""

    def __init__(self, page: Page, address: str) -> None:
        self.page, self.address = page, address
        self.troubles: list[str] = []
        page.on("pageerror", lambda error: self.troubles.append(f"exception: {error}"))
        page.on("console", self._note)
        page.on("dialog", self._dismiss)

    def _note(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self.troubles.append(f"console: {message.text} {message.location.get('url', '')}")

    def _dismiss(self, dialog: Dialog) -> None:
        self.troubles.append(f"dialog: {dialog.message}")
        dialog.dismiss()

    # ---- anywhere ----

    def open(self, title: str) -> None:
        """Open a page by the navigation; the first one by the address."""
        if self.page.url == "about:blank":
            self.page.goto(self.address)
        self.page.get_by_label("Pages").get_by_role("link", name=title).click()
        expect(self.page.get_by_label("Pages").locator("[aria-current=page]")).to_contain_text(title)
        expect(self.page.locator(".console-status")).to_contain_text("robots")

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def button(self, name: str | Pattern[str], within: Locator | None = None) -> Locator:
        where = within or self.page.locator("body")
        return where.get_by_role("button", name=name, exact=isinstance(name, str))

    def tab(self, name: str | Pattern[str]) -> None:
        """Choose a tab."""
        chosen = self.page.get_by_role("tab", name=name)
        chosen.click()
        expect(chosen).to_have_attribute("aria-selected", "true")

    @contextlib.contextmanager
    def telling(self) -> Iterator[None]:
        """Print what is on the page if the test fails within the `with`."""
        try:
            yield
        except BaseException:
            print(self.page.url, self.troubles, self.page.locator("body").aria_snapshot(), sep="\n")
            raise

    # ---- maps ----

    def pixel(self, canvas: Locator, x: float, y: float) -> tuple[float, float]:
        """Where a point of the floor [m] is on a canvas [px]."""
        expect(canvas).to_have_attribute("data-scale", re.compile(r"\d"))
        self.page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
        box = canvas.bounding_box()
        assert box is not None
        scale = float(canvas.get_attribute("data-scale") or "")
        centre_x, centre_y = map(float, (canvas.get_attribute("data-centre") or "").split())
        return box["width"] / 2 + (x - centre_x) * scale, box["height"] / 2 - (y - centre_y) * scale

    def click_map(self, canvas: Locator, *points: tuple[float, float]) -> None:
        """Click points of the shown floor [m]."""
        for x, y in points:
            px, py = self.pixel(canvas, x, y)
            canvas.click(position={"x": px, "y": py})


@contextlib.contextmanager
def operator(program: str, address: str) -> Iterator[Operator]:
    """A browser with one page."""
    with headless(program) as browser:
        page = browser.new_page(viewport={"width": 1366, "height": 768}, locale="en-GB")
        page.set_default_timeout(1000 * LIMIT_S)
        expect.set_options(timeout=1000 * LIMIT_S)
        yield Operator(page, address)
