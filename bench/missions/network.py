"""The paper's scene over a network: sub-networks lab and hall are separate hosts with a delay of 5 ms between them.

    python -m bench.missions.network [--seeds 1] [--delay 5]

All servers, the channel of lab and robots A and B run in one network namespace, the channel of hall and robot C in
another. A router process between them delays each packet. The marks are those of bench/missions/carry.py. Only events
with a subscriber on the other side may cross: a camera floods the channel of lab, which has a consumer for its events,
and the events are counted that the gateways pass on. It must run as root; without network namespaces it prints so and
measures nothing."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.common.harness import NotMeasured, folder_of_bench, run
from bench.missions.carry import BUILDING, CREW, SKEW_MS, Carried, carries, report
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
from testkit.report import at_least, at_most

HERE, THERE = "192.168.0.2", "192.168.8.2"
#: Size [bytes] and interval [s] of the flood's events.
FLOOD_BYTES, FLOOD_S = 4000, 0.02
#: Duration of a measurement without a mission [s].
WATCH_S = 5.0
START_LIMIT_S = 60.0


class TwoNetworks:
    """place: in lab, like this process. within: command prefix that starts C in hall."""

    def __init__(self, place: MissionSystem, within: tuple[str, ...], router: Process) -> None:
        self.place, self.within, self._router = place, within, router

    def cut(self, is_cut: bool = True) -> None:
        """Cut the link between the networks, or heal it."""
        self._router.ask({"is_cut": is_cut})

    @contextlib.contextmanager
    def flood(self) -> Iterator[tuple[list[object], list[object]]]:
        """A camera publishes events in lab, and a consumer in lab receives them: those sent and received so far."""
        frame, sent, received = bytes(FLOOD_BYTES), list[object](), list[object]()

        def publish() -> None:
            camera.push("camera.frame", frame)
            sent.append(None)

        with EventClient(self.place.orb, "lab", "camera") as camera, EventClient(self.place.orb, "lab") as viewer:
            viewer.subscribe(received.append, "camera.*")
            with contextlib.closing(Repeating("camera", publish, FLOOD_S).start()):
                yield sent, received

    def crossed(self) -> int:
        """Number of events that the gateways have received so far."""
        links = (link for name in ("lab", "hall") for link in _links(self.place.orb, name))
        return sum(link.events.received for link in links if link.direction == RoboCorba.INCOMING)


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


def clock_error_ms(one: Carried) -> float:
    """Largest error of a robot's estimate of the leader's clock [ms]; all processes share one clock."""
    return max((abs(clock["offset_ms"]) for clock in one.report["clocks"].values()), default=math.nan)


def main(seeds: int = 1, delay: float = 5.0) -> bool:
    with folder_of_bench() as folder, two_networks(folder, delay, sample_path(BUILDING)) as both:
        place = both.place
        place.start({name: at._replace(within=both.within) if name == "C" else at for name, at in CREW.items()})
        time.sleep(WATCH_S)
        with both.flood() as (sent, received):
            before = both.crossed()
            time.sleep(WATCH_S)
            crossed, share = both.crossed() - before, len(received) / len(sent)
            carried = list(carries(place, range(1, seeds + 1)))
    more = [
        at_least("share of the flood received in its own sub-network", share, 0.9),
        at_most("events that crossed during the flood without a mission", crossed, 0),
        at_most("error of the clock estimates, ms", max(map(clock_error_ms, carried)), SKEW_MS),
    ]
    title = f"the paper's scene over links of {delay:g} ms one way, {len(carried)} missions"
    return report("missions_network", title, carried, more)


if __name__ == "__main__":
    run(main, delay="one-way delay [ms]")
