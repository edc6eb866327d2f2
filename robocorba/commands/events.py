"""robocorba events: inspect event channels, print their events, publish events.

The event client is imported where it is used, because it takes a while to load."""

from __future__ import annotations

import contextlib
import json as json_format
import queue
import signal
import threading
from collections.abc import Generator
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from robocorba.commands import event_advice, event_stats
from robocorba.commands.options import COMPLETIONS, ChannelName, Json, Naming, connected
from robocorba.commands.tables import Sheet, print_json, show
from robocorba.commands.waiting import StopSignal, progress
from robocorba.errors.base import RoboCorbaError
from robocorba.errors.events import InvalidEvent, TooFewEvents
from robocorba.errors.services import NotReachable
from robocorba.events.corba.remote_channel import RemoteChannel
from robocorba.events.queue import QueuePolicy
from robocorba.orb.orb import OFFER_CALLBACKS, Orb
from robocorba.system.logs import one_line
from robocorba.system.names import CHANNELS
from robocorba.system.printing import echo

if TYPE_CHECKING:
    from robocorba.events.corba.event_client import Event, EventClient

#: Timeout to resolve a channel [s].
RESOLVE_TIMEOUT_S = 3.0
#: Time without events after which `tail` checks that it is still connected [s].
CHECK_INTERVAL_S = 2.0
#: Maximum number of events that wait in `tail`, and in the channel for it.
MAX_WAITING, MAX_QUEUED = 1000, 100_000
#: How much of a payload is shown: characters, bytes, levels of nesting.
MAX_CHARACTERS, MAX_BYTES, MAX_LEVELS = 300, 16, 20

app = typer.Typer(no_args_is_help=True)
peer_app = typer.Typer(help="Link channels and remove links.", no_args_is_help=True)
app.add_typer(peer_app, name="peer")

_ChannelNames = Annotated[
    list[str] | None,
    typer.Argument(metavar="[CHANNEL]...", help="Default: all.", autocompletion=COMPLETIONS["channel"]),
]
_Peer = Annotated[str, typer.Argument(metavar="PEER", help="Name of the other channel.")]


@app.command()
def stats(
    channels: _ChannelNames = None,
    json: Json = False,
    naming: Naming = None,
) -> None:
    """Show proxies, links and event counts of channels. Exit code 0 if all answer, else 1."""
    with connected("events stats", naming) as orb:
        states = event_stats.query(orb, channels or _channels(orb))
    if json:
        print_json({name: event_stats.as_json(state) for name, state in states.items()})
    else:
        show(*event_stats.sheets(states))
    if any(isinstance(state, str) for state in states.values()):
        raise typer.Exit(1)


@app.command()
def advise(
    channels: _ChannelNames = None,
    seconds: Annotated[float, typer.Option(metavar="S", min=0.1, max=3600.0, help="Measure for S seconds.")] = 10.0,
    json: Json = False,
    naming: Naming = None,
) -> None:
    """Predict whether the federation is faster than one central channel or links of another shape, now."""
    with connected("events advise", naming) as orb:
        names, ticks = channels or _channels(orb), StopSignal().ticks(0.2, seconds)
        try:
            with progress(seconds) as show_progress:
                measured = event_advice.measure(orb, names, lambda: [show_progress(done, "") for done in ticks])
        except TooFewEvents as error:
            print_json({"verdict": "unknown", "sentence": str(error)}) if json else echo(str(error))
            return
    if json:
        print_json(event_advice.as_json(*measured))
    else:
        show(event_advice.sheet(*measured))


@app.command()
def tail(
    channel: ChannelName,
    type: Annotated[str, typer.Option(metavar="T", help="Only events of this type; * and ? are wildcards.")] = "*",
    source: Annotated[str, typer.Option(metavar="S", help="Only events of this source; * and ? are wildcards.")] = "*",
    count: Annotated[int, typer.Option(metavar="N", min=0, help="Stop after N events; 0: never.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object per line.")] = False,
    behind_nat: Annotated[
        bool, typer.Option("--behind-nat", help="Receive behind NAT. Needs `robocorba up --bidirectional`.")
    ] = False,
    naming: Naming = None,
) -> None:
    """Print events as they arrive, one per line, until Ctrl-C or SIGTERM."""
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.default_int_handler)
    try:
        with (
            connected("events tail", naming, OFFER_CALLBACKS if behind_nat else None) as orb,
            _event_client(orb, channel) as client,
            contextlib.closing(_received(client, channel, (type, source))) as events,
        ):
            for number, event in enumerate(events, 1):
                echo(json_line(event) if json else text_line(event))
                if number == count:
                    return
    except KeyboardInterrupt:
        return


@app.command()
def push(
    channel: ChannelName,
    type: Annotated[str, typer.Argument(metavar="TYPE", help="Type: words separated by dots, such as robot.state.")],
    payload: Annotated[str, typer.Argument(metavar="JSON", help="Payload, any JSON value.")],
    source: Annotated[str, typer.Option(metavar="S", help="Source of the event.")] = "",
    priority: Annotated[
        int, typer.Option(metavar="N", min=-32768, max=32767, help="Priority in queues; low ones are lost first.")
    ] = 0,
    expiry: Annotated[float, typer.Option(metavar="S", help="Time until the event expires [s]; 0: never.")] = 0.0,
    naming: Naming = None,
) -> None:
    """Publish one event."""
    with connected("events push", naming) as orb:
        try:
            value = json_format.loads(payload)
        except ValueError as error:
            raise InvalidEvent("payload", f"{payload[:80]!r} is not JSON: {error}") from None
        with _event_client(orb, channel) as client:
            client.source = source
            client.push(type, value, priority=priority, expiry_s=expiry, retry_s=RESOLVE_TIMEOUT_S)


@app.command()
def types(json: Json = False) -> None:
    """List the events that RoboCorba itself publishes: by whom, when, and with which payload."""
    from robocorba.commands.event_types import event_types, members

    rows = [(*row, members(payload) or payload) for *row, payload in event_types()]
    titles = ("type", "source", "published", "payload")
    if json:
        print_json([dict(zip(titles, row, strict=True)) for row in rows])
    else:
        show(
            Sheet(
                titles, [(*row, payload if isinstance(payload, str) else ", ".join(payload)) for *row, payload in rows]
            )
        )


@peer_app.command()
def add(
    channel: ChannelName,
    peer: _Peer,
    address: Annotated[
        str, typer.Option(metavar="HOST:PORT|URI", help="Address of the peer. Default: that in the naming service.")
    ] = "",
    foreign: Annotated[bool, typer.Option("--foreign", help="Link a channel with only CosEventChannelAdmin.")] = False,
    naming: Naming = None,
) -> None:
    """Link two channels in both directions, until `remove`."""
    with connected("events peer add", naming) as orb:
        RemoteChannel(orb, channel).add_peer(peer, address, foreign)


@peer_app.command()
def remove(channel: ChannelName, peer: _Peer, naming: Naming = None) -> None:
    """Remove a link at both ends."""
    with connected("events peer remove", naming) as orb:
        RemoteChannel(orb, channel).remove_peer(peer)


# ---- events as lines ----


def text_line(event: Event) -> str:
    """Time, origin and number, type, source and payload; without characters that end a line or move the cursor."""
    extras = [f"priority {event.priority}"] * bool(event.priority)
    extras += [f"expires after {event.expiry:g} s"] * bool(event.expiry)
    shown = json_format.dumps(_shown(event.payload), ensure_ascii=False)
    if len(shown) > MAX_CHARACTERS:
        shown = f"{shown[:MAX_CHARACTERS]}… ({len(shown)} characters)"
    identity = f"{event.origin}:{event.number}"
    words = [_moment(event.time), identity, event.type, event.source or "-", *extras, shown]
    return "  ".join(map(one_line, words))


def json_line(event: Event) -> str:
    """The whole event as a JSON object; bytes are shortened, values without a JSON type are shown as text."""
    fields = event._asdict() | {"payload": _shown(event.payload)}
    return json_format.dumps(fields)


def _shown(value: Any, level: int = 0) -> Any:
    """A payload as JSON types."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if abs(value) < float("inf") else str(value)  # JSON has neither nan nor infinity
    if isinstance(value, bytes | bytearray):
        return f"<{len(value)} bytes {value[:MAX_BYTES].hex()}{'…' * (len(value) > MAX_BYTES)}>"
    if level == MAX_LEVELS:
        return "…"
    if isinstance(value, dict):
        return {key if isinstance(key, str) else str(_shown(key)): _shown(v, level + 1) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_shown(entry, level + 1) for entry in value]
    return repr(value)


def _moment(time_s: float) -> str:
    try:
        return datetime.fromtimestamp(time_s).astimezone().isoformat(timespec="milliseconds")
    except (ValueError, OverflowError, OSError):  # a supplier may send any number
        return f"{time_s:g}"


# ---- connections ----


def _channels(orb: Orb) -> list[str]:
    """The names of all channels. Raises NotReachable if there is none."""
    names = list(orb.names(CHANNELS, RESOLVE_TIMEOUT_S))
    if not names:
        raise NotReachable(f"no event channel is bound in the naming service at {orb.naming}")
    return names


def _received(client: EventClient, channel: str, pattern: tuple[str, str]) -> Generator[Event, None, None]:
    """Events as they arrive, without end. Raises NotReachable if the channel has disconnected this consumer."""
    waiting: queue.Queue[Event] = queue.Queue(MAX_WAITING)
    ended = threading.Event()

    def receive(event: Event) -> None:
        while not ended.is_set():  # the channel queues the rest until the terminal accepts more
            with contextlib.suppress(queue.Full):
                return waiting.put(event, timeout=0.2)

    subscription = client.subscribe(receive, pattern, queue=QueuePolicy(MAX_QUEUED))
    try:
        while True:
            try:
                yield waiting.get(timeout=CHECK_INTERVAL_S)
            except queue.Empty:
                if subscription.is_lost():  # not while the channel is away, which may be restarting
                    raise NotReachable(f"channel {channel} has disconnected this consumer") from None
    finally:
        ended.set()
        with contextlib.suppress(RoboCorbaError):
            if discarded := subscription.discarded():
                echo(f"{discarded} events were discarded: they arrived faster than they could be shown", err=True)
        subscription.end()


def _event_client(orb: Orb, channel: str) -> EventClient:
    from robocorba.events.corba.event_client import EventClient

    return EventClient(orb, channel, timeout_s=RESOLVE_TIMEOUT_S)
