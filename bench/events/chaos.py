"""Recovery time and lost events of a federation after kill -9 of a channel or of the naming service.

    python -m bench.events.chaos --rounds 20

Three channels in a chain, each with a supplier and a consumer of all events. In each round one process is killed
under traffic and restarted. Times are from the restart to the first answer, and until all links are up."""

from __future__ import annotations

import argparse
import itertools
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from bench import RESULTS
from robocorba.testing import report
from robocorba.testing.federation import channels
from robocorba.testing.federation_chaos import NAMING, Chaos, Outcome

VICTIMS = ("B", "A", NAMING, "C")
TITLE = "kills under traffic: chain A - B - C"
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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=20, help="total number of kills (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=1, help="random seed of the times of the kills (default: %(default)s)"
    )
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder, channels(Path(folder), *"ABC") as started:
        chaos = Chaos(started, options.seed)
        for number, victim in enumerate(itertools.islice(itertools.cycle(VICTIMS), options.rounds), 1):
            with report.PROGRESS.status(f"round {number} of {options.rounds}: kill {victim}"):
                outcomes.append(chaos.round(victim))
    by_victim = {victim: [o for o in outcomes if o.victim == victim] for victim in VICTIMS}
    by_victim = {victim: of_it for victim, of_it in by_victim.items() if of_it}
    samples = {f"after kill of {victim}": [o.to_links_s for o in of_it] for victim, of_it in by_victim.items()}
    rows = [row(*of_one) for of_one in by_victim.items()]
    report.summarize_samples(RESULTS / "event_chaos", TITLE, rows, samples, "s to links up")

    wrong = [outcome for outcome in outcomes if not outcome.is_right or outcome.links_after_ready_s > MARK_S]
    for outcome in wrong:
        print(f"MISSED: {outcome}")
    print(
        f"links are up within {MARK_S:g} s of the first answer, nothing came twice, and what was lost is named: "
        f"{'no, see above' if wrong else f'yes, in {len(outcomes)} rounds'}"
    )
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
