"""Servants of the two ends of links."""

from __future__ import annotations

import logging
from typing import Any

from robocorba.corba.conversion import events
from robocorba.corba.conversion.errors import translating
from robocorba.errors.events import InvalidEvent, SessionOver
from robocorba.events.links import Links
from robocorba.stubs import RoboCorba__POA

_log = logging.getLogger(__name__)


class EventGatewayServant(RoboCorba__POA.EventGateway):
    """RoboCorba::EventGateway: what feeds of peers forward to."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def forward(self, session: str, position: int, runs: Any) -> None:
        received = []
        for struct in runs:
            try:
                received.append(events.forwarded_run_of(struct))
            except InvalidEvent as wrong:  # oneway: nobody could be told
                _log.warning("a peer forwarded events that can't be used (%s)", wrong)
        self._links.forward(session, position, received)


class GatewayFeedServant(RoboCorba__POA.GatewayFeed):
    """RoboCorba::GatewayFeed: what gateways of peers call."""

    def __init__(self, links: Links) -> None:
        self._links = links

    def acknowledge(self, session: str, position: int) -> None:
        try:
            self._links.acknowledge(session, position)
        except SessionOver:  # oneway: nobody could be told; the next renewal tells
            return

    @translating
    def renew(self, session: str, position: int, news: Any) -> list[Any]:
        return events.notices(self._links.renew(session, position, events.notices_of(news)))

    @translating
    def leave(self, session: str) -> None:
        self._links.leave(session)
