"""What the bench of the console's returns makes of what a page has shown."""

from __future__ import annotations

import math

from bench.console.returns import PLACES, Shown, Sight, sight

FINE = {"status": "", "robots": "", "channels": "", "isFresh": True}


def shown(*moments: dict[str, object]) -> Shown:
    """Moments a second apart, from 10 s on."""
    return [(1e3 * at_s, {**FINE, **moment}) for at_s, moment in enumerate(moments, 10)]


def test_a_page_works_when_the_last_problem_is_gone_and_news_are_fresh() -> None:
    lost, stale = {"status": "lost", "robots": "R1"}, {"isFresh": False}
    assert sight(shown({}, lost, {}, lost, stale, {}, stale), PLACES) == Sight("lost; R1", 14.0, 15.0)


def test_other_places_do_not_count() -> None:
    assert sight(shown({"channels": "a"}, {}), ("status",)) == Sight("", 10.0, 10.0)


def test_a_page_that_still_shows_a_problem_or_no_news_does_not_work() -> None:
    assert sight(shown({}, {"robots": "R1"}), PLACES) == Sight("R1", math.inf, math.inf)
    assert sight(shown({"robots": "R1"}, {"isFresh": False}), PLACES) == Sight("R1", 11.0, math.inf)
