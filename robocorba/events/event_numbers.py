"""Event numbers: the upper bits are the start time of the channel's process, the lower bits count its events."""

from __future__ import annotations

#: 2020-01-01 [s since 1970]. The upper bits are the start time of the process since then [s].
FIRST_SECOND = 1_577_836_800
#: The lower bits, which count the events of a process.
COUNT_BITS = 32
#: How far the clock of another machine may be ahead [s].
MAX_CLOCK_LEAD_S = 600


def start_second(now_s: float) -> int:
    """The upper bits for a process that starts at `now_s` [s since 1970]."""
    return int(now_s) - FIRST_SECOND


def first_number_of(second: int) -> int:
    """The number of the first event of a process that started in `second`."""
    return (second << COUNT_BITS) + 1


def is_plausible(number: int, now_s: float) -> bool:
    """Whether an event can have this number by `now_s` [s since 1970]: its channel did not start in the future."""
    return number >> COUNT_BITS <= start_second(now_s) + MAX_CLOCK_LEAD_S
