"""The benches of starts: which versions they compare, and how long a server was away."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bench.starts import outage
from bench.starts.outage import Client
from bench.starts.systems import OURS, ratio, versions
from robocorba.testing.json_process import ROOT, ProcessFailed


class FakeCaller:
    """A process that got these answers."""

    def __init__(self, *answers: float) -> None:
        self.answers = answers

    def ask(self, command: dict[str, Any]) -> list[float]:
        assert command["do"] == "answered"
        return [at for at in self.answers if at > command["since"]]


def test_without_a_base_there_is_one_version() -> None:
    assert [(version.name, version.source) for version in versions("")] == [(OURS, ROOT)]


def test_an_unknown_base_is_named() -> None:
    with pytest.raises(ProcessFailed, match="no-such-commit is no commit"):
        versions("no-such-commit")


def test_ratio() -> None:
    assert ratio({OURS: [1.0], "base": [4.0]}, sum) == 0.25
    assert ratio({OURS: [1.0]}, sum) is None


def test_away_is_the_longest_time_without_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outage, "AROUND_S", 0.01)
    client = Client(FakeCaller(9.5, 9.995, 10.0, 10.5, 10.505), SimpleNamespace())  # type: ignore[arg-type]
    assert client.away_s(10.001, 10.1) == pytest.approx(0.5)
