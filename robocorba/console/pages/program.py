"""The paper's graphic programming agent: programs of icons, checked and run on a robot."""

from __future__ import annotations

from nicegui import ui

from robocorba.console.pages.frame import STATIC, page_frame

TITLE = "Program"


class ProgramPage(ui.element, component=STATIC / "program.js"):
    """The whole page; it takes its data from the page's live connection."""


def add_page() -> None:
    """Register the page with NiceGUI."""

    @ui.page("/program")
    def program() -> None:
        ui.add_head_html('<link rel="stylesheet" href="/static/program.css">')
        with page_frame(TITLE):
            ProgramPage()
