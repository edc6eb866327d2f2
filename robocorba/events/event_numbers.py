"""Event numbers: the first one of a channel's process is its start time, in 2**-COUNT_BITS s; the others count on from
there. A channel publishes fewer than 2**COUNT_BITS events a second, so that a later process gives none of these numbers
again, even without any of its files."""

from __future__ import annotations

#: 2020-01-01 [s since 1970], from which times are counted.
FIRST_SECOND = 1_577_836_800
#: The bits below the seconds.
COUNT_BITS = 32
#: How far the clock of another machine may be ahead [s].
MAX_CLOCK_LEAD_S = 600
#: How far this machine's clock may have been ahead before it was set right [s]; a random number is hardly below it.
MAX_CLOCK_ERROR_S = 10 * 365 * 86400


def start_second(now_s: float) -> float:
    """The start time of a process that starts at `now_s` [s since 1970], since FIRST_SECOND [s]."""
    return now_s - FIRST_SECOND


def first_number_of(second: float) -> int:
    """The number of the first event of a process that started at `second`, to the microsecond."""
    return int(second * (1 << COUNT_BITS)) + 1


def start_of(number: int) -> int:
    """When the process of the channel started that gave this number, or before [s since 1970]."""
    return (number >> COUNT_BITS) + FIRST_SECOND


def is_plausible(number: int, now_s: float, last: int = 0) -> bool:
    """Whether an event can have this number by `now_s` [s since 1970]: its channel did not start in the future, or not
    since it gave the number `last`, which was plausible then: the system's clock may have been set back."""
    return number >> COUNT_BITS <= max(start_second(now_s) + MAX_CLOCK_LEAD_S, last >> COUNT_BITS)


def is_damaged(number: int, now_s: float) -> bool:
    """Whether a stored number is none that any clock of ours could have led to by `now_s` [s since 1970]."""
    return number >> COUNT_BITS > start_second(now_s) + MAX_CLOCK_ERROR_S
