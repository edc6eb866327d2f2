"""Where suppliers reach a channel: those that push, and those that are asked."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from robocorba.errors.events import ClientGone, Disconnected, NotDelivered, ProxyGone, Refused, Unconfirmed
from robocorba.events.account import Account, Totals
from robocorba.events.clients import Client, Supplier
from robocorba.events.event import Run
from robocorba.events.outlet import Condition

#: A supplier that had nothing is asked again after this, then ever later up to the second.
FIRST_POLL_S, LONGEST_POLL_S = 0.001, 0.01
CALL_LIMIT_S = 2.0
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 1.0
MAX_FAILURES = 20


class Inlet:
    """For a supplier that pushes. `publish` takes a run and the account to enter it into.

    State is guarded by the channel's lock; `push` is called without it."""

    def __init__(self, lock: threading.Lock, id: str, publish: Callable[[Run, Account], None], name: str = "") -> None:
        self.id, self.name = id, name
        self.condition = Condition.WAITING
        self.is_ended = False
        self.client: Client | None = None
        self.account = Account()
        self.used_at = time.monotonic()
        self._lock = lock
        self._publish = publish

    @property
    def failures(self) -> int:
        return 0

    def connect(self, client: Client | None) -> None:
        """Let events in; a nil client is never called back."""
        self.client, self.condition = client, Condition.CONNECTED

    def push(self, run: Run) -> None:
        """Publish. Raises Disconnected, ProxyGone."""
        if self.condition is not Condition.CONNECTED or self.is_ended:
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
    """For a supplier that is asked for events; also while nobody consumes them.

    on_given_up is told, without the lock, that the supplier is gone or has failed too often, and why."""

    def __init__(
        self,
        lock: threading.Lock,
        id: str,
        publish: Callable[[Run, Account], None],
        on_given_up: Callable[[PolledInlet, str], None],
    ) -> None:
        super().__init__(lock, id, publish)
        self._on_given_up = on_given_up
        self._ended = threading.Event()
        self._failed = 0

    @property
    def failures(self) -> int:
        return self._failed

    def connect(self, client: Client | None) -> None:
        super().connect(client)
        threading.Thread(target=self._run, args=(client,), name=f"from {self.id}", daemon=True).start()

    def end(self) -> None:
        super().end()
        self._ended.set()

    def _run(self, client: Supplier) -> None:
        pause = FIRST_POLL_S
        gone = ""
        while not gone and not self._ended.wait(pause):
            try:
                run = client.try_pull(CALL_LIMIT_S)
                self._failed, self.condition = 0, Condition.CONNECTED
                if run is None:
                    pause = min(2 * pause, LONGEST_POLL_S)
                else:
                    pause = 0.0
                    self.push(run)
            except ClientGone as error:
                gone = str(error)
            except (Disconnected, ProxyGone):
                return
            except (NotDelivered, Unconfirmed, Refused) as error:
                self._failed += 1
                self.condition = Condition.STALLED
                pause = min(FIRST_PAUSE_S * 2.0 ** min(self._failed - 1, 10), LONGEST_PAUSE_S)
                if self._failed >= MAX_FAILURES:
                    gone = f"{self._failed} failures in a row ({error})"
        if gone:
            self._on_given_up(self, gone)
