"""Measures a federation, and shows how fast other layouts of its channels would be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from robocorba.commands.event_stats import query
from robocorba.commands.tables import Sheet
from robocorba.errors.services import NotReachable
from robocorba.events.advice import Advice, advise, demand_between
from robocorba.events.corba.remote_channel import RemoteChannel
from robocorba.events.traffic import ChannelTraffic
from robocorba.orb.orb import Orb

#: A machine with more runnable threads a core makes predictions uncertain.
BUSY_LOAD = 1.0


def measure(orb: Orb, names: Sequence[str], wait: Callable[[], object]) -> tuple[Advice, list[str]]:
    """Advice for the federation of these channels from their traffic during `wait`, and what makes it uncertain.

    Raises TooFewEvents, and NotReachable if fewer than two channels can be measured."""

    before = query(orb, names, RemoteChannel.traffic)
    wait()
    after = query(orb, names, RemoteChannel.traffic)
    notes = {name: one for name, one in (*before.items(), *after.items()) if isinstance(one, str)}
    then, now = ({n: one for n, one in all.items() if isinstance(one, ChannelTraffic)} for all in (before, after))
    if len(then.keys() & now.keys()) < 2:
        reasons = "; ".join(notes.values()) or f"there is {', '.join(names)} only"
        raise NotReachable(f"a federation has at least two channels: {reasons}")
    load = max(one.load for one in now.values())
    uncertain = [f"not included: {reason}" for reason in notes.values()]
    if load > BUSY_LOAD:
        uncertain.append(f"uncertain: a machine of the channels has {load:.1f} runnable threads a core")
    return advise(demand_between(then, now)), uncertain


def sheet(advice: Advice, notes: Sequence[str]) -> Sheet:
    """The layouts, best first, and the sentence."""
    rows = [
        (
            one.layout,
            "overloaded" if math.isinf(one.latency_s) else f"{'at most ' * one.is_bound}{1e3 * one.latency_s:.3f} ms",
            "" if math.isinf(one.messages) else f"{one.messages:.2f}",
        )
        for one in sorted((advice.now, *advice.centrals, *advice.shapes), key=lambda one: one.latency_s)
    ]
    titles = ("layout", "predicted mean latency", "link messages per event")
    return Sheet(titles, rows, notes=(*notes, str(advice)))


def as_json(advice: Advice, notes: Sequence[str]) -> Mapping[str, Any]:
    """The same as JSON types; null for infinite latencies, and if the federation never is as fast as a central channel.

    ratio: of the federation's latency to that of `best`; break_even_s: the link delay at which it is as fast as the
    best central channel."""
    return {
        "verdict": advice.verdict,
        "sentence": str(advice),
        "best": advice.best.layout,
        "ratio": advice.ratio,
        "break_even_s": advice.break_even_s,
        "layouts": [one._asdict() for one in (advice.now, *advice.centrals, *advice.shapes)],
        "notes": notes,
    }
