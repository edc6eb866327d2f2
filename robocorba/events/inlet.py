"""Inlets: the side of a proxy that receives events of a supplier, which pushes or is polled."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.events import ClientGone, Disconnected, NotDelivered, ProxyGone, Refused, Unconfirmed
from robocorba.events.account import Account, Totals
from robocorba.events.clients import ClientPort, SupplierPort
from robocorba.events.event import EventRun
from robocorba.events.outlet import ProxyCondition

#: Polling interval while a supplier has no events: first, longest [s]. It doubles from poll to poll.
FIRST_POLL_S, MAX_POLL_S = 0.001, 0.01
#: Timeout of a call to a supplier [s].
CALL_LIMIT_S = 2.0
#: Backoff after a failed call: first, longest [s].
FIRST_PAUSE_S, MAX_PAUSE_S = 0.05, 1.0
#: A supplier is disconnected after this many failed calls in a row.
MAX_FAILURES = 20


class Inlet:
    """For a supplier that pushes. publish: called with each run and the account that counts it.

    State is guarded by the channel's lock; `push` is called without the lock."""

    def __init__(
        self, lock: threading.Lock, id: str, publish: Callable[[EventRun, Account], None], name: str = ""
    ) -> None:
        self.id, self.name = id, name
        self.condition = ProxyCondition.WAITING
        self.is_ended = False
        self.client: ClientPort | None = None
        self.account = Account()
        self.used_at = time.monotonic()
        self._lock = lock
        self._publish = publish

    @property
    def failures(self) -> int:
        return 0

    def connect(self, client: ClientPort | None) -> None:
        """Accept events from now on. A client of None is not notified of its disconnection."""
        self.client, self.condition = client, ProxyCondition.CONNECTED

    def push(self, run: EventRun) -> None:
        """Publish a run. Raises Disconnected, ProxyGone."""
        if self.condition is not ProxyCondition.CONNECTED or self.is_ended:
            if self.is_ended:
                raise ProxyGone(f"proxy {self.id} was disconnected")
            raise Disconnected(f"proxy {self.id} is not connected")
        self._publish(run, self.account)
        self.used_at = time.monotonic()

    def end(self) -> None:
        self.is_ended = True

    def totals(self) -> Totals:
        return self.account.totals(0)


class PolledInlet(Inlet):
    """Polls a supplier for events, also while there are no consumers.

    on_client_lost: called, without the lock, with the reason when the supplier is gone or failed MAX_FAILURES times."""

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        publish: Callable[[EventRun, Account], None],
        on_client_lost: Callable[[PolledInlet, str], None],
    ) -> None:
        super().__init__(lock, id, publish)
        self._on_client_lost = on_client_lost
        self._ended = threading.Event()
        self._failed = 0

    @property
    def failures(self) -> int:
        return self._failed

    def connect(self, client: ClientPort | None) -> None:
        super().connect(client)
        threading.Thread(target=self._run, args=(client,), name=f"from {self.id}", daemon=True).start()

    def end(self) -> None:
        super().end()
        self._ended.set()

    def _run(self, client: SupplierPort) -> None:
        pause = FIRST_POLL_S
        gone = ""
        while not gone and not self._ended.wait(pause):
            try:
                run = client.try_pull(CALL_LIMIT_S)
                self._failed, self.condition = 0, ProxyCondition.CONNECTED
                if run is None:
                    pause = min(2 * pause, MAX_POLL_S)
                else:
                    pause = 0.0
                    self.push(run)
            except ClientGone as error:
                gone = str(error)
            except (Disconnected, ProxyGone):
                return
            except (NotDelivered, Unconfirmed, Refused) as error:
                self._failed += 1
                self.condition = ProxyCondition.STALLED
                pause = min(FIRST_PAUSE_S * 2.0 ** min(self._failed - 1, 10), MAX_PAUSE_S)
                if self._failed >= MAX_FAILURES:
                    gone = f"{self._failed} failures in a row ({error})"
        if gone:
            self._on_client_lost(self, gone)
