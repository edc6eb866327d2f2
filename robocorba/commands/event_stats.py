"""The state of event channels, for the terminal, for pipes and as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rich.markup import escape
from rich.table import Table

from robocorba.errors.services import NotReachable
from robocorba.events.corba.remote_channel import TIMEOUT_S, RemoteChannel
from robocorba.orb.orb import Orb
from robocorba.orb.plain import plain
from robocorba.system.printing import Console, line

#: Number of channels that are queried at the same time.
THREADS = 16

ACCOUNT = ("received", "delivered", "unconfirmed", "discarded", "expired", "queued")
PROXY = ("proxy", "name", "client", "condition", "subscribed to")
LINK = ("link", "condition", "lag", "packets", "bytes", "repeated", "unseen")
NUMBERS = {"lag", "packets", "bytes", "repeated", "unseen", *ACCOUNT}
#: Rows of a table, each with its cells.
Rows = list[tuple[str, ...]]

#: A ChannelState, or the reason why it is not available.
StateOrProblem = Any | str


def query(orb: Orb, names: Sequence[str]) -> dict[str, StateOrProblem]:
    """The state of each channel, or the reason why it is not available. Queries the channels concurrently."""
    with ThreadPoolExecutor(THREADS) as threads:
        return dict(zip(names, threads.map(lambda name: _query(orb, name), names), strict=True))


def as_json(state: StateOrProblem) -> Any:
    """A state as JSON types with the member names of the IDL, or {"problem": reason}."""
    return {"problem": state} if isinstance(state, str) else plain(state)


def show(states: dict[str, StateOrProblem]) -> None:
    """Print tables; without a terminal, tab-separated rows that begin with the channel and the kind of row."""
    console = Console()
    for name, state in states.items():
        if console.is_terminal:
            _show(console, name, state)
        elif isinstance(state, str):
            line(name, "problem", state)
        else:
            for kind, _, rows in _tables(state, _link):
                for row in rows:
                    line(name, kind, *row)


def _query(orb: Orb, name: str) -> StateOrProblem:
    try:
        return RemoteChannel(orb, name, TIMEOUT_S).state()
    except NotReachable as error:
        return str(error)


def _show(console: Console, name: str, state: StateOrProblem) -> None:
    console.print(f"[bold]{escape(name)}[/bold]", end="  ")
    if isinstance(state, str):
        console.print(f"[red]{escape(state)}[/red]\n")
        return
    console.print(
        f"federation: {', '.join(map(escape, state.federation))};  disconnected after failures: {state.evicted}"
    )
    for kind, header, rows in _tables(state, _brief_link):
        if rows:
            note = "A consumer proxy serves a supplier, a supplier proxy serves a consumer."
            table = Table(caption=note if kind == "proxy" else None)
            for column in header:
                table.add_column(column, justify="right" if column in NUMBERS else "left")
            for row in rows:
                table.add_row(*map(escape, row))
            console.print(table)
        for link in state.links if kind == "link" else ():
            if link.problem:  # it would make the table's columns narrow
                console.print(f"{escape(_end(link))}: {escape(link.problem)}")
    console.print()


def _tables(state: Any, of_link: Callable[[Any], tuple[str, ...]]) -> list[tuple[str, tuple[str, ...], Rows]]:
    """Kind of row, header and rows of each table of a ChannelState. of_link: the row of a link."""
    return [
        ("proxy", (*PROXY, *ACCOUNT), [_proxy(proxy) for proxy in state.proxies]),
        ("link", (*LINK, *ACCOUNT), [of_link(link) for link in state.links]),
        ("total", ("of all", *ACCOUNT), _totals(state)),
    ]


def _proxy(proxy: Any) -> tuple[str, ...]:
    condition = _lower_name(proxy.condition) + (f" ({proxy.failures} failures)" if proxy.failures else "")
    wanted = " or ".join(_clause(clause) for clause in proxy.subscribed)
    return (_lower_name(proxy.kind), proxy.name, proxy.client, condition, wanted, *_account([proxy.events]))


def _link(link: Any) -> tuple[str, ...]:
    end, condition, *others = _brief_link(link)
    return (end, condition + (f" ({link.problem})" if link.problem else ""), *others)


def _brief_link(link: Any) -> tuple[str, ...]:
    counts = (link.batches, link.bytes, link.repeated, link.unseen)
    lag = f"{link.lag * 1000:.1f} ms"
    return (_end(link), _lower_name(link.condition), lag, *map(str, counts), *_account([link.events]))


def _end(link: Any) -> str:
    return f"{'from' if _is_incoming(link) else 'to'} {link.peer}"


def _is_incoming(link: Any) -> bool:
    return _lower_name(link.direction) == "incoming"


def _totals(state: Any) -> Rows:
    """Accounts of all clients and links of one kind. Suppliers use consumer proxies, consumers supplier proxies."""
    groups: dict[str, list[Any]] = {"suppliers": [], "consumers": [], "links in": [], "links out": []}
    for proxy in state.proxies:
        groups["suppliers" if _lower_name(proxy.kind).endswith("consumer") else "consumers"].append(proxy.events)
    for link in state.links:
        groups["links in" if _is_incoming(link) else "links out"].append(link.events)
    return [(name, *_account(accounts)) for name, accounts in groups.items()]


def _account(accounts: Sequence[Any]) -> tuple[str, ...]:
    """The sum of accounts."""
    return tuple(str(sum(getattr(account, member) for account in accounts)) for member in ACCOUNT)


def _clause(clause: Any) -> str:
    patterns = " and ".join(p.type if p.source == "*" else f"{p.type} from {p.source}" for p in clause.patterns)
    return f"({patterns} within {clause.window:g} s)" if clause.window else patterns


def _lower_name(item: Any) -> str:
    return str(item._n).lower().replace("_", " ")
