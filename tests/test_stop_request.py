"""The request to stop: by signals whenever they come, and by the process itself."""

from __future__ import annotations

import contextlib
import gc
import signal
import socket
import threading
import weakref
from collections.abc import Callable, Iterator

import pytest

from robocorba.stop_request import SIGNALS, StopRequest


@pytest.fixture
def stop() -> Iterator[StopRequest]:
    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        yield stop


def soon(call: Callable[[], object]) -> None:
    """Call from another thread, most likely while this one waits."""
    threading.Timer(0.2, call).start()


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_that_does_not_interrupt_the_main_thread_ends_its_wait(
    stop: StopRequest, number: signal.Signals
) -> None:
    # As if it had come between the interpreter's last look for signals and the beginning of the wait.
    soon(lambda: signal.pthread_kill(threading.get_ident(), number))
    assert stop.wait(60.0)


def test_a_request_of_another_thread_ends_a_wait_without_a_limit(stop: StopRequest) -> None:
    soon(stop.make)
    assert stop.wait()
    assert stop.wait(0.0)


def test_without_a_request_a_wait_ends_in_time(stop: StopRequest) -> None:
    assert not stop.wait(0.0)
    assert not stop.wait(0.05)


def test_more_requests_than_the_socket_can_hold_are_one(stop: StopRequest) -> None:
    for _ in range(100_000):
        stop.make()
    assert stop.wait(60.0)


def test_signals_do_afterwards_what_they_did_before() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]
    descriptor = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(descriptor)
    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        stop.catch_signals()
    assert [signal.getsignal(number) for number in SIGNALS] == before
    assert signal.set_wakeup_fd(descriptor) == descriptor


def test_a_descriptor_that_was_closed_meanwhile_is_not_restored() -> None:
    theirs, other = socket.socketpair()
    theirs.setblocking(False)
    before = signal.set_wakeup_fd(theirs.fileno())
    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        theirs.close()
    assert signal.set_wakeup_fd(before) == -1
    other.close()


def test_one_that_nobody_knows_any_more_still_has_its_socket() -> None:
    forgotten = StopRequest()
    forgotten.catch_signals()
    kept = weakref.ref(forgotten)
    del forgotten
    gc.collect()
    still_there = kept()
    assert still_there is not None
    still_there.close()


def test_a_request_after_the_end_harms_nobody(stop: StopRequest) -> None:
    stop.close()
    stop.make()
    assert stop.is_made
