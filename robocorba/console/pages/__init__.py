"""The console's pages."""

from robocorba.console.pages import monitor, simulator3d


def add_pages() -> None:
    """Register all pages with NiceGUI."""
    monitor.add_page()
    simulator3d.add_page()
