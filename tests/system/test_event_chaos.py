"""Channels and the naming service are killed under traffic, again and again."""

from __future__ import annotations

from pathlib import Path

import pytest

from testkit.federation import channels
from testkit.federation_chaos import NAMING, Chaos

pytestmark = [pytest.mark.system, pytest.mark.full]


def test_kills_repeat_nothing_and_cost_only_what_the_killed_process_held(tmp_path: Path) -> None:
    with channels(tmp_path, *"ABC") as started:
        chaos = Chaos(started, seed=1)
        for victim in ("B", "A", NAMING, "C"):
            outcome = chaos.round(victim)
            assert outcome.is_right and outcome.links_after_ready_s < 15.0, outcome  # 2 s on an idle machine
