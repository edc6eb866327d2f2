"""Errors of event channels and their federation."""

from __future__ import annotations

from collections.abc import Sequence

from robocorba.errors.base import FieldError, NamedError, RoboCorbaError, StructuredError


class EventError(RoboCorbaError):
    """An event channel refused a call, or could not reach one of its clients."""


class InvalidEvent(FieldError, EventError):
    """`field` of the event's header, or the payload, is invalid."""


class EventTooLarge(InvalidEvent):
    """The payload has `size` bytes, and at most `limit` are allowed."""

    def __init__(self, size: int, limit: int) -> None:
        super().__init__("payload", f"has {size} bytes; at most {limit} are allowed")


class InvalidSubscription(StructuredError, EventError):
    """The subscription is invalid at the path `where`, such as [1].patterns[0].type."""

    where: str
    reason: str

    def __str__(self) -> str:
        return f"{self.where}: {self.reason}" if self.where else self.reason


class InvalidQueue(FieldError, EventError):
    """`field` of the queue policy is out of range."""


class TooManyProxies(StructuredError, EventError):
    """The channel already has `limit` proxies, the maximum."""

    limit: int
    message = "the channel has {limit} proxies, the maximum; disconnect one first"


class AlreadyConnected(EventError):
    """The proxy already has a client."""


class OwnProxy(EventError):
    """The client of a proxy is a proxy of the same channel: its events would circulate for ever."""


class Disconnected(EventError):
    """The proxy has no client."""


class ProxyGone(EventError):
    """The proxy was disconnected, or its channel was destroyed."""


class UnknownSubscription(NamedError, EventError):
    """No durable subscription has this name."""

    message = "there is no durable subscription {name!q}"


class UnknownPeer(StructuredError, EventError):
    """The channel is not linked with `peer`; `known` lists its peers."""

    peer: str
    known: Sequence[str]
    message = "{peer!q} is not a peer; peers are {known!l}"


class InvalidPeer(FieldError, EventError):
    """`field` of a peer's address is invalid."""


class OutdatedChannel(NamedError, EventError):
    """The channel runs a release that can't answer."""

    message = "channel {name} runs release 0.1.0, which measures no traffic; it needs a later one"


class TooFewEvents(StructuredError, EventError):
    """`count` events were delivered during a measurement of `seconds`, fewer than `needed`."""

    count: int
    seconds: float
    needed: int
    message = (
        "too few events to judge: {count} were delivered in {seconds:.3g} s, {needed} are needed; measure while robots "
        "work, or longer"
    )


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
