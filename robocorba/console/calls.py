"""Calls of operations over HTTP: POST /call/NAME with a JSON object of arguments; the answer is JSON in any case."""

from __future__ import annotations

import asyncio
import json
import logging
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from robocorba.console.defects import DEFECT
from robocorba.console.operations import Operations
from robocorba.errors.base import RoboCorbaError

_log = logging.getLogger(__name__)

#: Largest body of a call [bytes].
MAX_BODY = 8 * 1024 * 1024
#: Emergency stops.
STOPS = frozenset({"stop", "stop_all", "panel_stop"})


class Calls:
    """Answers calls of operations, each in a thread, until `close`."""

    def __init__(self, operations: Operations) -> None:
        self._operations = operations
        # Threads that serve nothing else: all others may wait for robots that hang.
        self._stops = ThreadPoolExecutor(8, "console stop")

    async def answer(self, name: str, request: Request) -> Response:
        """`answer`, or `error` with a sentence for the user."""
        return await self._answer(name, request, {})

    async def answer_panel(self, name: str, robot: str, request: Request) -> Response:
        """The same for the panel of a robot."""
        if not name.startswith("panel"):
            return JSONResponse({"error": f"panels have no operation {name[:80]!r}"})
        return await self._answer(name, request, {"robot": robot})

    async def _answer(self, name: str, request: Request, given: dict[str, Any]) -> Response:
        try:
            arguments = {**await _arguments(request), **given}
            threads = self._stops if name in STOPS else None
            loop = asyncio.get_running_loop()
            return JSONResponse({"answer": await loop.run_in_executor(threads, self._operations.call, name, arguments)})
        except RoboCorbaError as error:
            return JSONResponse({"error": str(error)})
        except Exception:  # a defect of an operation: the page gets an answer, the log the trace
            _log.exception("operation %r failed", name[:80])
            return JSONResponse({"error": DEFECT})

    def close(self) -> None:
        self._stops.shutdown(wait=False, cancel_futures=True)


async def _arguments(request: Request) -> dict[str, Any]:
    body = b""
    async for piece in request.stream():
        body += piece
        if len(body) > MAX_BODY:
            raise RoboCorbaError(f"the request is longer than {MAX_BODY} bytes")
    try:
        arguments = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise RoboCorbaError(f"the request is not JSON: {str(error)[:200]}") from None
    # Pages of other sites can send a form or plain text here, but not this type.
    is_json = request.headers.get("content-type", "").partition(";")[0] == "application/json"
    if not is_json or not isinstance(arguments, dict):
        raise RoboCorbaError("the request is not a JSON object")
    return arguments
