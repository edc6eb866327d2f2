"""Threads of the background: a failure is reported where the thread was started."""

from __future__ import annotations

import queue
import subprocess
import sys

from robocorba.background import Background, Workers

#: Whatever it runs on: a thread is waited for at most this long [s].
LIMIT_S = 30.0


def fail() -> None:
    raise ValueError("a fault")


def test_the_failure_of_a_thread_is_reported() -> None:
    reasons: list[str] = []
    thread = Background("test", fail, reasons.append)
    thread.start()
    thread.join(LIMIT_S)
    assert reasons == ["internal fault in 'test' (ValueError: a fault), see the log"]


def test_a_thread_that_ends_in_order_reports_nothing() -> None:
    reasons: list[str] = []
    thread = Background("test", lambda: None, reasons.append)
    thread.start()
    thread.join(LIMIT_S)
    assert reasons == []


def test_workers_report_each_failure_and_go_on() -> None:
    reasons: queue.Queue[str] = queue.Queue()
    workers = Workers("test", 1, reasons.put)
    workers.submit(fail)
    workers.submit(reasons.put, "an argument")
    assert "ValueError: a fault" in reasons.get(timeout=LIMIT_S)
    assert reasons.get(timeout=LIMIT_S) == "an argument"
    workers.close()


def test_a_process_ends_with_an_error_though_its_main_thread_waits() -> None:
    program = (
        "import threading; from robocorba.background import Background, end_process\n"
        "Background('worker', lambda: 1 / 0, end_process).start(); threading.Event().wait()"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=LIMIT_S)
    assert ended.returncode == 1
    assert "the process ends: internal fault in 'worker' (ZeroDivisionError" in ended.stderr
