"""robocorba up --subnets: an event channel for each sub-network, linked, taken away and brought back."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from omniORB import CORBA

from robocorba.orb.orb import Orb
from robocorba.stubs import RoboCorba, RoboCorba__POA
from robocorba.system.names import CHANNELS
from testkit.processes import ROBOCORBA, Launcher, Running, eventually, read_json

pytestmark = [pytest.mark.system, pytest.mark.slow(60), pytest.mark.full]

Start = Callable[..., Running]


def channel(orb: Orb, name: str) -> Any:
    return orb.resolve(f"{CHANNELS}/{name}", RoboCorba.EventChannel)


def are_linked(orb: Orb, names: Iterable[str]) -> bool:
    """Whether each of the channels has links with all of the others, and no more, and all are up both ways."""
    names = set(names)
    for name in names:
        try:
            links = channel(orb, name).state().links
        except (CORBA.TRANSIENT, CORBA.COMM_FAILURE):  # it is being started again
            return False
        if {link.peer for link in links} != names - {name} or any(link.condition != RoboCorba.UP for link in links):
            return False
    return True


def check_federation(running: Running, launch: Launcher, orb: Orb) -> None:
    """Three channels are there under their names, and linked."""
    names = ["hall", "lab", "yard"]
    assert orb.names(CHANNELS) == names
    assert orb.names("nothing/like/it") == []
    eventually(lambda: are_linked(orb, names), what="all links")
    status = launch(ROBOCORBA, "status", "--state", str(running.state), "--json")
    out, err = status.communicate(timeout=60)
    assert (status.returncode, err) == (0, "")
    objects = {process["name"]: process["objects"] for process in read_json(out)["processes"]}
    for name in names:
        pid, bound = running.pid(f"events_{name}"), f"RoboCorba/{CHANNELS}/{name}"
        assert f"events_{name}\t{pid}\tcorbaname::{running.naming}#{bound}" in running.printed
        assert channel(orb, name)._get_name() == name
        (found,) = objects[f"events_{name}"]
        assert found["name"] == bound
        assert found["answered_ms"] > 0
        assert (running.state / "logs" / f"events_{name}.log").is_file()
        assert (running.state / "channels" / f"{name}.sqlite").is_file()


def test_subnets_are_a_federation_and_go_and_come_back(robocorba_up: Start, launch: Launcher, client: Orb) -> None:
    running = robocorba_up("--subnets", "lab,hall,yard").wait_ready()
    check_federation(running, launch, client)
    endpoints = {process.name: process.endpoint for process in running.record().processes}
    channel(client, "lab").addPeer(RoboCorba.PeerAddress("elsewhere", "127.0.0.1:9", False))
    assert running.stop() == 0

    running = robocorba_up("--subnets", "lab").wait_ready()
    assert client.names(CHANNELS) == ["lab"]
    assert [peer.name for peer in channel(client, "lab").peers()] == ["elsewhere"]  # which somebody else linked
    servers = ["omniNames", "map_editor", "simulation", "sensor_s1", "events_lab"]
    assert [process.name for process in running.record().processes] == servers
    channel(client, "lab").removePeer("elsewhere")
    assert running.stop() == 0

    # hall last ran with yard, and must not look for it now.
    running = robocorba_up("--subnets", "hall,lab,roof").wait_ready()
    eventually(lambda: are_linked(client, ["hall", "lab", "roof"]), what="the links of those that are here now")
    kept = {process.name: process.endpoint for process in running.record().processes if process.name in endpoints}
    assert kept == {name: endpoint for name, endpoint in endpoints.items() if name != "events_yard"}
    names = [f"n{number:04}" for number in range(1200)]
    client.serve({f"many/{name}": RoboCorba__POA.PathPlanner() for name in names})
    eventually(lambda: len(client.names("many")) == len(names), what="all names bound")
    assert client.names("many") == names  # a long list comes whole
    assert running.stop() == 0
    assert running.left_behind() == []


def test_channels_and_robots_go_by_the_sub_networks_of_the_map(
    robocorba_up: Start, launch: Launcher, client: Orb
) -> None:
    scene = "paper-scene"
    running = robocorba_up("--building", scene).wait_ready()
    assert client.names(CHANNELS) == ["hall", "lab"]

    def robot(name: str, *options: str) -> tuple[str, str]:
        """The robot's channel, and what it says on stderr up to its end."""
        where = ("--naming", str(running.naming), "--state", str(running.state), "--floor", "L1")
        process = launch(ROBOCORBA, "robot", name, *where, *options)
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        agent = client.resolve(f"Robots/{name}", RoboCorba.RobotAgent)
        found = agent._get_channel()
        process.terminate()
        return found, process.communicate(timeout=60)[1]

    assert robot("A", "--at", "1.1,3.3") == ("lab", "")
    assert robot("C", "--at", "11.3,3.1") == ("hall", "")
    assert robot("D", "--at", "11.3,3.1", "--channel", "lab") == ("lab", "")
    found, said = robot("E", "--at", "1.1,3.3", "--channel=")
    assert (found, said.count("\n")) == ("", 1) and "it takes part in no mission" in said
    found, said = robot("F", "--at", "1.1,3.3", "--channel", "yard")
    assert (found, said.count("\n")) == ("yard", 1) and "no event channel; there are hall, lab" in said
    assert running.stop() == 0

    running = robocorba_up("--subnets", "lab").wait_ready()  # on the stored map
    found, said = robot("C", "--at", "11.3,3.1")
    assert found == "" and "hall has no event channel; there are lab" in said
    assert running.stop() == 0
    assert running.process.stderr is not None
    assert "without a channel: hall" in running.process.stderr.read()
