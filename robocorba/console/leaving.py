"""Work for a client ends when the client leaves."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from starlette.requests import Request

from robocorba.system.decoding import Work

T = TypeVar("T")


async def in_thread(request: Request, work: Work, function: Callable[[], T]) -> T:
    """The result of a function in a thread of its own; `work` is cancelled when the client of the request leaves.

    The body of the request must have been received. Raises what the function raises."""
    task = asyncio.create_task(asyncio.to_thread(function))
    try:
        while not (await asyncio.wait([task], timeout=0.25))[0]:
            if await request.is_disconnected():
                work.cancel()
        return task.result()
    finally:  # also if the server itself ends this request
        work.cancel()
