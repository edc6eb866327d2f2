"""The router between two networks: a process that delays each packet.

python -m testkit.router FD FD: the descriptors of two TUN devices. It prints whether it has real-time
priority, reads lines of JSON on stdin, {"delay_us": 200} to change the one-way delay, {"is_cut": true} to drop all
packets from now on, or {} to change nothing, answers each with the traffic forwarded so far, and ends with its stdin.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import sys
import time
from collections import deque

#: Size of the largest IP packet [bytes].
PACKET_BYTES = 65536
#: The last part of a delay is spent waiting actively, because sleep is not exact enough [ns].
SPIN_NS = 80_000


class DelayLine:
    """One direction: delays packets by `delay_ns`, in order, or drops them while it `is_cut`."""

    def __init__(self) -> None:
        self.delay_ns, self.is_cut = 0, False
        self.packets = self.bytes = 0
        self._held: deque[tuple[int, bytes]] = deque()

    def put(self, packet: bytes, now_ns: int) -> None:
        """Add and count a packet."""
        if self.is_cut:
            return
        self.packets += 1
        self.bytes += len(packet)
        self._held.append((now_ns + self.delay_ns, packet))

    @property
    def due_ns(self) -> int | None:
        """When the next packet is due; None if there is none."""
        return self._held[0][0] if self._held else None

    def take(self, now_ns: int) -> bytes | None:
        """The next packet if it is due, else None."""
        return self._held.popleft()[1] if self._held and self._held[0][0] <= now_ns else None


def route(devices: tuple[int, int], control: int) -> None:
    """Forward packets between the devices until `control`, the descriptor with the commands, ends."""
    lines = (DelayLine(), DelayLine())
    ways = tuple(zip(devices, reversed(devices), lines, strict=True))
    while True:
        due = [line.due_ns for line in lines if line.due_ns is not None]
        pause_s = max(0, min(due) - SPIN_NS - time.monotonic_ns()) / 1e9 if due else None
        ready, _, _ = select.select((control, *devices), (), (), pause_s)
        for source, target, line in ways:
            if source in ready:
                with contextlib.suppress(BlockingIOError):
                    while True:
                        line.put(os.read(source, PACKET_BYTES), time.monotonic_ns())
            while (packet := line.take(time.monotonic_ns())) is not None:
                with contextlib.suppress(OSError):  # a full device drops the packet, as any router does
                    os.write(target, packet)
        if control in ready:
            if not (text := os.read(control, 4096)):
                return
            for command in map(json.loads, text.splitlines()):
                for line in lines:
                    line.delay_ns = round(1000 * command.get("delay_us", line.delay_ns / 1000))
                    line.is_cut = command.get("is_cut", line.is_cut)
                counts = {"packets": [line.packets for line in lines], "bytes": [line.bytes for line in lines]}
                print(json.dumps(counts), flush=True)


if __name__ == "__main__":
    # A real router is a separate computer, so it must not wait for a core.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    print(json.dumps({"priority": os.sched_getscheduler(0) == os.SCHED_FIFO}), flush=True)
    route((int(sys.argv[1]), int(sys.argv[2])), sys.stdin.fileno())
