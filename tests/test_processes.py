"""What all processes do: stop on request, claim ports, retry, return freed memory, and write logs."""

from __future__ import annotations

import contextlib
import gc
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.errors.services import ServiceError, StartFailed
from robocorba.system import claimed_ports as ports
from robocorba.system import logs
from robocorba.system.backoff import Backoff
from robocorba.system.claimed_ports import HOST, PORTS_PER_BLOCK, claimed_ports
from robocorba.system.stop_latch import EMERGENCY_STOP, MAX_REASONS, StopLatch
from robocorba.system.stop_request import SIGNALS, StopRequest

#: Prints the private memory [MB]: after twelve threads have held and freed large blocks; and before and after `trim`,
#: once small blocks below one that stays were freed.
MEMORY = """
import threading, psutil
from robocorba.orb.workarounds import return_freed_memory, trim
assert return_freed_memory()
def print_memory():
    print((psutil.Process().memory_full_info().uss - before) / 1e6)
before = psutil.Process().memory_full_info().uss
kept = []
def hold():
    for _ in range(20):
        large = b"x" * 16_000_000
        kept.append(b"y" * 2000)  # above the large block, where both are in a heap
        del large
threads = [threading.Thread(target=hold) for _ in range(12)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print_memory()
small = [b"x" * 5000 for _ in range(5000)]
small = small[-1:]
print_memory()
trim()
print_memory()
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_freed_memory_is_returned() -> None:
    """Blocks of threads, and pages below what stays."""
    found = subprocess.run([sys.executable, "-c", MEMORY], capture_output=True, text=True, check=True, timeout=120)
    of_threads, before, after = map(float, found.stdout.split())
    assert of_threads < 8.0
    assert after < before - 20.0


@pytest.mark.parametrize("number", [*SIGNALS, None])
def test_a_signal_or_a_request_of_another_thread_ends_a_wait(number: signal.Signals | None) -> None:
    def kill() -> None:
        signal.pthread_kill(threading.get_ident(), number or 0)

    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        assert not stop.wait(0.0)
        assert not stop.wait(0.05)
        # As if it had come between the interpreter's last look for signals and the beginning of the wait.
        threading.Timer(0.2, kill if number else stop.make).start()
        assert stop.wait(60.0 if number else None)
        for _ in range(100_000):  # more than its socket can hold
            stop.make()
        assert stop.wait(0.0)
        stop.close()
        stop.make()
        assert stop.is_made


def test_signals_do_afterwards_what_they_did_before() -> None:
    before = [signal.getsignal(number) for number in SIGNALS]
    theirs, other = socket.socketpair()
    theirs.setblocking(False)
    descriptor = signal.set_wakeup_fd(theirs.fileno())
    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        stop.catch_signals()
    assert [signal.getsignal(number) for number in SIGNALS] == before
    with contextlib.closing(StopRequest()) as stop:
        stop.catch_signals()
        assert signal.getsignal(SIGNALS[0]) != before[0]
        stop.release_signals()
        assert signal.set_wakeup_fd(theirs.fileno()) == theirs.fileno()
        stop.catch_signals()
        theirs.close()
    assert signal.set_wakeup_fd(descriptor) == -1  # one that was closed meanwhile is not restored
    other.close()
    forgotten = StopRequest()
    forgotten.catch_signals()
    kept = weakref.ref(forgotten)
    del forgotten
    gc.collect()
    still_there = kept()
    assert still_there is not None
    still_there.close()


class Latch(RuleBasedStateMachine):
    """An end may name any number, also one that an earlier look has returned."""

    def __init__(self) -> None:
        super().__init__()
        self.latch = StopLatch()
        self.holding: dict[int, str] = {}
        self.count = 0

    @rule(reason=st.sampled_from(["fire", "smoke", ""]))
    def stop(self, reason: str) -> None:
        self.count += 1
        assert self.latch.stop(reason) == self.count
        self.holding[self.count] = reason or EMERGENCY_STOP

    @rule(back=st.integers(-1, 4))
    def end(self, back: int) -> None:
        number = self.count - back
        self.latch.end(number)
        if number <= self.count:
            self.holding = {each: reason for each, reason in self.holding.items() if each > number}

    @rule()
    def restart(self) -> None:
        self.latch = StopLatch(self.latch.number, self.latch.reasons)

    @invariant()
    def holds_what_was_not_ended(self) -> None:
        assert self.latch.is_on == bool(self.holding)
        assert self.latch.reason in {"", *self.holding.values()}
        assert bool(self.latch.reason) == self.latch.is_on


TestLatch = Latch.TestCase


def test_many_reasons_to_stop_are_kept_as_few() -> None:
    latch = StopLatch()
    for number in range(3 * MAX_REASONS):
        latch.stop(f"reason {number}")
    assert len(latch.reasons) == MAX_REASONS
    for last, is_on in ((3 * MAX_REASONS - 1, True), (3 * MAX_REASONS, False)):
        latch.end(last)
        assert latch.is_on is is_on


@pytest.fixture
def two_blocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[range]:
    """The only blocks to choose from; free, as nothing else uses what is reserved here."""
    with claimed_ports() as first:
        blocks = range(first, first + PORTS_PER_BLOCK - 2, 6)[:2]
        monkeypatch.setattr(ports, "PORTS_PER_BLOCK", 6)
        monkeypatch.setattr(ports, "BLOCKS", blocks)
        yield blocks


def test_each_claim_gets_its_own_free_ports(two_blocks: range) -> None:
    # Below those that Linux gives to connections by default.
    assert ports.BLOCKS.stop <= 32768
    with claimed_ports() as first, claimed_ports() as second:
        assert {first, second} == set(two_blocks)
        with pytest.raises(StartFailed, match="no 6 successive ports"), claimed_ports():
            pass
    with claimed_ports() as again:
        assert again in two_blocks
    with socket.create_server((HOST, two_blocks[0] + 3)):
        for _ in range(20):
            with claimed_ports() as port:
                assert port == two_blocks[1]
    with claimed_ports() as first, contextlib.ExitStack() as stack:
        for port in range(first, first + 5):
            stack.enter_context(socket.create_server((HOST, port)))
        with pytest.raises(OSError), socket.socket() as other:
            other.bind((HOST, first + 5))


QUICK = Backoff(0.001, 0.002)


def test_an_operation_is_repeated_after_pauses_that_grow() -> None:
    backoff = Backoff(0.1, 1.0, factor=3.0)
    assert [round(backoff.pause_s(failures), 6) for failures in range(6)] == [0.0, 0.1, 0.3, 0.9, 1.0, 1.0]
    assert backoff.pause_s(10**9) == 1.0
    pauses = {Backoff(1.0, 1.0, jitter=0.5).pause_s(1) for _ in range(50)}
    assert len(pauses) > 1
    assert all(0.5 <= pause_s <= 1.0 for pause_s in pauses)
    answers: Iterator[Any] = iter([OSError("first"), OSError("second"), 7])

    def operation() -> int:
        answer = next(answers)
        if isinstance(answer, OSError):
            raise answer
        return int(answer)

    assert QUICK.call(operation, 10.0, OSError) == 7
    answers = iter([0, 0, 3])
    assert QUICK.poll(operation, 10.0) == 3
    assert QUICK.poll(lambda: 0, 0.0) == 0


@pytest.mark.parametrize(("timeout_s", "errors"), [(0.0, (OSError,)), (0.05, (OSError,)), (60.0, (ValueError,))])
def test_the_last_error_is_raised(timeout_s: float, errors: tuple[type[Exception], ...]) -> None:
    def operation() -> None:
        raise OSError("refused")

    began = time.monotonic()
    with pytest.raises(OSError, match="refused"):
        QUICK.call(operation, timeout_s, *errors)
    assert time.monotonic() - began < 50.0


def logging_to(folder: Path) -> str:
    """The code by which a process begins to log to folder/test.log; logging belongs to a process as a whole."""
    begin = "import logging; from pathlib import Path; from robocorba.system import logs"
    return f"{begin}; folder = Path({str(folder)!r})\nlogs.setup('test', folder)\n"


def run_logging(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", logging_to(folder) + code]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@given(st.text())
@settings(deadline=None)
def test_any_text_becomes_one_line(text: str) -> None:
    assert len(logs.one_line(text).splitlines()) <= 1


def test_an_event_is_a_line_with_time_level_and_process(tmp_path: Path) -> None:
    """Also what ends the process, with its traceback."""
    message = "first\nsecond\r\u2028third \ud800"
    result = run_logging(tmp_path, f"logging.info({json.dumps(message)}); logging.warning('careful'); 1 / 0")
    lines = (tmp_path / "test.log").read_text().splitlines()
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d INFO test first.*third \S+", lines[0])
    assert lines[1].endswith(" WARNING test careful")
    assert "CRITICAL test ZeroDivisionError: division by zero\\nTraceback" in lines[2]
    assert len(lines) == 3
    assert result.returncode == 1
    assert result.stderr == "WARNING careful\nCRITICAL ZeroDivisionError: division by zero\n"


def test_nobody_waits_for_a_reader_of_stderr(tmp_path: Path) -> None:
    """A pipe holds 64 KiB; what does not fit is in the file, and counted when somebody reads again."""
    code = (
        f"{logging_to(tmp_path)}for number in range(2000): logging.warning('%d %s', number, 'x' * 100)\n"
        "logging.warning('y' * 5000)\n"
        "print('done', flush=True)\n"
        "input()\n"
        "logging.warning('last')"
    )
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen([sys.executable, "-c", code], **pipes, text=True) as process:
        assert process.stdout and process.stderr and process.stdin
        stdout, waiting = process.stdout, threading.Timer(60.0, process.kill)
        waiting.start()
        assert stdout.readline() == "done\n"
        read = [process.stderr.readline() for _ in range(100)]
        process.stdin.write("\n")
        process.stdin.close()
        read += process.stderr.readlines()
        waiting.cancel()
    assert read[0].startswith("WARNING 0 x") and read[-1] == "WARNING last\n"
    (gap,) = (line for line in read if "lines before this one are missing" in line)
    assert int(gap.split()[1]) == 2002 - len(read) + 1
    assert len((tmp_path / "test.log").read_text().splitlines()) == 2002


def test_files_stay_bounded(tmp_path: Path) -> None:
    lines = "for n in range(200): logging.info('%d', n)"
    run_logging(tmp_path, f"logs.MAX_BYTES = 1000; logs.setup('test', folder)\n{lines}")
    files = sorted(tmp_path.iterdir())
    assert len(files) == 1 + logs.OLD_FILES
    assert all(file.stat().st_size <= 1000 for file in files)
    assert files[0].read_text().endswith(" 199\n")


def test_a_folder_that_cant_be_written_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ServiceError, match=r"file/x\.log"):
        logs.open_log("x", tmp_path / "file")
    log = logs.open_log("x", tmp_path / "logs")
    log.handlers[0].close()
    shutil.rmtree(tmp_path / "logs")
    log.error("nobody reads this")
    assert capfd.readouterr().err == ""


def test_a_full_disk_is_survived_and_counted(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.log").symlink_to("/dev/full")
    log = logs.open_log("x", tmp_path)
    for number in range(3):
        log.error("%d", number)
    (tmp_path / "x.log").unlink()
    (tmp_path / "x.log").write_text("a part of a li")
    log.handlers[0].close()  # opened again by the next line
    for number in range(3, 5):
        log.error("%d", number)
    part, *lines = (tmp_path / "x.log").read_text().splitlines()
    assert part == "a part of a li"
    assert [line.partition(" x ")[2].partition(" lines")[0] for line in lines] == ["3", "3", "4"]
    assert capfd.readouterr().err == ""
