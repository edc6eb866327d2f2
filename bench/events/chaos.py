"""Recovery time and lost events of a federation after kill -9 of a channel or of the naming service.

    python -m bench.events.chaos --rounds 20

Three channels in a chain, each with a supplier and a consumer of all events. In each round one process is killed
under traffic and restarted. Times are from the restart to the first answer, and until all links are up."""

from __future__ import annotations

import itertools
from statistics import median
from typing import Any

from bench.common.harness import folder_of_bench, progress, run
from testkit.federation import channels
from testkit.federation_chaos import NAMING, Chaos, Outcome
from testkit.report import at_most, distribution, summarize

VICTIMS = ("B", "A", NAMING, "C")
#: Maximum time from the first answer of the restarted channel until all its links are up [s].
MARK_S = 2.0


def row(victim: str, outcomes: list[Outcome]) -> dict[str, Any]:
    """Summary of the rounds of one victim; times are median and longest [s]."""
    links = [outcome.to_links_s for outcome in outcomes]
    after_ready = [outcome.links_after_ready_s for outcome in outcomes]
    return {
        "killed": victim,
        "rounds": len(outcomes),
        "to first answer": median(outcome.to_ready_s for outcome in outcomes),
        "to links up": median(links),
        "longest": max(links),
        "links after answer": median(after_ready),
        "longest after answer": max(after_ready),
        "events": sum(outcome.said for outcome in outcomes),
        "duplicates": sum(outcome.duplicates for outcome in outcomes),
        "lost": sum(outcome.lost for outcome in outcomes),
        "named by accounts": sum(outcome.in_victim for outcome in outcomes),
        "lost while away": sum(outcome.lost_later for outcome in outcomes),
    }


def main(rounds: int = 20, seed: int = 1) -> bool:
    victims = list(itertools.islice(itertools.cycle(VICTIMS), rounds))
    with folder_of_bench() as folder, channels(folder, *"ABC") as started:
        chaos = Chaos(started, seed)
        outcomes = [chaos.round(victim) for victim in progress(victims, "kills")]
    of = {victim: [one for one in outcomes if one.victim == victim] for victim in dict.fromkeys(victims)}
    wrong = [outcome for outcome in outcomes if not outcome.is_right]
    for outcome in wrong:
        print(f"MISSED: {outcome}")
    marks = [
        at_most(
            "longest time from the first answer to links up, s", max(o.links_after_ready_s for o in outcomes), MARK_S
        ),
        at_most("rounds with events that came twice or out of order, or were lost and not named", len(wrong), 0),
    ]
    samples = {f"after kill of {victim}": [one.to_links_s for one in found] for victim, found in of.items()}
    draw = distribution(samples, "s to links up", "share of kills that took less")
    return summarize(
        "event_chaos", "kills under traffic: chain A - B - C", list(itertools.starmap(row, of.items())), marks, draw
    )


if __name__ == "__main__":
    run(main, rounds="total number of kills", seed="random seed of the times of the kills")
