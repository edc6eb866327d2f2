"""Receives what two of many sources publish at the same time, while sources and the channel come and go."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Sequence

from omniORB import CORBA

from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.events.corba.event_client import Event, EventClient, EventSubscription
from robocorba.orb.orb import Orb
from robocorba.system.repeating import Repeating

#: Interval of looking for new sources, and whether the channel still has the subscription [s].
CHECK_INTERVAL_S = 2.0
#: Maximum number of sources, of which 1225 pairs can be made.
MAX_SOURCES = 50

_log = logging.getLogger(__name__)


class PairListener:
    """Calls `receive` with an event of `type` from each of two sources, made at most `window_s` [s] apart, at the event
    channel `channel`. sources: finds their names; the first MAX_SOURCES count. May raise NotReachable."""

    def __init__(
        self,
        orb: Orb,
        channel: str,
        type: str,
        sources: Callable[[], Sequence[str]],
        window_s: float,
        receive: Callable[[Sequence[Event]], None],
    ) -> None:
        self._orb, self._channel, self._type, self._window_s = orb, channel, type, window_s
        self._find_sources, self._receive = sources, receive
        self._stack = contextlib.ExitStack()
        self._subscriptions: list[EventSubscription] = []
        self._sources: Sequence[str] = ()
        self._problem = ""
        self._repeating = Repeating(f"pairs of {type}", self._renew, CHECK_INTERVAL_S)

    def start(self) -> PairListener:
        self._repeating.start()
        return self

    def close(self) -> None:
        self._repeating.close()
        self._stack.close()

    def _renew(self) -> None:
        try:
            sources = self._find_sources()
            if sources[:MAX_SOURCES] == self._sources and not any(each.is_lost() for each in self._subscriptions):
                return
            if len(sources) > MAX_SOURCES:
                _log.warning("%s: of %d sources the first %d are correlated", self._type, len(sources), MAX_SOURCES)
            self._stack.close()
            self._sources, self._subscriptions = (), []
            client = self._stack.enter_context(EventClient(self._orb, self._channel, timeout_s=1.0))
            wanted = sources[:MAX_SOURCES]
            self._subscriptions = client.subscribe_pairs(self._receive, self._type, wanted, self._window_s)
            self._sources, self._problem = wanted, ""
        except (NotReachable, EventError, CORBA.Exception) as error:
            if str(error) != self._problem:
                self._problem = str(error)
                _log.info("can't subscribe to %s at %s, it keeps trying: %s", self._type, self._channel, error)
