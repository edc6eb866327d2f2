"""Cooperative icons of other packages, by entry points."""

from __future__ import annotations

import logging
from collections.abc import Collection
from importlib.metadata import entry_points
from typing import TypeVar

from msgspec import Struct

IconT = TypeVar("IconT", bound=Struct)

_log = logging.getLogger(__name__)


def installed(base: type[IconT], taken: Collection[str]) -> tuple[type[IconT], ...]:
    """The installed subclasses of `base`, sorted by the names of their entry points. What can't be loaded, or has a tag
    that is taken, is left out with a warning."""
    found: dict[str, type[IconT]] = {}
    for entry in sorted(entry_points(group="robocorba.cooperative_icons"), key=lambda entry: entry.name):
        try:
            icon = entry.load()
            if not (isinstance(icon, type) and issubclass(icon, base)):
                raise TypeError(f"{entry.value} is no {base.__name__}")
            tag = str(icon.__struct_config__.tag)
            if tag in taken or tag in found:
                raise ValueError(f"there is an icon {tag} already")
            found[tag] = icon
        except Exception as error:  # whatever the other package does
            _log.warning("the cooperative icon %s is left out: %s: %s", entry.name, type(error).__name__, error)
    return tuple(found.values())
