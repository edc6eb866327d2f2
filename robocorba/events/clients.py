"""The clients behind proxies, as a translator presents them to the parts of a channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from robocorba.events.event import Run
from robocorba.events.queue import Item


class Client(Protocol):
    """Whoever is connected to a proxy."""

    #: What finds it again after a restart of the channel.
    reference: str
    #: Where it listens, for people.
    address: str

    def disconnect(self) -> None:
        """Tell it that it is disconnected. Raises nothing: it may be dead."""


class Consumer(Client, Protocol):
    """A consumer that is called."""

    takes_batches: bool

    def deliver(self, items: Sequence[Item], limit_s: float) -> None:
        """Hand over one event; or one conjunction, or any number of runs, where it takes batches.

        Raises NotDelivered, Unconfirmed, Refused, ClientGone."""

    def answers(self, limit_s: float) -> bool:
        """Whether it answers a call that does nothing. Raises ClientGone."""


class Supplier(Client, Protocol):
    """A supplier that is asked."""

    def try_pull(self, limit_s: float) -> Run | None:
        """Its next event, as a run of one. Raises NotDelivered, Unconfirmed, Refused, ClientGone."""


class Clients(Protocol):
    """Finds the clients of a restarted channel by their references."""

    def find(self, kind: str, reference: str) -> Client:
        """The client of a proxy of this kind (a value of proxies.Kind)."""
