"""Channels and the naming service are killed under traffic, again and again.

By hand, for more rounds than the suite takes: python -m tests.system.test_event_chaos 20"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.testing.federation import channels
from robocorba.testing.federation_chaos import NAMING, Chaos, Outcome

pytestmark = [pytest.mark.system, pytest.mark.full]
#: Whose turn it is.
VICTIMS = ("B", "A", NAMING, "C")


def outcomes(folder: Path, rounds: int, seed: int) -> Iterator[Outcome]:
    """Of so many kills, one after the other, in one federation."""
    with channels(folder, *"ABC") as started:
        chaos = Chaos(started, seed)
        for victim in itertools.islice(itertools.cycle(VICTIMS), rounds):
            yield chaos.round(victim)


def test_kills_repeat_nothing_and_cost_only_what_the_killed_process_held(tmp_path: Path) -> None:
    for outcome in outcomes(tmp_path, rounds=4, seed=1):
        assert outcome.is_right, outcome


def main(rounds: int) -> int:
    """Print what became of each round; exit code 1 if any was not right."""
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for outcome in outcomes(Path(folder), rounds, seed=time.time_ns()):
            print(outcome, "" if outcome.is_right else "WRONG", flush=True)
            wrong += not outcome.is_right
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
