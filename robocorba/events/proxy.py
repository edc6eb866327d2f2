"""What all proxies have in common. A proxy is what a channel keeps for one client, a supplier or a consumer."""

from __future__ import annotations

import threading
import time
from enum import Enum
from typing import Any

from robocorba.events.account import Account


class ProxyKind(Enum):
    """Named as by OMG, by the role of the channel: a proxy push supplier serves a push consumer."""

    PUSH_CONSUMER = "push consumer"
    PULL_CONSUMER = "pull consumer"
    PUSH_SUPPLIER = "push supplier"
    PULL_SUPPLIER = "pull supplier"


class ProxyCondition(Enum):
    """WAITING: without a client. STALLED: the client does not answer. SUSPENDED: the client pauses delivery."""

    WAITING = 0
    CONNECTED = 1
    STALLED = 2
    SUSPENDED = 3


class Proxy:
    """Base of all proxies. name: of a supplier, or of a durable subscription.

    The channel's lock guards all state of proxies. Methods are called with the lock held, except where noted."""

    kind: ProxyKind
    #: The port of the connected client (clients.ClientPort), None if there is none, or if it gave a nil reference.
    client: Any = None
    condition = ProxyCondition.WAITING
    is_ended = False
    #: Number of failed calls to the client in a row.
    failures = 0

    def __init__(self, lock: threading.Lock, id: str, name: str) -> None:
        self.id, self.name = id, name
        self.account = Account()
        #: Time of the last call of its client [s].
        self.used_at = time.monotonic()
        self._lock = lock

    def connect(self, client: Any) -> None:
        """Begin to serve a client."""
        self.client, self.condition = client, ProxyCondition.CONNECTED

    def end(self) -> None:
        """End the proxy; it is of no use afterwards."""
        self.is_ended = True

    def totals(self) -> Account:
        """Snapshot of its account."""
        return self.account.snapshot()
