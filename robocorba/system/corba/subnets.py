"""The sub-networks of a system: their names, and the removal of links between their channels."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Sequence

from omniORB import CORBA

from robocorba.errors.events import InvalidPeer
from robocorba.errors.services import NotReachable
from robocorba.events.federation import MAX_CHANNELS, check_name
from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS
from robocorba.system.settings import InvalidSetting
from robocorba.system.state_folder import StateFolder

_log = logging.getLogger(__name__)


def parse_subnets(text: str, setting: str = "--subnets") -> tuple[str, ...]:
    """The names in a comma-separated list such as lab,hall. Raises InvalidSetting."""
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        try:
            check_name(name)
        except InvalidPeer as error:
            raise InvalidSetting(setting, text, f"the name {error.reason}") from None
        if names.count(name) > 1:
            raise InvalidSetting(setting, text, f"{name} is listed twice")
    if len(names) > MAX_CHANNELS:
        raise InvalidSetting(setting, text, f"{len(names)} channels; a federation has at most {MAX_CHANNELS}")
    return names


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
