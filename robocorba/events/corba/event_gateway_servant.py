"""Servants of the two ends of a link between channels: the feed that sends, and the gateway that receives."""

from __future__ import annotations

import contextlib
import logging
import time
from typing import Any

from robocorba.errors.events import InvalidEvent, SessionOver
from robocorba.events.corba import events
from robocorba.events.links import Links
from robocorba.orb.exceptions import translating
from robocorba.stubs import RoboCorba, RoboCorba__POA

_log = logging.getLogger(__name__)


class PeerGatewayServant(RoboCorba__POA.PeerGateway):
    """RoboCorba::PeerGateway: receives events from the feeds of peers."""

    #: Headers are checked once for many events.
    checks_texts_itself = frozenset({"forwardOn"})

    def __init__(self, links: Links) -> None:
        self._links = links

    def forward(self, session: str, position: int, runs: Any) -> None:
        """Nothing: no feed of release 0.1.0 has a session with this gateway."""

    def forwardOn(self, session: str, position: int, epochs: Any, ways: Any, runs: Any) -> None:
        received, invalid = [], 0
        if not len(epochs) == len(ways) == len(runs):
            _log.warning("a peer forwarded %d epochs and %d ways for %d runs", len(epochs), len(ways), len(runs))
            invalid, runs, epochs, ways = sum(len(struct.payloads) for struct in runs), [], [], []
        for struct, epoch, way in zip(runs, epochs, ways, strict=True):
            try:
                received.append(events.forwarded_batch_of(struct, epoch, way))
            except InvalidEvent as error:  # oneway: the next renewal reports their number
                _log.warning("a peer forwarded invalid events (%s)", error)
                invalid += len(struct.payloads)
        self._links.forward(session, position, received, invalid)


class PeerFeedServant(RoboCorba__POA.PeerFeed):
    """RoboCorba::PeerFeed: called by the gateways of peers."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def acknowledge(self, session: str, position: int) -> None:
        try:
            self._links.acknowledge(session, position)
        except SessionOver:  # oneway: the next renewal raises it
            return

    def renew(self, session: str, position: int, news: Any) -> list[Any]:
        raise RoboCorba.SessionOver  # no gateway of release 0.1.0 has a session with this feed

    @translating
    def renewPeer(self, session: str, position: int, refused: int, news: Any) -> tuple[list[Any], float]:
        known = self._links.renew(session, position, refused, events.advertisements_of(news))
        return events.advertisements(known), time.monotonic()

    @translating
    def leave(self, session: str) -> None:
        with contextlib.suppress(SessionOver):  # the link has ended already
            self._links.leave(session)
