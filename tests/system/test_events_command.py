"""robocorba events against two linked channels of a running system."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from omniORB import CORBA

from robocorba.errors.events import OutdatedChannel
from robocorba.events.corba.event_client import Event, EventClient
from robocorba.events.corba.remote_channel import RemoteChannel
from robocorba.orb.orb import Orb
from robocorba.system.supervision.launch import module_command
from testkit.processes import ROBOCORBA, Running, eventually, running_system

pytestmark = [pytest.mark.system, pytest.mark.slow(70), pytest.mark.full]

ROOT = Path(__file__).resolve().parents[2]
Launch = Events = Callable[..., subprocess.Popen[str]]


@pytest.fixture(scope="module")
def federation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A system with the channels lab and hall."""
    with running_system(tmp_path_factory.mktemp("federation"), "--subnets", "lab,hall") as (running, _):
        yield running


@pytest.fixture
def events(launch: Launch, federation: Running) -> Events:
    """Starts `robocorba events` with arguments."""
    return lambda *arguments: launch(ROBOCORBA, "events", *arguments, ROBOCORBA_NAMING=str(federation.naming))


def done(process: subprocess.Popen[str]) -> str:
    """What a command printed that had nothing to complain about."""
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    return out


def state(events: Events, channel: str) -> Any:
    return json.loads(done(events("stats", channel, "--json")))[channel]


def consumers(events: Events, channel: str) -> list[Any]:
    """Those that are connected; the simulation server is a supplier of the first channel."""
    return [proxy for proxy in state(events, channel)["proxies"] if proxy["kind"] == "PUSH_SUPPLIER"]


def is_linked(events: Events, channel: str) -> bool:
    links = state(events, channel)["links"]
    return len(links) == 2 and all(link["condition"] == "UP" for link in links)


def wait_wanted(events: Events, type: str, source: str) -> None:
    """Until it is known at lab that hall wants this."""

    def is_wanted() -> bool:
        links = state(events, "lab")["links"]
        return any({"type": type, "source": source} in link["interest"] for link in links)

    eventually(is_wanted, what="the interest of hall")


def test_what_is_said_in_one_channel_is_heard_in_the_other(events: Events) -> None:
    eventually(lambda: is_linked(events, "lab"), what="the link")
    assert ["lab", "from hall", "up"] in [line.split("\t")[:3] for line in done(events("stats")).splitlines()]
    listener = events("tail", "hall", "--type", "robot.*", "--source", "A", "--count", "2")
    wait_wanted(events, "robot.*", "A")
    (proxy,) = consumers(events, "hall")
    assert proxy["condition"] == "CONNECTED" and proxy["client"]

    done(events("push", "lab", "robot.state", '{"x": 1}', "--source", "A"))
    done(events("push", "lab", "robot.state", "0", "--source", "B"))
    done(events("push", "hall", "alarm", "0", "--source", "A"))
    done(events("push", "lab", "robot.alarm", '["\\u001b[2J"]', "--source", "A", "--priority", "3"))
    first, second = done(listener).splitlines()
    assert first.endswith('  robot.state  A  {"x": 1}') and "  lab:" in first
    assert second.endswith('  robot.alarm  A  priority 3  ["\\u001b[2J"]')

    for channel in ("lab", "hall"):
        assert consumers(events, channel) == []
    into_hall, _ = state(events, "hall")["links"]
    assert into_hall["events"]["delivered"] == 2
    assert into_hall["bytes"] > 0


@pytest.mark.parametrize("number", [signal.SIGINT, None])
def test_tail_ends_and_leaves_nothing(events: Events, number: signal.Signals | None) -> None:
    """By a signal, or when nobody reads it any more."""
    listener = events("tail", "lab", "--json")
    eventually(lambda: len(consumers(events, "lab")) == 1, what="the consumer")
    done(events("push", "lab", "x", "[1, 2]"))
    assert listener.stdout is not None and listener.stderr is not None
    said = json.loads(listener.stdout.readline())
    assert (said["type"], said["payload"], said["origin"]) == ("x", [1, 2], "lab")
    if number:
        listener.send_signal(number)
        assert done(listener) == ""
    else:
        listener.stdout.close()
        done(events("push", "lab", "x", "1"))
        listener.wait(60.0)
        assert listener.stderr.read() == ""
    assert consumers(events, "lab") == []


def test_links_end_and_begin(events: Events) -> None:
    done(events("peer", "remove", "lab", "hall"))
    assert state(events, "lab")["links"] == []
    eventually(lambda: state(events, "hall")["links"] == [], what="the end of the link at hall")
    done(events("peer", "add", "hall", "lab"))
    # lab has removed hall, and takes it back only when it is told so itself.
    eventually(lambda: "removed" in state(events, "hall")["links"][0]["problem"], what="the refusal")
    done(events("peer", "add", "lab", "hall"))
    eventually(lambda: is_linked(events, "lab") and is_linked(events, "hall"), what="the link again")


#: By the name of an example: the type of the events that its consumer is interested in.
CLIENTS = {"events": "robot.*", "plain_events": "*"}


@pytest.mark.parametrize("client", CLIENTS)
def test_the_example_clients(launch: Launch, federation: Running, events: Events, client: str) -> None:
    plain = (str(federation.naming), "-ORBendPoint", "giop:tcp:127.0.0.1:") if client == "plain_events" else ()
    environment = {"PYTHONPATH": str(ROOT), "ROBOCORBA_NAMING": str(federation.naming)}
    program = module_command(f"robocorba.clients.{client}")

    consumer = launch(*program, "consume", "hall", "3", *plain, **environment)
    assert consumer.stdout is not None
    assert consumer.stdout.readline() == "waiting\n"
    wait_wanted(events, CLIENTS[client], "*")
    done(launch(*program, "publish", "lab", "3", *plain, **environment))
    lines = done(consumer).splitlines()
    assert len(lines) == 3
    assert all(str(number) in line for number, line in enumerate(lines))
    assert consumers(events, "hall") == []


@pytest.fixture
def lab(federation: Running) -> Iterator[EventClient]:
    with Orb(federation.naming) as orb, EventClient(orb, "lab", "A", timeout_s=30.0) as client:
        yield client


def test_advice_compares_the_federation_with_other_layouts(events: Events, lab: EventClient) -> None:
    eventually(lambda: is_linked(events, "lab"), what="the link")
    assert done(events("advise", "--seconds", "0.2")).startswith("too few events to judge: ")
    received, pause = list[Event](), threading.Event()
    lab.subscribe(received.append, "local")
    advising = events("advise", "--seconds", "5", "--json")
    while advising.poll() is None:
        lab.push_many("local", range(20))
        pause.wait(0.02)
    advice = json.loads(done(advising))
    layouts = {one["layout"]: one for one in advice["layouts"]}
    now = layouts["the federation as it is"]
    assert set(layouts) == {"the federation as it is", "one central channel in hall", "one central channel in lab"}
    assert advice["verdict"] in ("keep", "as good")  # all deliveries are local
    # The simulation server publishes at lab, too, and nobody receives it.
    assert now["messages"] == 0.0 < layouts["one central channel in lab"]["latency_s"]
    assert 1.0 < layouts["one central channel in hall"]["messages"] <= 2.0
    assert 0.0 < now["latency_s"] <= layouts["one central channel in hall"]["latency_s"]


def test_a_channel_of_the_first_release_is_named() -> None:
    class OldChannel:
        def resolve(self, *_: object) -> OldChannel:
            return self

        def traffic(self) -> None:
            raise CORBA.BAD_OPERATION

    with pytest.raises(OutdatedChannel, match="channel lab runs release"):
        RemoteChannel(cast(Orb, OldChannel()), "lab").traffic()
