"""What supervised processes print is read to the end, and the watch for hangs goes on, whatever fails meanwhile."""

from __future__ import annotations

import asyncio
import os

from robocorba.errors.services import NotReachable
from robocorba.supervision.hangs import HangLimit, watch_for_hang
from robocorba.supervision.output import Pipe


def test_a_line_that_cannot_be_handled_does_not_end_the_reading() -> None:
    handled: list[str] = []

    def handle(line: str) -> None:
        if line == "bad":
            raise ValueError("a fault")
        handled.append(line)

    async def read() -> None:
        pipe = await Pipe.open()
        with pipe.write_end() as output:
            os.write(output, b"one\nbad\ntwo\n")
        await asyncio.wait_for(pipe.read(handle), 30.0)

    asyncio.run(read())
    assert handled == ["one", "two"]


class Process:
    """A process that notes that it was killed."""

    pid = os.getpid()
    is_killed = False

    def send_signal(self, number: int) -> None:
        self.is_killed = True


def test_a_defect_of_the_check_does_not_end_the_watch() -> None:
    process, errors = Process(), [ValueError("a fault")]

    def is_alive() -> None:
        raise errors.pop() if errors else NotReachable("it hangs")

    watch = watch_for_hang(process, is_alive, HangLimit(0.3))  # type: ignore[arg-type]
    assert "was killed: no answer" in asyncio.run(asyncio.wait_for(watch, 30.0))
    assert process.is_killed
