"""Errors of event channels and their federation."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, RoboCorbaError


class EventError(RoboCorbaError):
    """The event channel refuses something, or could not reach a client of it."""


class InvalidEvent(FieldError, EventError):
    """`field` of the event's header, or its payload, is out of range."""


class InvalidSubscription(EventError):
    """`where` is a path into the subscription, such as [1].patterns[0].type."""

    def __init__(self, where: str, reason: str) -> None:
        self.where, self.reason = where, reason
        super().__init__(f"{where}: {reason}" if where else reason)


class InvalidQueue(FieldError, EventError):
    """`field` of the queue's policy is out of range."""


class TooManyProxies(EventError):
    """The channel has `limit` proxies already."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"the channel has {limit} proxies already")


class AlreadyConnected(EventError):
    """The proxy is connected already."""


class Disconnected(EventError):
    """The proxy is not connected."""


class ProxyGone(EventError):
    """The proxy was disconnected, or its channel was destroyed."""


class UnknownSubscription(EventError):
    """No durable subscription has this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no durable subscription {name[:80]!r}")


class UnknownPeer(EventError):
    """The channel is not linked with `peer`; `known` lists those that it is linked with."""

    def __init__(self, peer: str, known: Sequence[str]) -> None:
        self.peer, self.known = peer, tuple(known)
        super().__init__(f"{peer[:80]!r} is not a peer; peers are {', '.join(self.known) or 'none'}")


class InvalidPeer(FieldError, EventError):
    """`field` of a peer's address can't be used."""


class SessionOver(EventError):
    """Another join of the same gateway came later, or the feed was restarted."""


class NotDelivered(EventError):
    """It is certain that the client did not get the events."""


class Unconfirmed(EventError):
    """The events were sent, the answer did not come; the client may have them or not."""


class Refused(EventError):
    """The client answered with an exception, or the event can't be sent to it: another attempt would end likewise."""


class ClientGone(EventError):
    """The client says that it is disconnected, or that it does not exist."""
