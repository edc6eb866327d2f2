"""The missions page: all missions of the building, wherever they were started."""

from __future__ import annotations

from nicegui import ui

from robocorba.console.pages.frame import STATIC, page_frame

TITLE = "Missions"


class MissionsPage(ui.element, component=STATIC / "missions.js"):
    """The whole page; it takes its data from the page's live connection."""


def add_page() -> None:
    """Register the page with NiceGUI."""

    @ui.page("/missions")
    def missions() -> None:
        ui.add_head_html(
            '<link rel="stylesheet" href="/static/map.css"><link rel="stylesheet" href="/static/missions.css">'
        )
        with page_frame(TITLE):
            MissionsPage()
