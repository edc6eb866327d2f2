"""Event numbers: the upper bits are the start time of the channel's process, the lower bits count its events."""

from __future__ import annotations

#: 2020-01-01 [s since 1970]. The upper bits are the start time of the process since then [s].
FIRST_SECOND = 1_577_836_800
#: The lower bits, which count the events of a process.
COUNT_BITS = 32
#: How far the clock of another machine may be ahead [s].
MAX_CLOCK_LEAD_S = 600
#: How far this machine's clock may have been ahead before it was set right [s]; a random number is hardly below it.
MAX_CLOCK_ERROR_S = 10 * 365 * 86400


def start_second(now_s: float) -> int:
    """The upper bits for a process that starts at `now_s` [s since 1970]."""
    return int(now_s) - FIRST_SECOND


def first_number_of(second: int) -> int:
    """The number of the first event of a process that started in `second`."""
    return (second << COUNT_BITS) + 1


def start_of(number: int) -> int:
    """When the process of the channel started that gave this number [s since 1970]."""
    return (number >> COUNT_BITS) + FIRST_SECOND


def is_plausible(number: int, now_s: float, last: int = 0) -> bool:
    """Whether an event can have this number by `now_s` [s since 1970]: its channel did not start in the future, or not
    since it gave the number `last`, which was plausible then: the system's clock may have been set back."""
    return number >> COUNT_BITS <= max(start_second(now_s) + MAX_CLOCK_LEAD_S, last >> COUNT_BITS)


def is_damaged(number: int, now_s: float) -> bool:
    """Whether a stored number is none that any clock of ours could have led to by `now_s` [s since 1970]."""
    return number >> COUNT_BITS > start_second(now_s) + MAX_CLOCK_ERROR_S
