"""The console's pages."""

from robocorba.console.pages import monitor


def add_pages() -> None:
    """Register all pages with NiceGUI."""
    monitor.add_page()
