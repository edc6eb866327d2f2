"""The console's pages."""

from robocorba.console.pages import map, missions, monitor, program, simulator3d


def add_pages() -> None:
    """Register all pages with NiceGUI."""
    for page in (monitor, simulator3d, program, map, missions):
        page.add_page()
