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


def add_pages() -> None:
    """Register all pages with NiceGUI."""
    header = _component("page_header.js")
    for page in PAGES:
        _add(page, header)
    panel = _component("panel.js")  # a tablet shows it, so it leads nowhere else

    @ui.page("/panel/{robot:path}")
    def build(robot: str) -> None:
        _add_head(robot, "panel.css")
        panel()._props["robot"] = robot


def _component(script: str, modules: dict[str, str] | None = None) -> type[ui.element]:
    """What NiceGUI makes of a component in static/."""

    class Component(ui.element, component=STATIC / script, esm=modules):
        pass

    return Component


def _add(page: Page, header: type[ui.element]) -> None:
    content = _component(page.script, page.modules)

    @ui.page(page.address)
    def build() -> None:
        _add_head(page.title, *page.styles)
        with ui.element("div").classes("console-page"):
            links = [{"address": each.address, "title": each.title, "icon": each.icon} for each in PAGES]
            header()._props.update(pages=links, current=page.title)
            with ui.element("div").classes("console-content"):
                content()


def _add_head(title: str, *styles: str) -> None:
    sheets = "".join(f'<link rel="stylesheet" href="/static/{name}">' for name in (*styles, "console.css"))
    ui.add_head_html(_GROUND + sheets)
    ui.page_title(f"{title} - RoboCorba")
