"""omniEvents' channel and two of ours in one federation, all real processes."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import CosEventComm__POA
import pytest
from omniORB import CORBA, tcInternal

from robocorba.corba.event_client import EventClient
from robocorba.corba.orb import Orb
from robocorba.settings import Address
from robocorba.stubs import RoboCorba
from robocorba.supervision.launch import module_command
from robocorba.supervision.system import naming_service_command
from robocorba.testing.processes import eventually
from tests.waits import stays

OMNIEVENTS, EVENTC = shutil.which("omniEvents", path="/usr/sbin:/usr/local/sbin:/usr/bin"), shutil.which("eventc")
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.skipif(not (OMNIEVENTS and EVENTC), reason="omniEvents is not installed"),
]


class Collector(CosEventComm__POA.PushConsumer):
    """A plain consumer: what it got, strings as they are, events with a header as type and origin."""

    def __init__(self) -> None:
        self.got: list[Any] = []

    def push(self, value: Any) -> None:
        content = value.value()
        is_event = isinstance(content, RoboCorba.Event)
        self.got.append((content.header.type, content.header.origin) if is_event else content)

    def disconnect_push_consumer(self) -> None:
        pass


class Client:
    """A plain supplier and a plain consumer of one channel."""

    def __init__(self, orb: Orb, channel: Any) -> None:
        self._collector = Collector()
        channel.for_consumers().obtain_push_supplier().connect_push_consumer(orb.activate(self._collector))
        self._proxy = channel.for_suppliers().obtain_push_consumer()
        self._proxy.connect_push_supplier(None)

    def say(self, text: str) -> None:
        self.push(CORBA.Any(CORBA.TC_string, text))

    def push(self, value: Any) -> None:
        self._proxy.push(value)

    def got(self) -> list[Any]:
        return sorted(self._collector.got, key=str)


class Place:
    """What the test needs of the processes: the client's ORB, and omniEvents to be killed and started again."""

    def __init__(self, launch: Callable[..., subprocess.Popen[str]], folder: Path, port: int, client: Orb) -> None:
        self.orb, self.port = client, port
        self.foreign_uri = f"corbaloc::127.0.0.1:{port + 5}/foreign"
        self._launch, self._folder = launch, folder
        naming = ("-ORBInitRef", f"NameService=corbaloc::127.0.0.1:{port}/NameService")
        self._naming = naming
        launch(*naming_service_command(Address("127.0.0.1", port), folder))
        (folder / "foreign").mkdir()
        self.omnievents = self.start_omnievents()
        factory = f"corbaloc::127.0.0.1:{port + 5}/omniEvents"
        command = (str(EVENTC), "-n", "foreign", "-i", "foreign", "-c", "1000", *naming, factory)
        eventually(lambda: subprocess.run(command, capture_output=True, timeout=10).returncode == 0, what="eventc")

    def start_omnievents(self) -> subprocess.Popen[str]:
        state = self._folder / "foreign"
        where = ("-p", str(self.port + 5), "-l", str(state), "-t", str(state / "trace"))
        return self._launch(str(OMNIEVENTS), "-f", *where, *self._naming)

    def start_channel(self, name: str, offset: int, *more: str) -> None:
        addresses = ("--endpoint", f"127.0.0.1:{self.port + offset}", "--naming", f"127.0.0.1:{self.port}")
        state = ("--state", str(self._folder / "state"))
        self._launch(*module_command("robocorba.servers.event_channel"), *state, *addresses, "--name", name, *more)

    def channel(self, name: str) -> Any:
        return self.orb.resolve(f"EventChannels/{name}", RoboCorba.EventChannel)

    def links(self, name: str) -> list[Any]:
        return [link for link in self.channel(name).state().links if link.peer == "foreign"]

    def is_linked(self) -> bool:
        return all(link.condition == RoboCorba.UP for link in self.channel("lab").state().links)


@pytest.fixture
def place(
    launch: Callable[..., subprocess.Popen[str]], tmp_path: Path, naming_port: int, client: Orb
) -> Iterator[Place]:
    place = Place(launch, tmp_path, naming_port, client)
    place.start_channel("lab", 1, "--foreign", f"foreign={place.foreign_uri}")
    place.start_channel("hall", 2, "--peer", "lab")
    yield place


def test_ours_and_omnievents_are_one_federation(place: Place) -> None:
    lab, hall = place.channel("lab"), place.channel("hall")
    foreign = place.orb.reference(place.foreign_uri, CosEventChannelAdmin.EventChannel)
    clients = {"foreign": Client(place.orb, foreign), "lab": Client(place.orb, lab), "hall": Client(place.orb, hall)}

    def all_got(expected: list[Any]) -> None:
        for name, client in clients.items():
            eventually(lambda client=client: len(client.got()) >= len(expected), what=f"events at {name}")
        stays(lambda: all(client.got() == sorted(expected, key=str) for client in clients.values()), 0.3)

    eventually(place.is_linked, what="all links")
    with EventClient(place.orb, "hall", "C") as observer:
        everything = observer.subscribe(lambda event: None)
        assert everything.wait_in_force("lab")

        said: list[Any] = []
        for round_ in range(3):
            for name, client in clients.items():
                client.say(f"{name} {round_}")
                said.append(f"{name} {round_}")
        all_got(said)

        # The same content from both sides: each is an event of its own.
        for _ in range(2):
            clients["foreign"].say("same")
            clients["lab"].say("same")
            said += ["same", "same"]
        all_got(said)

        observer.push("robot.state", {"x": 1.0})
        said.append(("robot.state", "hall"))
        all_got(said)

    incoming, outgoing = place.links("lab")
    assert incoming.repeated == outgoing.events.delivered  # omniEvents gave back all that it was given
    assert incoming.events.delivered == 5  # 3 and twice "same" began there


def test_a_foreign_channel_that_was_killed_is_joined_again(place: Place) -> None:
    eventually(place.is_linked, what="all links")
    lab = Client(place.orb, place.channel("lab"))
    lab.say("before")
    eventually(lambda: place.links("lab")[1].events.delivered == 1, what="delivery to omniEvents")

    place.omnievents.send_signal(signal.SIGKILL)
    place.omnievents.wait()
    for round_ in range(3):
        lab.say(f"away {round_}")
    eventually(lambda: all(link.condition != RoboCorba.UP for link in place.links("lab")), what="the end of the link")
    place.start_omnievents()
    eventually(place.is_linked, 60.0, what="the link again")

    def is_all_accounted_for() -> bool:
        events = place.links("lab")[1].events
        return (events.received, events.delivered, events.queued) == (4, 4, 0)

    eventually(is_all_accounted_for, what="delivery of what waited")
    outgoing = place.links("lab")[1]
    assert outgoing.events.unconfirmed <= 2  # one for each connection that died with omniEvents
    assert outgoing.reconnects >= 1
    foreign = Client(place.orb, place.orb.reference(place.foreign_uri, CosEventChannelAdmin.EventChannel))
    foreign.say("after")
    eventually(lambda: "after" in lab.got(), what="an event from the foreign channel")
    stays(lambda: lab.got().count("after") == 1, 0.3)


def test_an_event_that_is_refused_does_not_end_the_link(place: Place) -> None:
    """omniEvents disconnects a consumer that refuses an event."""
    eventually(place.is_linked, what="all links")
    lab = Client(place.orb, place.channel("lab"))
    foreign = Client(place.orb, place.orb.reference(place.foreign_uri, CosEventChannelAdmin.EventChannel))
    descriptor = CORBA.TC_string._d
    for _ in range(80):  # deeper than our end accepts
        descriptor = (tcInternal.tv_sequence, descriptor, 0)
    foreign.push(CORBA.Any(tcInternal.createTypeCode(descriptor), []))
    eventually(lambda: place.links("lab")[0].reconnects == 1, what="another connection")
    eventually(place.is_linked, what="all links")
    foreign = Client(place.orb, place.orb.reference(place.foreign_uri, CosEventChannelAdmin.EventChannel))
    foreign.say("after")
    lab.say("back")
    for client in (lab, foreign):
        eventually(lambda client=client: {"after", "back"} <= set(client.got()), what="both events")


def test_a_foreign_channel_can_be_added_and_removed(place: Place) -> None:
    lab = place.channel("lab")
    lab.removePeer("foreign")
    assert "foreign" not in [peer.name for peer in lab.peers()]
    with pytest.raises(RoboCorba.InvalidPeer) as refused:
        lab.addPeer(RoboCorba.PeerAddress("foreign", "", True))
    assert refused.value.field == "address"
    lab.addPeer(RoboCorba.PeerAddress("foreign", "corbaloc::127.0.0.1:1/nobody", True))
    eventually(lambda: "ConnectFailed" in place.links("lab")[0].problem, what="a problem that is told")
    lab.addPeer(RoboCorba.PeerAddress("foreign", place.foreign_uri, True))
    eventually(place.is_linked, what="the link at its new address")
