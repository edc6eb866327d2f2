"""The sub-networks of a system: their names, and the removal of links between their channels."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Sequence
from pathlib import Path

from omniORB import CORBA

from robocorba.errors.events import InvalidPeer
from robocorba.errors.maps import MapFileError
from robocorba.errors.services import NotReachable
from robocorba.events.federation import MAX_CHANNELS, check_name
from robocorba.map_editor.model import Area
from robocorba.map_editor.store import stored_areas
from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS
from robocorba.system.settings import InvalidSetting
from robocorba.system.state_folder import StateFolder

_log = logging.getLogger(__name__)


def parse_subnets(text: str) -> tuple[str, ...]:
    """The names in a comma-separated list such as lab,hall. Raises InvalidSetting."""
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        try:
            check_name(name)
        except InvalidPeer as error:
            raise InvalidSetting("--subnets", text, f"the name {error.reason}") from None
        if names.count(name) > 1:
            raise InvalidSetting("--subnets", text, f"{name} is listed twice")
    if len(names) > MAX_CHANNELS:
        raise InvalidSetting("--subnets", text, f"{len(names)} channels; a federation has at most {MAX_CHANNELS}")
    return names


def default_subnets(folder: StateFolder, building: Path | None) -> tuple[str, ...]:
    """Those of a map file, without one of the stored map, that can be names of channels; `main` if there are none."""
    found = [name for name in subnets_of_map(folder, building) if _is_name(name)]
    return tuple(found[:MAX_CHANNELS]) or ("main",)


def subnets_of_map(folder: StateFolder, building: Path | None) -> tuple[str, ...]:
    """The sub-networks that areas of a map file, without one of the stored map, name; none if it can't be read: then
    the map editor says why."""
    store = folder.path / "map.sqlite"
    areas: list[Area] = []
    with contextlib.suppress(MapFileError, OSError):
        if building is None:
            areas = stored_areas(store) if store.exists() else []
        elif b"subnet" in building.read_bytes():  # else there is no need to read a large map twice
            from robocorba.map_editor import native  # takes 0.2 s to load

            floors = native.load(building).floors.values()
            areas = [area for floor in floors for area in floor.geometrical.areas.values()]
    return tuple(dict.fromkeys(area.subnet for area in areas if area.subnet))


def _is_name(subnet: str) -> bool:
    with contextlib.suppress(InvalidPeer):
        check_name(subnet)
        return True
    return False


def remove_former_links(folder: StateFolder, subnets: Sequence[str], orb: Orb) -> None:
    """Remove the links that an earlier system in this folder made and this one does not make.

    Other links stay. Channels store their peers permanently, so the links made are stored here too, including those of
    channels that do not run now."""
    links = folder.links()
    for name in subnets:
        peers = sorted(set(subnets) - {name})
        former = sorted(set(links.get(name, [])) - set(peers))
        try:
            if former:
                _unlink(orb, name, former)
            links[name] = peers
        except (NotReachable, CORBA.Exception) as error:  # the next start retries
            reason = str(error) if isinstance(error, NotReachable) else describe(error)
            _log.warning(
                "channel %s keeps its links with %s until the next start (%s)", name, ", ".join(former), reason
            )
    folder.write_links(links)


def _unlink(orb: Orb, name: str, former: Sequence[str]) -> None:
    channel = orb.resolve(f"{CHANNELS}/{name}", RoboCorba.EventChannel, 2.0, call_timeout_s=2.0)
    for peer in former:
        with contextlib.suppress(RoboCorba.UnknownPeer):
            channel.removePeer(peer)
            _log.info("removed the link of channel %s with %s", name, peer)
