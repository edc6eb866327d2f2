"""An event channel as its operators call it: its state, and its links to others."""

from __future__ import annotations

from typing import Any

from omniORB import CORBA

from robocorba.errors.events import OutdatedChannel
from robocorba.events.corba import events
from robocorba.events.traffic import ChannelTraffic
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS

#: Timeout to resolve a channel, and to ask for its state [s].
TIMEOUT_S = 3.0


class RemoteChannel:
    """The channel `name`. call_timeout_s: of each call [s], that of the ORB by default. Raises NotReachable, also in
    calls."""

    def __init__(self, orb: Orb, name: str, call_timeout_s: float | None = None) -> None:
        self._name = name
        self._channel = orb.resolve(f"{CHANNELS}/{name}", RoboCorba.EventChannel, TIMEOUT_S, call_timeout_s)

    def state(self) -> Any:
        """Its RoboCorba::ChannelState."""
        with translated(f"channel {self._name}"):
            return self._channel.state()

    def traffic(self) -> ChannelTraffic:
        """Raises OutdatedChannel for one of release 0.1.0."""
        with translated(f"channel {self._name}"):
            try:
                return events.traffic_of(self._channel.traffic())
            except CORBA.BAD_OPERATION:
                raise OutdatedChannel(self._name) from None

    def add_peer(self, peer: str, address: str, is_foreign: bool) -> None:
        """Link it with another one in both directions. address: empty to look it up by its name. is_foreign: it
        supports CosEventChannelAdmin only. Raises EventError."""
        with translated(f"channel {self._name}"):
            self._channel.addPeer(RoboCorba.PeerAddress(peer, address, is_foreign))

    def remove_peer(self, peer: str) -> None:
        """Remove a link at both ends. Raises EventError."""
        with translated(f"channel {self._name}"):
            self._channel.removePeer(peer)
