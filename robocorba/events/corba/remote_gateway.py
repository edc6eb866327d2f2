"""Clients of the peers of a channel: their gateways and their feeds."""

from __future__ import annotations

import functools
import logging
import time
from typing import Any

from omniORB import CORBA

from robocorba.errors.events import InvalidPeer, NotDelivered, SessionOver
from robocorba.errors.services import NotReachable
from robocorba.events.channel_store import Peer
from robocorba.events.corba import events
from robocorba.events.event import EventBatch
from robocorba.events.federation import Advertisement
from robocorba.events.feed import Forward
from robocorba.events.peer_clock import Exchange
from robocorba.orb.calls import describe, set_call_timeout
from robocorba.orb.ior import address_of
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS
from robocorba.system.settings import Address, InvalidSetting

#: Timeout of a call to a peer [s].
CALL_TIMEOUT_S = 2.0

_log = logging.getLogger(__name__)


def forwarding_to(orb: Orb, gateway: Any) -> Forward:
    """Sends packets to the gateway of a peer."""
    uri = orb.uri(gateway)
    return functools.partial(_forward, orb.reference(uri, RoboCorba.PeerGateway), address_of(uri))


def _forward(
    gateway: Any, address: str, session: str, position: int, batches: list[EventBatch], limit_s: float
) -> list[EventBatch]:
    set_call_timeout(gateway, limit_s)
    epochs = [batch.epoch for batch in batches]
    try:
        try:
            gateway.forwardOn(session, position, epochs, events.event_ways(batches), events.event_runs(batches))
        except (CORBA.MARSHAL, CORBA.BAD_PARAM, CORBA.DATA_CONVERSION) as error:  # caused by the events themselves
            _log.warning("a packet cannot be sent (%s)", describe(error))
            gateway.forwardOn(session, position, [], [], [])
            return batches
    except CORBA.SystemException as error:
        raise NotDelivered(f"{address} can't be called ({describe(error)})") from None
    return []


class RemoteFeed:
    """A session with the feed of a peer."""

    def __init__(self, orb: Orb, terms: Any, joining: Exchange) -> None:
        self.session, self.position, self.joining = terms.session, terms.position, joining
        uri = orb.uri(terms.feed)
        # Two references with a timeout each, because both are called at the same time.
        self._remote = orb.reference(uri, RoboCorba.PeerFeed, CALL_TIMEOUT_S)
        self._acknowledging = orb.reference(uri, RoboCorba.PeerFeed, 0.2)

    def renew(self, position: int, refused: int, news: list[Advertisement]) -> tuple[list[Advertisement], Exchange]:
        sent = time.monotonic()
        try:
            structs = events.advertisements(news)
            known, clock = self._remote.renewPeer(self.session, position, refused, structs)
            return events.advertisements_of(known), Exchange(sent, clock, time.monotonic())
        except RoboCorba.SessionOver:
            raise SessionOver("the peer has ended the session") from None
        except CORBA.SystemException as error:
            raise NotReachable(describe(error)) from None

    def acknowledge(self, position: int) -> None:
        try:
            self._acknowledging.acknowledge(self.session, position)
        except CORBA.SystemException as error:  # the next renewal acknowledges too
            _log.debug("acknowledgement lost (%s)", describe(error))

    def leave(self) -> None:
        try:
            self._remote.leave(self.session)
        except CORBA.Exception as error:
            _log.info("could not notify the peer that the link was removed (%s)", describe(error))


class PeerJoiner:
    """Begins sessions with the feeds of peers, on behalf of channel `name`."""

    def __init__(self, orb: Orb, name: str, channel: Any, gateway: Any) -> None:
        self._orb, self._name, self._channel, self._gateway = orb, name, channel, gateway

    def join(self, record: Peer) -> tuple[RemoteFeed, str]:
        """Begin a session at the peer's last reference, else at the address of its record or in the naming service.

        Raises NotReachable, InvalidPeer."""
        if record.reference:
            try:
                return self._join(record, self._orb.reference(record.reference, RoboCorba.EventChannel))
            except (NotReachable, InvalidPeer):
                pass  # the peer may have moved, and another one may be at its reference
        return self._join(record, self._find(record))

    def _find(self, record: Peer) -> Any:
        name = f"{CHANNELS}/{record.name}"
        if not record.address:
            return self._orb.resolve(name, RoboCorba.EventChannel, timeout_s=1.0, call_timeout_s=CALL_TIMEOUT_S)
        try:
            uri = self._orb.uri_at(Address.parse(record.address), name)
        except InvalidSetting:
            uri = record.address
        return self._orb.reference(uri, RoboCorba.EventChannel)

    def _join(self, record: Peer, channel: Any) -> tuple[RemoteFeed, str]:
        set_call_timeout(channel, CALL_TIMEOUT_S)
        try:
            found = channel._get_name()
            if found != record.name:
                raise InvalidPeer("address", f"the channel there is {found!r}, not {record.name!r}")
            sent = time.monotonic()
            try:
                terms, clock = channel.joinPeer(self._name, self._channel, self._gateway)
            except CORBA.BAD_OPERATION:
                reason = f"{record.name} runs release 0.1.0, which takes event numbers for times; it needs a later one"
                raise InvalidPeer("release", reason) from None
            joining = Exchange(sent, clock, time.monotonic())
            return RemoteFeed(self._orb, terms, joining), self._orb.uri(channel)
        except RoboCorba.InvalidPeer as error:
            raise InvalidPeer(error.field, error.reason) from None
        except CORBA.OBJECT_NOT_EXIST:
            raise InvalidPeer("address", f"there is no channel {record.name!r} at this address") from None
        except CORBA.BAD_OPERATION:
            raise InvalidPeer("address", "what is at this address is no event channel") from None
        except CORBA.SystemException as error:
            raise NotReachable(f"{record.name} does not answer ({describe(error)})") from None
