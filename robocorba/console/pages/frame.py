"""What all pages have: links to each other, the state of the connection, and the emergency stop at a fixed place."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from nicegui import ui

STATIC = Path(__file__).parent.parent / "static"
#: Address, title and icon of each page.
PAGES = (
    ("/", "Monitor", "sensors"),
    ("/3d", "3D", "view_in_ar"),
    ("/program", "Program", "extension"),
    ("/map", "Map", "map"),
    ("/missions", "Missions", "groups"),
)


#: Colours the page before anything else is loaded; page_header.js does the rest.
_GROUND = """<script>{
  const wanted = localStorage.getItem("robocorba-dark");
  const isDark = wanted ? wanted === "yes" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.style.background = isDark ? "#14181c" : "#ffffff";
}</script>"""


class PageHeader(ui.element, component=STATIC / "page_header.js"):
    """Links to the pages, the state of the connection, dark and light, and the emergency stop."""

    def __init__(self, current: str) -> None:
        super().__init__()
        self._props["pages"] = [{"address": address, "title": title, "icon": icon} for address, title, icon in PAGES]
        self._props["current"] = current


@contextlib.contextmanager
def page_frame(current: str) -> Iterator[None]:
    """A page's content, below the header. current: its title."""
    ui.add_head_html(f'{_GROUND}<link rel="stylesheet" href="/static/console.css">')
    ui.page_title(f"{current} - RoboCorba")
    with ui.element("div").classes("console-page"):
        PageHeader(current)
        with ui.element("main").classes("console-content"):
            yield
