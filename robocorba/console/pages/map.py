"""The map page: walls, objects, roads and elevators of the building, edited in the browser."""

from __future__ import annotations

from nicegui import ui

from robocorba.console.pages.frame import STATIC, page_frame

TITLE = "Map"


class MapPage(ui.element, component=STATIC / "map.js"):
    """The whole page; it takes its data from the page's live connection."""


def add_page() -> None:
    """Register the page with NiceGUI."""

    @ui.page("/map")
    def map() -> None:
        ui.add_head_html('<link rel="stylesheet" href="/static/map.css">')
        with page_frame(TITLE):
            MapPage()
