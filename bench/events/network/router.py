"""The router between the two sub-networks: a process that holds back each packet for as long as the link is.

python -m bench.events.network.router FD FD: the descriptors are those of two TUN devices. It reads lines of JSON on
stdin, {"delay_us": 200} to change the delay one way or {} to leave it, answers each with what it has forwarded so far,
and ends with its stdin.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import sys
import time
from collections import deque
from typing import Any

#: Largest IP packet.
PACKET_BYTES = 65536
#: What remains of a delay when it is not worth sleeping any more, ns.
SPIN_NS = 80_000


class DelayLine:
    """One direction: packets come out in order, `delay_ns` after they went in."""

    def __init__(self) -> None:
        self.delay_ns = 0
        self.packets = self.bytes = 0
        self._held: deque[tuple[int, bytes]] = deque()

    def put(self, packet: bytes, now_ns: int) -> None:
        """Take in a packet, and count it."""
        self.packets += 1
        self.bytes += len(packet)
        self._held.append((now_ns + self.delay_ns, packet))

    @property
    def due_ns(self) -> int | None:
        """When the next packet comes out; None where there is none."""
        return self._held[0][0] if self._held else None

    def take(self, now_ns: int) -> bytes | None:
        """The next packet that is due."""
        return self._held.popleft()[1] if self._held and self._held[0][0] <= now_ns else None


class Router:
    """Two delay lines between two devices: lines[0] leads from devices[0] to devices[1]."""

    def __init__(self, devices: tuple[int, int]) -> None:
        self.lines = (DelayLine(), DelayLine())
        self._ways = tuple(zip(devices, reversed(devices), self.lines, strict=True))

    def run(self, control: int) -> None:
        """Forward packets until `control`, where the commands come from, ends."""
        readable = [control, *(source for source, _, _ in self._ways)]
        while True:
            ready, _, _ = select.select(readable, (), (), self._pause_s())
            for source, target, line in self._ways:
                if source in ready:
                    self._read(source, line)
                while (packet := line.take(time.monotonic_ns())) is not None:
                    with contextlib.suppress(OSError):  # a full device loses it, as any router does
                        os.write(target, packet)
            if control in ready and not self._obey(control):
                return

    def _pause_s(self) -> float | None:
        """Until the next packet is due; what is left of it then is spent awake, since sleep is not that exact."""
        due = [line.due_ns for line in self.lines if line.due_ns is not None]
        return max(0, min(due) - SPIN_NS - time.monotonic_ns()) / 1e9 if due else None

    @staticmethod
    def _read(source: int, line: DelayLine) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                line.put(os.read(source, PACKET_BYTES), time.monotonic_ns())

    def _obey(self, control: int) -> bool:
        """Do what a line says and answer it. False at the end."""
        text = os.read(control, 4096)
        for command in text.splitlines():
            wanted: dict[str, Any] = json.loads(command)
            for line in self.lines:
                line.delay_ns = round(1000 * wanted.get("delay_us", line.delay_ns / 1000))
            counts = {"packets": [line.packets for line in self.lines], "bytes": [line.bytes for line in self.lines]}
            print(json.dumps(counts), flush=True)
        return bool(text)


def main() -> None:
    # A router is a computer of its own: it does not wait for a core because another one works.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    first, second = map(int, sys.argv[1:])
    print(json.dumps({"priority": os.sched_getscheduler(0) == os.SCHED_FIFO}), flush=True)
    Router((first, second)).run(sys.stdin.fileno())


if __name__ == "__main__":
    main()
