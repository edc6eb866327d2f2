"""The paper's scene over a network: sub-networks lab and hall are separate hosts with a delay of 5 ms between them.

    python -m bench.missions.network [--seeds 1] [--delay 5]

All servers, the channel of lab and robots A and B run in one network namespace, the channel of hall and robot C in
another. A router process between them delays each packet. The marks are those of bench/missions/carry.py. Only events
with a subscriber on the other side may cross: while a camera floods the channel of lab, which has a consumer for its
events, the bytes on the link and the events passed on by the gateways are counted. It must run as root; without network
namespaces it prints so and measures nothing."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench.common.harness import NotMeasured, folder_of_bench, run
from bench.missions.carry import BUILDING, CREW, SKEW_MS, Carried, carries, draw, marks
from robocorba.events.corba.event_client import EventClient
from robocorba.map_editor.model import Building
from robocorba.map_editor.samples import sample_path
from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba
from robocorba.system.claimed_ports import claimed_ports
from robocorba.system.names import CHANNELS
from robocorba.system.repeating import Repeating
from robocorba.system.settings import Address
from robocorba.system.supervision.launch import module_command
from testkit.json_process import Process
from testkit.missions import MissionSystem, saved
from testkit.namespaces import Namespace, start_router
from testkit.processes import Launcher, Running, drain, eventually, real_system
from testkit.report import Mark, at_least, at_most, summarize

NAME = "missions_network"
HERE, THERE = "192.168.0.2", "192.168.8.2"
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

    def cut(self, is_cut: bool = True) -> None:
        """Cut the link between the networks, or heal it."""
        self._router.ask({"is_cut": is_cut})

    @contextlib.contextmanager
    def flood(self) -> Iterator[None]:
        """A camera publishes events in lab, and a consumer in lab receives them."""
        frame, received = os.urandom(FLOOD_BYTES), itertools.count(1)

        def receive(_: object) -> None:
            self._received = next(received)

        def publish() -> None:
            camera.push("camera.frame", frame)
            self._published += 1

        with EventClient(self.place.orb, "lab", "camera") as camera, EventClient(self.place.orb, "lab") as viewer:
            viewer.subscribe(receive, "camera.*")
            with contextlib.closing(Repeating("camera", publish, FLOOD_S).start()):
                yield

    def crossed(self) -> Crossed:
        counts = self._router.ask({})
        forth, back = (self._passed_on(channel, peer) for channel, peer in (("lab", "hall"), ("hall", "lab")))
        return Crossed(counts["bytes"], forth, back, self._published, self._received)

    def watched(self) -> Crossed:
        """What crosses in WATCH_S."""
        before = self.crossed()
        time.sleep(WATCH_S)
        return self.crossed().since(before)

    def _passed_on(self, channel: str, peer: str) -> int:
        """Number of events that `peer` has received from `channel`."""
        (link,) = [
            link
            for link in _links(self.place.orb, peer)
            if (link.peer, link.direction) == (channel, RoboCorba.INCOMING)
        ]
        return int(link.events.received)


@contextlib.contextmanager
def two_networks(folder: Path, delay_ms: float, plan: Path | Building) -> Iterator[TwoNetworks]:
    """Two namespaces with a running system on a building; this process enters lab. Raises NotMeasured if namespaces are
    not permitted."""
    with contextlib.ExitStack() as stack:
        try:
            lab, hall = (stack.enter_context(Namespace()) for _ in range(2))
        except OSError as error:
            raise NotMeasured(f"network namespaces are not available ({error}); run it as root") from None
        devices = {address: host.add_tun(address) for host, address in ((lab, HERE), (hall, THERE))}
        router = stack.enter_context(start_router(devices, folder))
        router.ask({"delay_us": 1000 * delay_ms})
        lab.enter()
        port = stack.enter_context(claimed_ports())
        launch = stack.enter_context(Launcher(folder))
        naming = Address(HERE, port)
        building = ("--host", HERE, "--building", str(saved(plan, folder)), "--subnets", "lab")
        up = real_system(launch, folder / "state", port, *building).wait_ready()
        drain(up.process)
        channel = (*module_command("robocorba.servers.event_channel"), "--name", "hall", "--peer", "lab")
        where = ("--endpoint", f"{THERE}:{port}", "--naming", str(naming), "--state", str(folder / "hall"))
        stack.enter_context(Process((*hall.command(*channel), *where), folder / "hall.log"))
        orb = stack.enter_context(Orb(naming, call_timeout_s=5.0))
        eventually(lambda: _is_linked(orb), START_LIMIT_S, "the link between the channels")
        place = MissionSystem(folder, Running(up.process, folder / "state", naming), orb, launch)
        with place:
            yield TwoNetworks(place, hall.command(), router)


def _links(orb: Orb, channel: str) -> list[Any]:
    return list(orb.resolve(f"{CHANNELS}/{channel}", RoboCorba.EventChannel, call_timeout_s=5.0).state().links)


def _is_linked(orb: Orb) -> bool:
    if set(orb.names(CHANNELS)) != {"lab", "hall"}:
        return False
    links = [link for name in ("lab", "hall") for link in _links(orb, name)]
    return len(links) == 4 and all(link.condition == RoboCorba.UP for link in links)


def crossing_marks(
    quiet: Crossed, flooded: Crossed, missions: Sequence[Crossed], carried: Sequence[Carried]
) -> list[Mark]:
    flood_bytes = flooded.published * FLOOD_BYTES
    unwanted = []
    for over, one in zip(missions, carried, strict=True):  # by the messages from hall's channel in the leader's report
        received = sum(event["origin"] == "hall" for event in one.report["events"])
        unwanted.append(abs(over.back - received) / max(1, received))
    return [
        at_least(
            "share of the flood received in its own sub-network", flooded.received / max(1, flooded.published), 0.9
        ),
        at_most("events that crossed during the flood without a mission", flooded.forth + flooded.back, 0),
        at_most(
            "additional bytes on the link, as a share of the flood",
            max(0, flooded.bytes - quiet.bytes) / flood_bytes,
            CROSSING_SHARE,
        ),
        at_most("share of events from hall to lab that were not for the leader", max(unwanted), 0.02),
        at_most("error of the clock estimates, ms", max(map(clock_error_ms, carried)), SKEW_MS),
    ]


def clock_error_ms(one: Carried) -> float:
    """Largest error of a robot's estimate of the leader's clock [ms]; all processes share one clock."""
    return max((abs(clock["offset_ms"]) for clock in one.report["clocks"].values()), default=math.nan)


def main(seeds: int = 1, delay: float = 5.0) -> bool:
    with folder_of_bench() as folder, contextlib.ExitStack() as stack:
        both = stack.enter_context(two_networks(folder, delay, sample_path(BUILDING)))
        place = both.place
        place.start({name: at._replace(within=both.within) if name == "C" else at for name, at in CREW.items()})
        time.sleep(WATCH_S)
        quiet = both.watched()
        with both.flood():
            time.sleep(1.0)
            flooded = both.watched()
            carried = list(carries(place, range(1, seeds + 1), both.crossed))
    crossed = [one.after.since(one.before) for one in carried]
    rows = [_row(*each) for each in zip(carried, crossed, strict=True)]
    print(json.dumps({"quiet": quiet._asdict(), "flooded": flooded._asdict()}))
    title = f"the paper's scene over links of {delay:g} ms one way, {len(carried)} missions"
    reached = [*marks(carried), *crossing_marks(quiet, flooded, crossed, carried)]
    return summarize(NAME, title, rows, reached, draw(carried))


def _row(one: Carried, over: Crossed) -> dict[str, Any]:
    seconds = one.row["seconds"]
    return {
        **one.row,
        "lab to hall, events": over.forth,
        "hall to lab": over.back,
        "flood": over.published,
        "link, kB/s": over.bytes / (seconds if math.isfinite(seconds) else 1.0) / 1e3,
        "clocks, ms": clock_error_ms(one),
    }


if __name__ == "__main__":
    run(main, delay="one-way delay [ms]")
