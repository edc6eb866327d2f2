"""The console's pages: one table of them, and what all have: links to each other, the state of the connection, and the
emergency stop at a fixed place. The touch panel of a robot stands for itself."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import nicegui
from nicegui import ui

STATIC = Path(__file__).parent / "static"
#: three.js as NiceGUI brings it.
_THREE = {"nicegui-scene": str(Path(nicegui.__file__).parent / "elements" / "scene" / "dist")}


class Page(NamedTuple):
    """A page at an address. script: its component, in static/; it takes its data from the page's live connection.
    styles: style sheets in static/. modules: what the script imports that is not in static/, by name."""

    address: str
    title: str
    icon: str
    script: str
    styles: tuple[str, ...] = ()
    modules: dict[str, str] | None = None


PAGES = (
    Page("/", "Monitor", "sensors", "monitor.js"),
    Page("/3d", "3D", "view_in_ar", "simulator3d.js", modules=_THREE),
    Page("/program", "Program", "extension", "program.js", ("program.css",)),
    Page("/map", "Map", "map", "map.js", ("map.css",)),
    Page("/missions", "Missions", "groups", "missions.js", ("map.css", "missions.css")),
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
        self._props["pages"] = [{"address": page.address, "title": page.title, "icon": page.icon} for page in PAGES]
        self._props["current"] = current


def add_pages() -> None:
    """Register all pages with NiceGUI."""
    for page in PAGES:
        _add(page)

    class Panel(ui.element, component=STATIC / "panel.js"):
        """The touch panel of the robot in its property. A tablet shows it, so it leads nowhere else."""

    @ui.page("/panel/{robot:path}")
    def build(robot: str) -> None:
        _add_head(robot, "panel.css")
        Panel()._props["robot"] = robot


def _add(page: Page) -> None:
    class Content(ui.element, component=STATIC / page.script, esm=page.modules):
        """The whole page below its header."""

    @ui.page(page.address)
    def build() -> None:
        _add_head(page.title, *page.styles)
        with ui.element("div").classes("console-page"):
            PageHeader(page.title)
            with ui.element("div").classes("console-content"):
                Content()


def _add_head(title: str, *styles: str) -> None:
    sheets = "".join(f'<link rel="stylesheet" href="/static/{name}">' for name in (*styles, "console.css"))
    ui.add_head_html(_GROUND + sheets)
    ui.page_title(f"{title} - RoboCorba")
