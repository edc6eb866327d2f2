"""The servant that a foreign channel pushes to."""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable
from typing import Any

import CosEventComm__POA

from robocorba.corba.conversion import events
from robocorba.corba.conversion.contents import content_of
from robocorba.errors.events import InvalidEvent
from robocorba.events.event import EventBatch

_log = logging.getLogger(__name__)


class ForeignConsumerServant(CosEventComm__POA.PushConsumer):
    """CosEventComm::PushConsumer. receive: called with each event and its content, None for an event with an origin."""

    def __init__(self, receive: Callable[[EventBatch, Hashable], None], uri: Callable[[Any], str]) -> None:
        self._receive, self._uri = receive, uri

    def push(self, value: Any) -> None:
        try:
            run = events.run_from_foreign_channel(value)
        except InvalidEvent as error:
            _log.warning("a foreign channel pushed an invalid event (%s)", error)
            return
        self._receive(run, None if run.header.origin else content_of(value, self._uri))

    def disconnect_push_consumer(self) -> None:
        _log.info("a foreign channel has disconnected its consumer")
