"""The state of event channels, for the terminal, for pipes and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from robocorba.commands.tables import Sheet, snake_cased
from robocorba.errors.events import EventError
from robocorba.errors.services import NotReachable
from robocorba.events.corba.remote_channel import TIMEOUT_S, RemoteChannel
from robocorba.orb.orb import Orb
from robocorba.orb.plain import plain

#: Number of channels that are queried at the same time.
THREADS = 16

ACCOUNT = ("received", "delivered", "unconfirmed", "discarded", "expired", "queued")
#: Columns that narrow terminals leave out, first the first.
SPARE = ("unseen", "repeated", "unconfirmed", "expired", "name", "bytes", "packets", "client", "discarded", "received")

#: A ChannelState, or the reason why it is not available.
StateOrProblem = Any | str


def query(
    orb: Orb, names: Sequence[str], ask: Callable[[RemoteChannel], Any] = RemoteChannel.state
) -> dict[str, StateOrProblem]:
    """What each channel answers, or the reason why it does not. Asks the channels concurrently."""

    def tried(name: str) -> StateOrProblem:
        try:
            return ask(RemoteChannel(orb, name, TIMEOUT_S))
        except (NotReachable, EventError) as error:
            return str(error)

    with ThreadPoolExecutor(THREADS) as threads:
        return dict(zip(names, threads.map(tried, names), strict=True))


def as_json(state: StateOrProblem) -> Any:
    """A state as JSON types with the member names of the IDL in snake case, or {"problem": reason}."""
    return {"problem": state} if isinstance(state, str) else snake_cased(plain(state))


def sheets(states: Mapping[str, StateOrProblem]) -> list[Sheet]:
    """All channels, and proxies and links of those that answer. A consumer proxy serves a supplier, a supplier
    proxy serves a consumer."""
    channels: list[tuple[object, ...]] = []
    rows: dict[str, list[tuple[object, ...]]] = {"proxy": [], "link": []}
    for name, state in states.items():
        if isinstance(state, str):
            channels.append((name, "", "", state))
            continue
        channels.append((name, ", ".join(state.federation), state.evicted, ""))
        rows["proxy"] += [(name, *_proxy(proxy)) for proxy in state.proxies]
        rows["link"] += [(name, *_link(link)) for link in state.links]
    more = {
        "proxy": ("name", "client", "condition", "subscribed to"),
        "link": ("condition", "problem", "lag", "packets", "bytes", "repeated", "unseen"),
    }
    return [
        Sheet(("channel", "federation", "disconnected after failures", "problem"), channels),
        *(Sheet(("channel", what, *more[what], *ACCOUNT), found, SPARE) for what, found in rows.items() if found),
    ]


def _proxy(proxy: Any) -> tuple[object, ...]:
    condition = _lower_name(proxy.condition) + (f" ({proxy.failures} failures)" if proxy.failures else "")
    wanted = " or ".join(_clause(clause) for clause in proxy.subscribed)
    return (_lower_name(proxy.kind), proxy.name, proxy.client, condition, wanted, *_account(proxy.events))


def _link(link: Any) -> tuple[object, ...]:
    counts = (link.batches, link.bytes, link.repeated, link.unseen)
    lag = f"{link.lag * 1000:.1f} ms"
    return (_end(link), _lower_name(link.condition), link.problem, lag, *counts, *_account(link.events))


def _end(link: Any) -> str:
    return f"{'from' if _lower_name(link.direction) == 'incoming' else 'to'} {link.peer}"


def _account(account: Any) -> tuple[int, ...]:
    return tuple(getattr(account, member) for member in ACCOUNT)


def _clause(clause: Any) -> str:
    patterns = " and ".join(p.type if p.source == "*" else f"{p.type} from {p.source}" for p in clause.patterns)
    return f"({patterns} within {clause.window:g} s)" if clause.window else patterns


def _lower_name(item: Any) -> str:
    return str(item._n).lower().replace("_", " ")
