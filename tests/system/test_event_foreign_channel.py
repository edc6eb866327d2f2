"""omniEvents' channel and two of ours in one federation."""

from __future__ import annotations

import contextlib
import shutil
import signal
import subprocess
from collections.abc import Iterator
from typing import Any

import CosEventChannelAdmin
import pytest
from omniORB import CORBA, tcInternal

from robocorba.events.corba.event_client import EventClient
from robocorba.stubs import RoboCorba
from testkit.processes import eventually
from tests.system.event_place import Place, PushConsumer, open_place, text
from tests.waits import stays

EVENTC = shutil.which("eventc")
OMNIEVENTS = shutil.which("omniEvents", path="/usr/sbin:/usr/local/sbin:/usr/bin")
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.skipif(not (OMNIEVENTS and EVENTC), reason="omniEvents is not installed"),
]


class OmniEvents:
    """A process of omniEvents with the channel `foreign`, beside our channels."""

    def __init__(self, place: Place) -> None:
        self.place, self._port, self._folder = place, place.port + 9, place.folder / "foreign"
        self._folder.mkdir()
        self.uri = f"corbaloc::127.0.0.1:{self._port}/foreign"
        self.start()
        make = ("-n", "foreign", "-i", "foreign", "-c", "1000", f"corbaloc::127.0.0.1:{self._port}/omniEvents")
        command = [str(EVENTC), *self.naming(), *make]
        eventually(lambda: subprocess.run(command, capture_output=True, timeout=60).returncode == 0, what="eventc")

    def start(self) -> None:
        where = ("-p", str(self._port), "-l", str(self._folder), "-t", str(self._folder / "trace"))
        self.process = self.place.launch(str(OMNIEVENTS), "-f", *where, *self.naming())

    def naming(self) -> tuple[str, str]:
        return "-ORBInitRef", f"NameService=corbaloc::127.0.0.1:{self.place.port}/NameService"

    def channel(self) -> Any:
        """Connections of before a kill fail once."""
        found = self.place.orb.reference(self.uri, CosEventChannelAdmin.EventChannel)

        def answers() -> bool:
            with contextlib.suppress(CORBA.COMM_FAILURE, CORBA.TRANSIENT):
                return not found._non_existent()
            return False

        eventually(answers, what="the foreign channel")
        return found

    def link(self) -> tuple[Any, Any]:
        """The states of the link with lab, into this and out of it."""
        incoming, outgoing = (link for link in self.place.channel("lab").state().links if link.peer == "foreign")
        return incoming, outgoing

    def wait_linked(self) -> None:
        def is_linked() -> bool:
            return all(link.condition == RoboCorba.UP for link in self.place.channel("lab").state().links)

        eventually(is_linked, what="all links")


class Client:
    """A plain supplier and a plain consumer of one channel, which gets events with a header as type and origin."""

    def __init__(self, place: Place, channel: Any) -> None:
        self._got: list[Any] = []
        place.push_to(PushConsumer(take=self._take), channel)
        self.push = place.supplier(channel).push

    def _take(self, value: Any) -> None:
        content = value.value()
        is_event = isinstance(content, RoboCorba.Event)
        self._got.append((content.header.type, content.header.origin) if is_event else content)

    def say(self, said: str) -> None:
        self.push(text(said))

    def got(self) -> list[Any]:
        return sorted(self._got, key=str)


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OmniEvents]:
    """Beside it, lab and hall are linked."""
    with open_place(tmp_path_factory.mktemp("foreign")) as place:
        foreign = OmniEvents(place)
        place.begin("lab", "--foreign", f"foreign={foreign.uri}")
        place.begin("hall", "--peer", "lab")
        yield foreign


@pytest.fixture
def linked(foreign: OmniEvents) -> Iterator[OmniEvents]:
    """With a new link between it and lab."""
    foreign.wait_linked()
    lab = foreign.place.channel("lab")
    yield foreign
    lab.removePeer("foreign")
    assert "foreign" not in [peer.name for peer in lab.peers()]
    lab.addPeer(RoboCorba.PeerAddress("foreign", foreign.uri, True))


def test_ours_and_omnievents_are_one_federation(linked: OmniEvents) -> None:
    place = linked.place
    channels = {"foreign": linked.channel(), "lab": place.channel("lab"), "hall": place.channel("hall")}
    clients = {name: Client(place, channel) for name, channel in channels.items()}

    def all_got(expected: list[Any]) -> None:
        for name, client in clients.items():
            eventually(lambda client=client: len(client.got()) >= len(expected), what=f"events at {name}")
        stays(lambda: all(client.got() == sorted(expected, key=str) for client in clients.values()), 0.3)

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

    def is_all_given_back() -> bool:
        incoming, outgoing = linked.link()
        assert incoming.events.delivered == 5  # 3 and twice "same" began there
        return bool(incoming.repeated == outgoing.events.delivered)

    eventually(is_all_given_back, what="all that omniEvents was given")


def test_a_foreign_channel_that_was_killed_is_joined_again(linked: OmniEvents) -> None:
    lab = Client(linked.place, linked.place.channel("lab"))
    lab.say("before")
    eventually(lambda: linked.link()[1].events.delivered == 1, what="delivery to omniEvents")

    linked.process.send_signal(signal.SIGKILL)
    linked.process.wait()
    for round_ in range(3):
        lab.say(f"away {round_}")
    eventually(lambda: all(end.condition != RoboCorba.UP for end in linked.link()), what="the end of the link")
    linked.start()
    linked.wait_linked()

    def is_all_accounted_for() -> bool:
        events = linked.link()[1].events
        return (events.received, events.delivered, events.queued) == (4, 4, 0)

    eventually(is_all_accounted_for, what="delivery of what waited")
    outgoing = linked.link()[1]
    assert outgoing.events.unconfirmed <= 2  # one for each connection that died with omniEvents
    assert outgoing.reconnects >= 1
    linked.place.supplier(linked.channel()).push(text("after"))
    eventually(lambda: "after" in lab.got(), what="an event from the foreign channel")
    stays(lambda: lab.got().count("after") == 1, 0.3)


def test_an_event_that_is_refused_does_not_end_the_link(linked: OmniEvents) -> None:
    """omniEvents disconnects a consumer that refuses an event."""
    lab = Client(linked.place, linked.place.channel("lab"))
    descriptor = CORBA.TC_string._d
    for _ in range(80):  # deeper than our end accepts
        descriptor = (tcInternal.tv_sequence, descriptor, 0)
    linked.place.supplier(linked.channel()).push(CORBA.Any(tcInternal.createTypeCode(descriptor), []))
    eventually(lambda: linked.link()[0].reconnects == 1, what="another connection")
    linked.wait_linked()
    there = Client(linked.place, linked.channel())
    there.say("after")
    lab.say("back")
    for client in (lab, there):
        eventually(lambda client=client: {"after", "back"} <= set(client.got()), what="both events")
