"""The 3D simulator: the floors and the robots with their links, as in the robots' data pools."""

from __future__ import annotations

from pathlib import Path

import nicegui
from nicegui import ui

from robocorba.console.pages.frame import STATIC, page_frame

TITLE = "3D"
#: three.js as NiceGUI brings it.
_THREE = Path(nicegui.__file__).parent / "elements" / "scene" / "dist"


class Simulator3D(ui.element, component=STATIC / "simulator3d.js", esm={"nicegui-scene": str(_THREE)}):
    """The whole page; it takes its data from the page's live connection."""


def add_page() -> None:
    """Register the page with NiceGUI."""

    @ui.page("/3d")
    def simulator3d() -> None:
        with page_frame(TITLE):
            Simulator3D()
