"""Consumers to which nobody can connect: the channel calls them over their own connection."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen

import pytest

from robocorba.corba.event_client import EventClient
from robocorba.errors.events import Unconfirmed
from robocorba.errors.services import NotReachable
from robocorba.stubs import RoboCorba
from robocorba.testing.processes import ROBOCORBA, eventually, refusal
from tests.system.event_place import Place, open_place

pytestmark = [pytest.mark.system, pytest.mark.full]

SERVER = "robocorba.servers.event_channel"
#: Nothing listens there: the consumer's reference leads nowhere.
NOWHERE = "giop:tcp:127.0.0.1:1"


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with open_place(tmp_path) as place:
        yield place


def tail(place: Place, *more: str) -> Popen[str]:
    naming = f"127.0.0.1:{place.port}"
    command = (ROBOCORBA, "events", "tail", "lab", "--behind-nat", "--type", "t", "--json", "--naming", naming)
    return place.launch(*command, *more, ORBendPointPublish=NOWHERE)


def is_pushed(events: EventClient) -> bool:
    try:
        events.push("t", 2)
    except (NotReachable, Unconfirmed):
        return False
    return True


def test_a_consumer_behind_nat_receives_events_before_and_after_a_restart_of_the_channel(place: Place) -> None:
    channel = place.start("lab", SERVER, "--bidirectional")
    consumer = tail(place)
    assert consumer.stdout is not None
    with EventClient(place.orb, "lab") as events:
        kinds = [RoboCorba.PUSH_SUPPLIER]
        eventually(lambda: [proxy.kind for proxy in events.channel.state().proxies] == kinds, 30.0, "the subscription")
        events.push("t", 1)
        assert json.loads(consumer.stdout.readline())["payload"] == 1
        channel.kill()
        channel.wait(60.0)
        place.start("lab", SERVER, "--bidirectional")
        eventually(lambda: is_pushed(events), 30.0, "pushed")  # connections of before may still fail
        received = json.loads(consumer.stdout.readline())  # the client finds its way back within some seconds
        assert received["payload"] == 2


def test_a_channel_that_does_not_call_back_says_so(place: Place) -> None:
    place.start("lab")
    assert "robocorba up --bidirectional" in refusal(tail(place), 60.0)
