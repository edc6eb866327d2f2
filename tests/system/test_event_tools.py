"""omniEvents' own commands at a channel of ours, and a channel of its beside it."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import CosEventChannelAdmin
import pytest

from robocorba.testing.processes import eventually
from tests.system.event_place import Place, PushConsumer, open_place, text

COMMANDS = {name: shutil.which(name) for name in ("eventc", "eventf", "events", "rmeventc")}
OMNIEVENTS = shutil.which("omniEvents", path="/usr/sbin:/usr/local/sbin:/usr/bin")
pytestmark = [
    pytest.mark.full,
    pytest.mark.system,
    pytest.mark.skipif(not (OMNIEVENTS and all(COMMANDS.values())), reason="omniEvents is not installed"),
]
NAME = "RoboCorba/EventChannels/lab"


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with open_place(tmp_path) as place:
        place.start("lab")
        yield place


def command(place: Place, name: str, *arguments: str) -> list[str]:
    naming = ("-ORBInitRef", f"NameService=corbaloc::127.0.0.1:{place.port}/NameService")
    return [str(COMMANDS[name]), *naming, *arguments]


def run(place: Place, name: str, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(command(place, name, *arguments), capture_output=True, timeout=20)


def consumer_of(place: Place, channel: Any) -> PushConsumer:
    consumer = PushConsumer()
    channel.for_consumers().obtain_push_supplier().connect_push_consumer(place.orb.activate(consumer))
    return consumer


def supplier_of(channel: Any) -> Any:
    proxy = channel.for_suppliers().obtain_push_consumer()
    proxy.connect_push_supplier(None)
    return proxy


def proxies(place: Place) -> int:
    return len(place.balanced_states("lab"))


def foreign_channel(place: Place) -> Any:
    """A channel of omniEvents, by the name `foreign`."""
    folder, port = place.launch.folder / "foreign", place.port + 9
    folder.mkdir()
    naming = ("-ORBInitRef", f"NameService=corbaloc::127.0.0.1:{place.port}/NameService")
    place.launch(str(OMNIEVENTS), "-f", "-p", str(port), "-l", str(folder), "-t", str(folder / "trace"), *naming)
    make = ("-n", "foreign", "-i", "foreign", "-c", "1000", f"corbaloc::127.0.0.1:{port}/omniEvents")
    eventually(lambda: run(place, "eventc", *make).returncode == 0, what="eventc")
    return place.orb.reference(f"corbaloc::127.0.0.1:{port}/foreign", CosEventChannelAdmin.EventChannel)


def test_events_records_and_plays_back(place: Place) -> None:
    channel, tape = place.channel("lab"), place.launch.folder / "tape"
    before = proxies(place)
    with tape.open("wb") as file, subprocess.Popen(command(place, "events", place.uri("lab")), stdout=file) as recorder:
        try:
            eventually(lambda: proxies(place) > before)
            supplier = supplier_of(channel)
            for number in range(5):
                supplier.push(text(f"said {number}"))
            eventually(lambda: tape.read_bytes().count(b"said ") == 5)
            eventually(lambda: all(state.events.queued == 0 for state in place.balanced_states("lab")))
        finally:
            recorder.send_signal(signal.SIGINT)
            recorder.wait(60.0)
    consumer = consumer_of(place, channel)
    with (
        tape.open("rb") as file,
        subprocess.Popen(command(place, "events", "-s", "-n", NAME), stdin=file, stdout=subprocess.DEVNULL) as player,
    ):
        try:
            # More than the first one it does not play back within seconds, to a channel of omniEvents neither.
            eventually(lambda: consumer.got[:1] == ["said 0"])
        finally:
            player.kill()


@pytest.mark.parametrize("from_ours", [True, False])
def test_eventf_joins_our_channel_and_one_of_omnievents(place: Place, from_ours: bool) -> None:
    ours, foreign = place.channel("lab"), foreign_channel(place)
    uris = [f"corbaname::127.0.0.1:{place.port}#{name}" for name in (NAME, "foreign")]
    joined = run(place, "eventf", *(uris if from_ours else reversed(uris)))
    assert joined.returncode == 0, joined.stderr
    start, end = (ours, foreign) if from_ours else (foreign, ours)
    consumer, supplier = consumer_of(place, end), supplier_of(start)
    for number in range(20):
        supplier.push(text(str(number)))
    eventually(lambda: consumer.got == [str(number) for number in range(20)])


def test_rmeventc_destroys_the_channel(place: Place) -> None:
    consumer = consumer_of(place, place.channel("lab"))
    removed = run(place, "rmeventc", "-n", NAME)
    assert removed.returncode == 0, removed.stderr
    eventually(lambda: consumer.disconnections == 1)
    assert place.channel("lab")._non_existent()
