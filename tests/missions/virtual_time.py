"""Threads on a virtual clock: one of them runs at a time, until it waits; then time jumps to the next moment at which
one goes on. So what many threads do within minutes takes milliseconds, and is the same in each run."""

from __future__ import annotations

import math
import queue
import random
import threading
from collections import deque
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

#: Waits end at multiples of this time [s], which binary fractions have exactly.
TICK_S = 0.25


class Killed(BaseException):
    """Raised in a thread of a process that was killed."""


class Task:
    """A thread. owner: the process that it belongs to."""

    def __init__(self, owner: str, work: Callable[[], object], note_defect: Callable[[BaseException], None]) -> None:
        self.owner, self._work, self._note_defect = owner, work, note_defect
        self.turn, self.pause = threading.Semaphore(0), threading.Semaphore(0)
        self.is_ready: Callable[[], object] = lambda: True
        self.until_s = 0.0
        self.has_ended = self.is_killed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.turn.acquire()
        try:
            if not self.is_killed:
                self._work()
        except Killed:
            pass
        except BaseException as error:
            self._note_defect(error)
        self.has_ended = True
        self.pause.release()

    def resume(self) -> None:
        """Let it run until it waits or ends."""
        self.turn.release()
        self.pause.acquire()


class VirtualTime:
    """now: seconds since the beginning. frozen: owners whose threads stand still, as if by SIGSTOP. seed: of the order
    in which threads go on at the same time."""

    def __init__(self, seed: int = 0) -> None:
        self.now = 0.0
        self.frozen: set[str] = set()
        self.defects: list[BaseException] = []
        #: Whose threads begin next.
        self.owner = ""
        self._tasks: list[Task] = []
        self._chance = random.Random(seed)
        self._current: Task | None = None

    # ---- for the test ----

    def begin(self, owner: str, work: Callable[[], object]) -> Task:
        task = Task(owner, work, self.defects.append)
        self._tasks.append(task)
        return task

    def run_for(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            while sum(self._go_on(task) for task in self._chance.sample(self._tasks, len(self._tasks))):
                pass
            self._tasks = [task for task in self._tasks if not task.has_ended]
            self.now = min((task.until_s for task in self._tasks if task.owner not in self.frozen), default=math.inf)
            if self.now > end:
                self.now = end
                return

    def kill(self, owner: str) -> None:
        """All threads of a process, wherever they wait."""
        for task in [each for each in self._tasks if each.owner == owner and each is not self._current]:
            task.is_killed = True
            self._resume(task)
        self._tasks = [task for task in self._tasks if not task.has_ended]

    def close(self) -> None:
        for owner in {task.owner for task in self._tasks}:
            self.kill(owner)

    def _go_on(self, task: Task) -> bool:
        if task.has_ended or task.owner in self.frozen or not (task.until_s <= self.now or task.is_ready()):
            return False
        self._resume(task)
        return True

    def _resume(self, task: Task) -> None:
        before, self._current = self._current, task
        task.resume()
        self._current = before

    # ---- for its threads ----

    def wait(self, is_ready: Callable[[], object], timeout_s: float | None = None) -> bool:
        """Until a condition holds, or a timeout has passed; returns whether it holds."""
        if is_ready():
            return True
        task = self._current
        assert task, "only a thread of this clock may wait"
        task.is_ready = is_ready
        task.until_s = math.inf if timeout_s is None else math.ceil((self.now + timeout_s) / TICK_S) * TICK_S
        if not task.is_killed:
            task.pause.release()
            task.turn.acquire()
        if task.is_killed:
            raise Killed
        return bool(is_ready())

    def sleep(self, seconds: float) -> None:
        if seconds > 0.0:
            self.wait(lambda: False, seconds)

    def current_owner(self) -> str:
        return self._current.owner if self._current else self.owner

    def install(self, patch: pytest.MonkeyPatch, *modules: ModuleType) -> None:
        """Let modules use this clock, and its threads."""
        parts = {
            "time": SimpleNamespace(monotonic=lambda: self.now, time=lambda: 1e9 + self.now, sleep=self.sleep),
            "threading": SimpleNamespace(
                BoundedSemaphore=threading.BoundedSemaphore,
                Condition=lambda: _Condition(self),
                Event=lambda: _Event(self),
                Lock=lambda: _Lock(self),
            ),
            "queue": SimpleNamespace(Queue=lambda maxsize: _Queue(self, maxsize), Empty=queue.Empty, Full=queue.Full),
            "Background": lambda name, work, on_failure: _Background(self, work),
        }
        for module in modules:
            for name in parts.keys() & vars(module).keys():
                patch.setattr(module, name, parts[name])


class _Background:
    def __init__(self, time: VirtualTime, work: Callable[[], object]) -> None:
        self._time, self._work = time, work

    def start(self) -> None:
        self._task = self._time.begin(self._time.current_owner(), self._work)

    def is_alive(self) -> bool:
        return not self._task.has_ended

    def join(self, timeout_s: float | None = None) -> None:
        self._time.wait(lambda: self._task.has_ended, timeout_s)


class _Lock:
    def __init__(self, time: VirtualTime) -> None:
        self._time, self._is_held = time, False

    def __enter__(self) -> None:
        self._time.wait(lambda: not self._is_held)
        self._is_held = True

    def __exit__(self, *error: object) -> None:
        self._is_held = False


class _Condition:
    """Nobody else runs between two waits, so it has nothing to lock."""

    def __init__(self, time: VirtualTime) -> None:
        self._time, self._notified = time, 0

    def __enter__(self) -> None: ...

    def __exit__(self, *error: object) -> None: ...

    def notify_all(self) -> None:
        self._notified += 1

    def wait(self, timeout_s: float) -> bool:
        before = self._notified
        return self._time.wait(lambda: self._notified != before, timeout_s)

    def wait_for(self, condition: Callable[[], object], timeout_s: float | None = None) -> bool:
        return self._time.wait(condition, timeout_s)


class _Event:
    def __init__(self, time: VirtualTime) -> None:
        self._time, self._is_set = time, False

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True

    def clear(self) -> None:
        self._is_set = False

    def wait(self, timeout_s: float | None = None) -> bool:
        return self._time.wait(self.is_set, timeout_s)


class _Queue:
    def __init__(self, time: VirtualTime, maxsize: int) -> None:
        self._time, self._maxsize, self._items = time, maxsize, deque[Any]()

    def __iter__(self) -> Iterator[Any]:
        return iter(self._items)

    def put_nowait(self, item: Any) -> None:
        if len(self._items) >= self._maxsize:
            raise queue.Full
        self._items.append(item)

    def get(self, timeout: float | None = None) -> Any:
        if not self._time.wait(lambda: self._items, timeout):
            raise queue.Empty
        return self._items.popleft()
