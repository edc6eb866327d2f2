"""Proxy consumers: they receive the events of a supplier, which pushes them or is polled."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from robocorba.errors.events import (
    ClientGone,
    Disconnected,
    InvalidEvent,
    NotDelivered,
    ProxyGone,
    Refused,
    Unconfirmed,
)
from robocorba.events.account import Account
from robocorba.events.clients import SupplierPort
from robocorba.events.event import EventBatch
from robocorba.events.policies import DeliveryPolicy
from robocorba.events.proxy import Proxy, ProxyCondition, ProxyKind
from robocorba.system.background import Background

#: Types of events that order others to do something: such a supplier may not publish them.
ORDERS = frozenset({"robot.stop"})

_log = logging.getLogger(__name__)


def own_supplier(name: str) -> str:
    """The name of the supplier that publishes with the source `name` only. Names are stored, so that this holds after a
    restart too."""
    return f"only:{name}"


class ProxyConsumer(Proxy):
    """For a supplier that pushes. publish: called with each batch and the account that counts it. has_had: whether the
    channel has had the event of an origin and number; a supplier that pushes what its own consumer gets would otherwise
    keep an event going round for ever."""

    kind = ProxyKind.PUSH_CONSUMER

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        publish: Callable[[EventBatch, Account], None],
        has_had: Callable[[str, int], bool],
        name: str = "",
    ) -> None:
        super().__init__(lock, id, name)
        #: The only source of its events, None for any.
        self._source = name.removeprefix("only:") if name.startswith("only:") else None
        self._publish, self._has_had = publish, has_had
        self._is_looping = False

    def push(self, batch: EventBatch) -> None:
        """Publish a batch, unless it comes again; called without the lock. Raises Disconnected, ProxyGone,
        InvalidEvent."""
        if self.condition is not ProxyCondition.CONNECTED or self.is_ended:
            if self.is_ended:
                raise ProxyGone(f"proxy {self.id} was disconnected")
            raise Disconnected(f"proxy {self.id} is not connected")
        if self._source is not None and batch.header.source != self._source:
            raise InvalidEvent("source", f"this supplier may publish as {self._source!r} only")
        if self._source is not None and batch.header.type in ORDERS:
            raise InvalidEvent("type", f"this supplier may not publish {batch.header.type}")
        if batch.header.origin:
            if self._discards_again(batch):
                return
            batch.header = batch.header._replace(origin="")
        self._publish(batch, self.account)
        self.used_at = time.monotonic()

    def _discards_again(self, batch: EventBatch) -> bool:
        """Discard a batch that the channel has had."""
        with self._lock:
            if not self._has_had(batch.header.origin, batch.last):
                return False
            self.account.received += len(batch)
            self.account.discarded += len(batch)
        if not self._is_looping:
            self._is_looping = True
            _log.warning("the supplier of %s publishes events that it has received; they are discarded", self.id)
        return True


class ProxyPullConsumer(ProxyConsumer):
    """Polls a supplier for events, also while there are no consumers.

    on_client_lost: called, without the lock, with the reason when the supplier is gone or failed too often."""

    kind = ProxyKind.PULL_CONSUMER

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        publish: Callable[[EventBatch, Account], None],
        has_had: Callable[[str, int], bool],
        policy: DeliveryPolicy,
        on_client_lost: Callable[[ProxyPullConsumer, str], None],
    ) -> None:
        super().__init__(lock, id, publish, has_had)
        self._on_client_lost = on_client_lost
        self._policy = policy
        self._ended = threading.Event()

    def connect(self, client: SupplierPort) -> None:
        super().connect(client)
        Background(
            f"from {self.id}", lambda: self._run(client), lambda reason: self._on_client_lost(self, reason)
        ).start()

    def end(self) -> None:
        super().end()
        self._ended.set()

    def _run(self, client: SupplierPort) -> None:
        policy = self._policy
        pause, reason, empty_polls = policy.poll_intervals.first_s, "", 1
        while not reason and not self._ended.wait(pause):
            try:
                batch = client.try_pull(policy.poll_timeout_s)
                self.failures, self.condition = 0, ProxyCondition.CONNECTED
                empty_polls = empty_polls + 1 if batch is None else 0
                pause = policy.poll_intervals.pause_s(empty_polls)
                if batch is not None:
                    self.push(batch)
            except InvalidEvent as error:
                self.failures, self.condition = 0, ProxyCondition.CONNECTED
                with self._lock:
                    self.account.received += 1
                    self.account.discarded += 1
                _log.warning("discarded an event of the supplier of %s (%s)", self.id, error)
            except ClientGone as error:
                reason = str(error)
            except (Disconnected, ProxyGone):
                return
            except (NotDelivered, Unconfirmed, Refused) as error:
                self.failures += 1
                self.condition = ProxyCondition.STALLED
                pause = policy.backoff.pause_s(self.failures)
                if self.failures >= policy.max_failures:
                    reason = f"{self.failures} failures in a row ({error})"
        if reason:
            self._on_client_lost(self, reason)
