"""The monitor: the paper's 2D simulator with its monitor panel."""

from __future__ import annotations

from nicegui import ui

from robocorba.console.pages.frame import STATIC, page_frame

TITLE = "Monitor"


class Monitor(ui.element, component=STATIC / "monitor.js"):
    """The whole page; it takes its data from the page's live connection."""


def add_page() -> None:
    """Register the page with NiceGUI."""

    @ui.page("/")
    def monitor() -> None:
        with page_frame(TITLE):
            Monitor()
