"""Servants of the two ends of a link between channels: the feed that sends, and the gateway that receives."""

from __future__ import annotations

import contextlib
import logging
from typing import Any

from robocorba.corba.conversion import events
from robocorba.corba.conversion.errors import translating
from robocorba.errors.events import InvalidEvent, SessionOver
from robocorba.events.links import Links
from robocorba.stubs import RoboCorba__POA

_log = logging.getLogger(__name__)


class EventGatewayServant(RoboCorba__POA.EventGateway):
    """RoboCorba::EventGateway: receives events from the feeds of peers."""

    #: Headers are checked once for many events.
    checks_texts_itself = frozenset({"forward"})

    def __init__(self, links: Links) -> None:
        self._links = links

    def forward(self, session: str, position: int, runs: Any) -> None:
        received = []
        for struct in runs:
            try:
                received.append(events.forwarded_batch_of(struct))
            except InvalidEvent as error:  # oneway: cannot be reported to the peer
                _log.warning("a peer forwarded invalid events (%s)", error)
        self._links.forward(session, position, received)


class GatewayFeedServant(RoboCorba__POA.GatewayFeed):
    """RoboCorba::GatewayFeed: called by the gateways of peers."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def acknowledge(self, session: str, position: int) -> None:
        try:
            self._links.acknowledge(session, position)
        except SessionOver:  # oneway: the next renewal raises it
            return

    @translating
    def renew(self, session: str, position: int, news: Any) -> list[Any]:
        return events.advertisements(self._links.renew(session, position, events.advertisements_of(news)))

    @translating
    def leave(self, session: str) -> None:
        with contextlib.suppress(SessionOver):  # the link has ended already
            self._links.leave(session)
