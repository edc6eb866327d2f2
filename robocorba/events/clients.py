"""Interfaces of the clients behind proxies; the CORBA layer implements them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from robocorba.events.event import EventBatch
from robocorba.events.queue import QueueItem


class ClientPort(Protocol):
    """The client that is connected to a proxy."""

    #: Stringified object reference, by which a restarted channel finds the client again.
    reference: str
    #: HOST:PORT of the client, for display.
    address: str

    def disconnect(self) -> None:
        """Notify the client that it is disconnected. Raises nothing: the client may be dead."""


class ConsumerPort(ClientPort, Protocol):
    """A consumer that the channel calls."""

    takes_batches: bool
    #: Whether it ignores a call that it has had before.
    is_idempotent: bool

    def deliver(self, items: Sequence[QueueItem], limit_s: float) -> None:
        """Deliver one event; to a consumer that takes batches also one conjunction, or any number of batches.

        Raises NotDelivered, Unconfirmed, Refused, ClientGone."""

    def answers(self, limit_s: float) -> bool:
        """Whether the consumer answers a call without effect. Raises ClientGone."""


class SupplierPort(ClientPort, Protocol):
    """A supplier that the channel polls."""

    def try_pull(self, limit_s: float) -> EventBatch | None:
        """The supplier's next event, as a batch of one. Raises NotDelivered, Unconfirmed, Refused, ClientGone;
        InvalidEvent for an event that the channel does not take."""
