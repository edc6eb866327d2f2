"""The paper's scene over a network: sub-networks lab and hall are separate hosts with a delay of 5 ms between them.

    python -m bench.missions.network [--seeds 1] [--delay 5]

All servers, the channel of lab and robots A and B run in one network namespace, the channel of hall and robot C in
another. A router process between them delays each packet. The marks are those of bench/missions/carry.py. Only events
with a subscriber on the other side may cross: while a camera floods the channel of lab, which has a consumer for its
events, the bytes on the link and the events passed on by the gateways are counted. It must run as root; without network
namespaces it prints so and measures nothing."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import random
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench import RESULTS
from bench.common.namespaces import Namespace
from bench.common.processes import Process
from bench.missions.carry import BUILDING, CREW, GOAL, LEADER, SKEW_MS, STARTS, Outcome, carry, draw, marks, spread_out
from robocorba.corba.event_client import Event, EventClient
from robocorba.corba.orb import Orb
from robocorba.maps.samples import load_sample, sample_path
from robocorba.names import CHANNELS
from robocorba.repeating import Repeating
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import module_command
from robocorba.testing.missions import MissionSystem
from robocorba.testing.processes import Launcher, Running, claimed_ports, eventually, real_system
from robocorba.testing.report import PROGRESS, Mark, at_least, at_most, summarize

NAME = "missions_network"
HERE, THERE = "192.168.0.2", "192.168.8.2"
#: One-way delay.
DELAY_MS = 5.0
#: Size [bytes] and interval [s] of the flood's events.
FLOOD_BYTES, FLOOD_S = 4000, 0.02
#: Duration of a measurement without a mission [s].
WATCH_S = 5.0
START_LIMIT_S = 60.0
#: Additional bytes on the link allowed during the flood, as a share of the flood: a robot's own traffic varies.
CROSSING_SHARE = 0.05


class Crossed(NamedTuple):
    """Totals so far. bytes: on the link, both directions. forth, back: events from lab to hall and from hall to lab, by
    the gateways' counters. published: events of the camera; received: those that its consumer in lab received."""

    bytes: int
    forth: int
    back: int
    published: int
    received: int

    def since(self, before: Crossed) -> Crossed:
        return Crossed(*(now - then for now, then in zip(self, before, strict=True)))


class TwoNetworks:
    """place: in lab, like this process. within: command prefix that starts C in hall."""

    def __init__(self, place: MissionSystem, within: tuple[str, ...], router: Process) -> None:
        self.place, self.within, self._router = place, within, router
        self._published = self._received = 0
        self._frame = os.urandom(FLOOD_BYTES)

    @contextlib.contextmanager
    def flood(self) -> Iterator[None]:
        """A camera publishes events in lab, and a consumer in lab receives them."""

        def receive(event: Event) -> None:
            self._received += 1

        with EventClient(self.place.orb, "lab", "camera") as camera, EventClient(self.place.orb, "lab") as viewer:
            viewer.subscribe(receive, "camera.*")

            def publish() -> None:
                camera.push("camera.frame", self._frame)
                self._published += 1

            publishing = Repeating("camera", publish, FLOOD_S).start()
            try:
                yield
            finally:
                publishing.close()

    def crossed(self) -> Crossed:
        counts = self._router.ask({})
        forth, back = (self._passed_on(channel, peer) for channel, peer in (("lab", "hall"), ("hall", "lab")))
        return Crossed(sum(counts["bytes"]), forth, back, self._published, self._received)

    def _passed_on(self, channel: str, peer: str) -> int:
        """Number of events that `peer` has received from `channel`."""
        other = self.place.orb.resolve(f"{CHANNELS}/{peer}", RoboCorba.EventChannel, call_timeout_s=5.0)
        links = [link for link in other.state().links if link.direction == RoboCorba.INCOMING]
        (link,) = [link for link in links if link.peer == channel]
        return int(link.events.received)


@contextlib.contextmanager
def two_networks(folder: Path, delay_ms: float) -> Iterator[TwoNetworks]:
    """Two namespaces with a running system; this process enters lab. Raises OSError if namespaces are not permitted."""
    with contextlib.ExitStack() as stack:
        lab, hall = (stack.enter_context(Namespace()) for _ in range(2))
        devices = []
        for computer, own, other in ((lab, HERE, THERE), (hall, THERE, HERE)):
            devices.append(computer.add_tun(f"{other}/32"))
            stack.callback(os.close, devices[-1])
            computer.ip("address", "add", f"{own}/32", "dev", "line")
        command = (sys.executable, "-m", "bench.events.network.router", *map(str, devices))
        router = stack.enter_context(Process(command, folder / "router.log", pass_fds=devices))
        router.receive(START_LIMIT_S)
        router.ask({"delay_us": 1000 * delay_ms})
        lab.enter()
        port = stack.enter_context(claimed_ports())
        launch = stack.enter_context(Launcher(folder))
        naming = Address(HERE, port)
        building = ("--host", HERE, "--building", str(sample_path(BUILDING)), "--subnets", "lab")
        up = real_system(launch, folder / "state", port, *building).wait_ready()
        threading.Thread(target=deque, args=(up.process.stderr, 0), daemon=True).start()
        channel = (*module_command("robocorba.servers.event_channel"), "--name", "hall", "--peer", "lab")
        where = ("--endpoint", f"{THERE}:{port}", "--naming", str(naming), "--state", str(folder / "hall"))
        stack.enter_context(Process((*hall.command(*channel), *where), folder / "hall.log"))
        orb = stack.enter_context(Orb(naming, call_timeout_s=5.0))
        eventually(lambda: _is_linked(orb), START_LIMIT_S, "the link between the channels")
        place = MissionSystem(folder, Running(up.process, folder / "state", naming), orb, launch)
        try:
            yield TwoNetworks(place, hall.command(), router)
        finally:
            place.end()


def _is_linked(orb: Orb) -> bool:
    if set(orb.names(CHANNELS)) != {"lab", "hall"}:
        return False
    states = [orb.resolve(f"{CHANNELS}/{name}", RoboCorba.EventChannel).state() for name in ("lab", "hall")]
    return all(
        len(state.links) == 2 and all(link.condition == RoboCorba.UP for link in state.links) for state in states
    )


class ClockOffsets(NamedTuple):
    """From the leader's report. number: messages received from hall's channel. clocks_ms: largest error of a robot's
    estimate of the leader's clock; all processes share one clock."""

    number: int
    clocks_ms: float

    @classmethod
    def of(cls, report: dict[str, Any]) -> ClockOffsets:
        offsets = [abs(clock["offset_ms"]) for clock in report["clocks"].values()]
        return cls(sum(event["origin"] == "hall" for event in report["events"]), max(offsets, default=math.nan))


def crossing_marks(
    quiet: Crossed, flooded: Crossed, missions: Sequence[Crossed], received: Sequence[ClockOffsets]
) -> list[Mark]:
    flood_bytes = flooded.published * FLOOD_BYTES
    more = max(0, flooded.bytes - quiet.bytes)
    unwanted = [abs(over.back - one.number) / max(1, one.number) for over, one in zip(missions, received, strict=True)]
    return [
        at_least(
            "share of the flood received in its own sub-network", flooded.received / max(1, flooded.published), 0.9
        ),
        at_most("events that crossed during the flood without a mission", flooded.forth + flooded.back, 0),
        at_most("additional bytes on the link, as a share of the flood", more / flood_bytes, CROSSING_SHARE),
        at_most("share of events from hall to lab that were not for the leader", max(unwanted), 0.02),
        at_most("error of the clock estimates, ms", max(one.clocks_ms for one in received), SKEW_MS),
    ]


def main() -> int:
    """Exit code: 0 if every mark was reached, or if network namespaces are not available."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="default: %(default)s")
    parser.add_argument(
        "--delay", type=float, default=DELAY_MS, metavar="MS", help="one-way delay (default: %(default)s)"
    )
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    crossed: list[Crossed] = []
    received: list[ClockOffsets] = []
    with tempfile.TemporaryDirectory() as temporary, contextlib.ExitStack() as stack:
        try:
            both = stack.enter_context(two_networks(Path(temporary), options.delay))
        except OSError as error:
            print(f"{NAME}: skipped: network namespaces are not available ({error}); run it as root", file=sys.stderr)
            return 0
        place = both.place
        place.start({name: at._replace(within=both.within) if name == "C" else at for name, at in CREW.items()})
        time.sleep(WATCH_S)
        quiet = watched(both)
        with both.flood():
            time.sleep(1.0)
            flooded = watched(both)
            for seed in range(1, options.seeds + 1):
                rng = random.Random(seed)
                x, y, heading = (middle + rng.uniform(-half, half) for middle, half in STARTS)
                for way, to in (("to its start", (x, y, heading)), ("to its goal", GOAL)):
                    with PROGRESS.status(f"seed {seed} of {options.seeds}: {way}"):
                        before = both.crossed()
                        outcomes.append(carry(place, seed, way, to))
                        crossed.append(both.crossed().since(before))
                        received.append(ClockOffsets.of(place.report(LEADER)))
                        print(*outcomes[-1].row().values(), *crossed[-1], *received[-1], sep="\t", flush=True)
                        spread_out(place, load_sample(BUILDING), seed)
    rows = [_row(*each) for each in zip(outcomes, crossed, received, strict=True)]
    print(json.dumps({"quiet": quiet._asdict(), "flooded": flooded._asdict()}))
    title = f"the paper's scene over links of {options.delay:g} ms one way, {len(outcomes)} missions"
    reached = [*marks(outcomes), *crossing_marks(quiet, flooded, crossed, received)]
    return 0 if summarize(RESULTS / NAME, title, rows, reached, lambda axes: draw(axes, outcomes)) else 1


def watched(both: TwoNetworks) -> Crossed:
    before = both.crossed()
    time.sleep(WATCH_S)
    return both.crossed().since(before)


def _row(one: Outcome, over: Crossed, received: ClockOffsets) -> dict[str, Any]:
    seconds = one.seconds if math.isfinite(one.seconds) else 1.0
    return {
        **one.row(),
        "lab to hall, events": over.forth,
        "hall to lab": over.back,
        "flood": over.published,
        "link, kB/s": over.bytes / seconds / 1e3,
        "clocks, ms": received.clocks_ms,
    }


if __name__ == "__main__":
    sys.exit(main())
