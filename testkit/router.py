"""The network between hosts: a process that carries their packets over the segments of sub-networks and the links
between them.

python -m testkit.router ADDRESS=FD ...: the TUN device of each host. Hosts whose addresses agree in three bytes are in
one sub-network; a router links it with each other one. It prints whether it has real-time priority, reads lines of
JSON on stdin, answers each with the traffic between sub-networks so far, and ends with its stdin:
  {"delay_us": 200}    one-way delay between sub-networks
  {"far_us": {"192.168.8": 90}}    the same, in addition to it, to and from each sub-network
  {"mbit_s": 10}       bit rate of each sub-network's segment; 0 for no limit
  {"is_cut": true}     drop all packets between sub-networks from now on
  {}                   change nothing

A segment is half duplex and shared, as 10BASE-T with a hub: one frame at a time, from any host, with all that
Ethernet adds to a packet; frames wait in one queue, first come first served, and a full queue drops the newest. A
packet to another sub-network takes both segments, one after the other, and the router stores it between them. Not
modelled: collisions and backoff, address resolution, bit errors, the time that a router needs.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import json
import os
import select
import socket
import sys
import time
from collections import deque
from collections.abc import Mapping

#: Size of the largest IP packet [bytes].
PACKET_BYTES = 65536
#: The last part of a delay is spent waiting actively, because sleep is not exact enough [ns].
SPIN_NS = 80_000
#: What Ethernet adds to a packet [bytes]: preamble, header and check sequence; the gap behind a frame. A shorter packet
#: is padded.
FRAME_BYTES, GAP_BYTES, SHORTEST_BYTES = 8 + 14 + 4, 12, 46
#: Bound of a segment's queue [bytes]: 40 of the longest frames, as routers of the time had.
QUEUE_BYTES = 40 * 1526


class Segment:
    """The medium of a sub-network, with an unlimited rate at first."""

    def __init__(self) -> None:
        self.mbit_s, self.far_ns = 0.0, 0
        self.dropped = 0
        self._free_ns = 0

    def carry(self, size: int, now_ns: int) -> int | None:
        """When a packet of `size` bytes that is sent now has arrived [ns]; None if the queue is full.

        Packets must be passed in the order in which they are sent."""
        if not self.mbit_s:
            return now_ns
        byte_ns = 8000 / self.mbit_s
        if self._free_ns - now_ns > QUEUE_BYTES * byte_ns:
            self.dropped += 1
            return None
        arrives_ns = max(now_ns, self._free_ns) + round((max(size, SHORTEST_BYTES) + FRAME_BYTES) * byte_ns)
        self._free_ns = arrives_ns + round(GAP_BYTES * byte_ns)
        return arrives_ns


class Network:
    """Packets on their way between hosts, given by their addresses of four bytes."""

    def __init__(self, hosts: list[bytes]) -> None:
        self.segments = {host[:3]: Segment() for host in hosts}
        self.delay_ns, self.is_cut = 0, False
        #: Packets and bytes that have entered a link between sub-networks.
        self.packets = self.bytes = 0
        self._count = itertools.count()
        self._moving: list[tuple[int, int, bytes, bytes]] = []
        self._arrived: deque[bytes] = deque()

    def put(self, packet: bytes, now_ns: int) -> None:
        """Send an IPv4 packet; one with an unknown source or target is dropped."""
        self._move(now_ns)
        if packet[12:15] in self.segments and packet[16:19] in self.segments:
            self._send(packet[12:15], packet, now_ns)

    def take(self, now_ns: int) -> bytes | None:
        """The next packet that has arrived at its target; None if there is none."""
        self._move(now_ns)
        return self._arrived.popleft() if self._arrived else None

    @property
    def due_ns(self) -> int | None:
        """When the next packet moves on; None if there is none."""
        return self._moving[0][0] if self._moving else None

    def _move(self, now_ns: int) -> None:
        while self._moving and self._moving[0][0] <= now_ns:
            at_ns, _, subnet, packet = heapq.heappop(self._moving)
            if packet[16:19] == subnet:
                self._arrived.append(packet)
            else:
                self._send(packet[16:19], packet, at_ns)

    def _send(self, subnet: bytes, packet: bytes, now_ns: int) -> None:
        arrives_ns = self.segments[subnet].carry(len(packet), now_ns)
        if arrives_ns is None:
            return
        if packet[16:19] != subnet:
            if self.is_cut:
                return
            self.packets += 1
            self.bytes += len(packet)
            arrives_ns += self.delay_ns + self.segments[subnet].far_ns + self.segments[packet[16:19]].far_ns
        heapq.heappush(self._moving, (arrives_ns, next(self._count), subnet, packet))

    def change(
        self,
        delay_us: float | None = None,
        mbit_s: float | None = None,
        is_cut: bool | None = None,
        far_us: Mapping[str, float] | None = None,
    ) -> None:
        """Change what is given."""
        self.delay_ns = self.delay_ns if delay_us is None else round(1000 * delay_us)
        self.is_cut = self.is_cut if is_cut is None else is_cut
        for address, segment in self.segments.items():
            segment.mbit_s = segment.mbit_s if mbit_s is None else mbit_s
            far_ns = 1000 * (far_us or {}).get(".".join(map(str, address)), 0.0)
            segment.far_ns = segment.far_ns if far_us is None else round(far_ns)


def carry(devices: dict[bytes, int], control: int) -> None:
    """Carry the packets of the devices until `control`, the descriptor with the commands, ends."""
    network = Network(list(devices))
    while True:
        due = network.due_ns
        pause_s = None if due is None else max(0, due - SPIN_NS - time.monotonic_ns()) / 1e9
        ready, _, _ = select.select((control, *devices.values()), (), (), pause_s)
        for source in ready:
            with contextlib.suppress(BlockingIOError):
                while source != control:
                    network.put(os.read(source, PACKET_BYTES), time.monotonic_ns())
        while (packet := network.take(time.monotonic_ns())) is not None:
            if packet[16:20] in devices:
                with contextlib.suppress(OSError):  # a full device drops the packet, as any router does
                    os.write(devices[packet[16:20]], packet)
        if control in ready:
            if not (text := os.read(control, 4096)):
                return
            for command in map(json.loads, text.splitlines()):
                network.change(**command)
                dropped = sum(segment.dropped for segment in network.segments.values())
                print(json.dumps({"packets": network.packets, "bytes": network.bytes, "dropped": dropped}), flush=True)


if __name__ == "__main__":
    # A real network is no computer's work, so it must not wait for a core.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    print(json.dumps({"priority": os.sched_getscheduler(0) == os.SCHED_FIFO}), flush=True)
    hosts = (host.split("=") for host in sys.argv[1:])
    carry({socket.inet_aton(address): int(fd) for address, fd in hosts}, sys.stdin.fileno())
