"""Event numbers: the upper bits name a life of the channel, from a start of its process to the next; the lower ones
count its events, from 1 on. No clock takes part, so it may be set at any time, by any machine.

A life is random, so that a channel that has lost its state, or runs on a copy of an earlier one, uses none twice. While
the state is kept, lives increase, and so do the numbers.
"""

from __future__ import annotations

import secrets

#: The bits of the count. A process that publishes more than 2**32 events goes on with the next life.
COUNT_BITS = 32


def next_life(last: int) -> int:
    """A life that the channel has not had, higher than its last one where possible. last: 0 if it is not known.

    It is higher by 16 at least, for processes that go on with the next life, and by 16 random bits, for channels that
    were put back to an earlier state: 65,000 starts use up all lives. The first one is in the lower half."""
    life = last + 16 + secrets.randbits(16)
    return life if last and life < 1 << 32 else 1 + secrets.randbits(31)


def first_number_of(life: int) -> int:
    """The number of the first event of a life."""
    return (life << COUNT_BITS) + 1


def life_of(number: int) -> int:
    """The life in which an event got this number."""
    return number >> COUNT_BITS


def count_of(number: int) -> int:
    """The count of an event in its life."""
    return number & ((1 << COUNT_BITS) - 1)
