"""Work for a client that has left ends."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from starlette.requests import Request

from robocorba.console.leaving import in_thread
from robocorba.decoding import Work
from robocorba.errors.files import WorkEnded
from tests.waits import work_for

LIMIT_S = 60.0


def request(is_gone: threading.Event) -> Request:
    async def receive() -> dict[str, Any]:
        while not is_gone.is_set():
            await asyncio.sleep(0.01)
        return {"type": "http.disconnect"}

    return Request({"type": "http"}, receive)


def endless(work: Work) -> None:
    while True:
        work.check()
        work_for(0.001)


def test_work_ends_with_its_client() -> None:
    is_gone, work = threading.Event(), Work(LIMIT_S)
    threading.Timer(0.1, is_gone.set).start()
    with pytest.raises(WorkEnded, match="nobody waits"):
        asyncio.run(in_thread(request(is_gone), work, lambda: endless(work)))


def test_work_ends_after_its_limit() -> None:
    work = Work(0.2)
    with pytest.raises(WorkEnded, match=r"after 0\.2 s, its limit"):
        asyncio.run(in_thread(request(threading.Event()), work, lambda: endless(work)))


def test_work_ends_with_its_server() -> None:
    work = Work(LIMIT_S)

    async def serve() -> None:
        serving = asyncio.create_task(in_thread(request(threading.Event()), work, lambda: endless(work)))
        await asyncio.sleep(0.05)
        serving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await serving

    asyncio.run(serve())  # waits for the thread
    with pytest.raises(WorkEnded):
        work.check()


def test_the_result_and_errors_arrive() -> None:
    def fail() -> None:
        raise KeyError("x")

    assert asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), lambda: 7)) == 7
    with pytest.raises(KeyError):
        asyncio.run(in_thread(request(threading.Event()), Work(LIMIT_S), fail))
