"""What happens to those who do nothing wrong while others attack: complaints, and a client in a process of its own."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from robocorba.system.settings import Address
from testkit.json_process import Process, checkout_command
from testkit.report import Mark, at_most

#: What calls of a server that nobody attacks are called.
UNTOUCHED = "a server that nobody attacks"
#: Longest call of a client that does nothing wrong [s].
MAX_CALL_S = 0.5
#: Lines that are printed of each kind of complaint. `print_rest` gives the number of all.
MAX_LINES = 20
#: Time limit for the start of the client, and for its answers [s].
ANSWER_LIMIT_S = 60.0


class Complaints:
    """Counts what happens to those who do nothing wrong, and prints it with the time since the first `begin`. Texts
    that differ in numbers only are of the same kind; the same text is printed once. count: of all complaints."""

    def __init__(self) -> None:
        self.count = 0
        self._lock = threading.Lock()
        self._began: float | None = None
        #: What runs now.
        self.beside = ""
        self._printed: dict[str, set[str]] = {}
        self._kinds: Counter[str] = Counter()

    def begin(self) -> None:
        """Attacks begin now; times are since the first ones."""
        self._began = self._began or time.monotonic()

    def add(self, what: str) -> None:
        """Count a harm."""
        with self._lock:
            self.count += 1
        self.note(what)

    def note(self, what: str) -> None:
        """The same for something that is counted elsewhere."""
        kind = re.sub(r"[0-9]+", "#", what)
        with self._lock:
            self._kinds[kind] += 1
            printed = self._printed.setdefault(kind, set())
            if what in printed or len(printed) == MAX_LINES:
                return
            printed.add(what)
        when = "before the attacks" if self._began is None else f"{time.monotonic() - self._began:.1f} s"
        print(f"{when}: {what}{f', beside {self.beside}' if self.beside else ''}", flush=True)

    def print_rest(self) -> None:
        """Print the number of each kind of which not all were printed."""
        for kind, count in self._kinds.most_common():
            if count > len(printed := self._printed[kind]):
                print(f"{min(printed)} ({count} times of this kind)")


class Beside:
    """A process that calls every server while others attack. longest: its longest call of each object [s]."""

    def __init__(self, process: Process, complain: Complaints) -> None:
        self._process, self.complain = process, complain
        self.longest: dict[str, float] = {}

    def begin(self) -> None:
        """Forget the calls until now: the attacks begin."""
        self._process.ask({"do": "longest"}, ANSWER_LIMIT_S)
        self.complain.begin()

    def look(self) -> dict[str, float]:
        """The longest call of each object since the last look [s]. Failed calls are complained of, slow ones noted."""
        calls, errors = self._process.ask({"do": "longest"}, ANSWER_LIMIT_S)
        for name, error in errors.items():
            self.complain.add(f"another client's call of {name}: {error}")
        for name, took_s in calls.items():
            self.longest[name] = max(took_s, self.longest.get(name, 0.0))
            if took_s > MAX_CALL_S and name != UNTOUCHED:
                self.complain.note(f"another client's call of {name} took {took_s:.2f} s")
        found: dict[str, float] = calls
        return found

    def marks(self) -> list[Mark]:
        """The required values of `longest`. What the machine itself needs is allowed to everybody."""
        most_s = max(MAX_CALL_S, self.longest[UNTOUCHED])
        return [
            at_most(f"longest call of {name} by another client, s", took_s, most_s)
            for name, took_s in self.longest.items()
            if name != UNTOUCHED
        ]


@contextlib.contextmanager
def beside(folder: Path, naming: Address, about: tuple[str, ...], complain: Complaints) -> Iterator[Beside]:
    """about: the further arguments of bench.chaos.bystander."""
    with Process(checkout_command("bench.chaos.untouched"), folder / "untouched.log") as untouched:
        about = (*about, untouched.receive(ANSWER_LIMIT_S))
        with Process(
            checkout_command("bench.chaos.bystander", str(naming), *about), folder / "bystander.log"
        ) as process:
            process.receive(ANSWER_LIMIT_S)
            yield Beside(process, complain)
