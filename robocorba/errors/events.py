"""Errors of event channels and their federation."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, RoboCorbaError


class EventError(RoboCorbaError):
    """An event channel refused a call, or could not reach one of its clients."""


class InvalidEvent(FieldError, EventError):
    """`field` of the event's header, or the payload, is invalid."""


class EventTooLarge(InvalidEvent):
    """The payload has `size` bytes, and at most `limit` are allowed."""

    def __init__(self, size: int, limit: int) -> None:
        super().__init__("payload", f"has {size} bytes; at most {limit} are allowed")


class InvalidSubscription(EventError):
    """The subscription is invalid at the path `where`, such as [1].patterns[0].type."""

    def __init__(self, where: str, reason: str) -> None:
        self.where, self.reason = where, reason
        super().__init__(f"{where}: {reason}" if where else reason)


class InvalidQueue(FieldError, EventError):
    """`field` of the queue policy is out of range."""


class TooManyProxies(EventError):
    """The channel already has `limit` proxies, the maximum."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        super().__init__(f"the channel has {limit} proxies, the maximum; disconnect one first")


class AlreadyConnected(EventError):
    """The proxy already has a client."""


class OwnProxy(EventError):
    """The client of a proxy is a proxy of the same channel: its events would circulate for ever."""


class Disconnected(EventError):
    """The proxy has no client."""


class ProxyGone(EventError):
    """The proxy was disconnected, or its channel was destroyed."""


class UnknownSubscription(EventError):
    """No durable subscription has this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"there is no durable subscription {name[:80]!r}")


class UnknownPeer(EventError):
    """The channel is not linked with `peer`; `known` lists its peers."""

    def __init__(self, peer: str, known: Sequence[str]) -> None:
        self.peer, self.known = peer, tuple(known)
        super().__init__(f"{peer[:80]!r} is not a peer; peers are {', '.join(self.known) or 'none'}")


class InvalidPeer(FieldError, EventError):
    """`field` of a peer's address is invalid."""


class SessionOver(EventError):
    """The session was ended by a later join of the same gateway, or by a restart of the feed."""


class NotDelivered(EventError):
    """The client certainly did not receive the events."""


class Unconfirmed(EventError):
    """The events were sent, but no answer arrived; the client may have received them or not."""


class Refused(EventError):
    """The client answered with an exception, or the event cannot be sent to it: a retry would fail too."""


class InternalFault(EventError):
    """A call failed by a defect of this program, which the log shows; the events of the call are discarded."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(f"internal fault ({type(cause).__name__}: {str(cause)[:200]}), see the log")


class ClientGone(EventError):
    """The client answered that it is disconnected or does not exist."""
