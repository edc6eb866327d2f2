"""What the benches compute without any process, how they report it, and their exit code."""

from __future__ import annotations

import itertools
import json
import math
import re
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.__main__ import BENCHES, ROOT
from bench.common.harness import NOT_MEASURED, NotMeasured, run
from bench.events.channel.processes import Arrivals, Tally, stamped
from bench.events.network import report as network_report
from bench.events.network.experiment import DELAYS, FEDERATED, PAPER, SET_UPS, Case, Outcome
from bench.events.network.load import Governor
from bench.events.network.report import Interval
from bench.events.network.robot import POLLING, PUSHED
from bench.planning.geometric import EDITS, measure, row
from testkit import report
from testkit.peers.base import PAYLOAD_BYTES
from testkit.report import at_most, summarize


def test_stamps_and_their_quality() -> None:
    tally = Tally()
    before = time.monotonic_ns()
    payload = stamped(7)
    tally.receive((payload,))
    arrivals = tally.take()
    assert len(payload) == PAYLOAD_BYTES
    assert arrivals.numbers.tolist() == [7]
    assert before <= arrivals.made[0] <= arrivals.came[0] <= time.monotonic_ns()
    assert arrivals.latencies_us().tolist() == [(arrivals.came[0] - arrivals.made[0]) / 1000]
    tally.receive([stamped(number) for number in (5, 6, 7)])
    assert tally.count == 3
    arrivals = tally.take()
    assert arrivals.numbers.tolist() == [5, 6, 7]
    assert len(arrivals.latencies_us(6)) == 2
    assert tally.count == len(tally.take().numbers) == 0  # what was taken is gone
    for numbers, expected in (
        ([0, 1, 2, 3, 99], (0, 0, 0)),  # the last one of an earlier flood
        ([0, 1, 3], (1, 0, 0)),
        ([0, 1, 1, 2, 3], (0, 1, 0)),
        ([3, 0, 1, 2], (0, 0, 3)),
        ([], (4, 0, 0)),
    ):
        assert tuple(received(*numbers).quality([range(4)]).values()) == expected
    of_two = received(10, 0, 11, 2, 0)
    assert of_two.quality([range(3), range(10, 13)]) == {"lost": 2, "repeated": 1, "misordered": 1}
    tally.wait(1, quiet_s=0.05, limit_s=60.0)
    sender = threading.Timer(0.05, tally.receive, ([stamped(number) for number in range(3)],))
    sender.start()
    tally.wait(3, quiet_s=60.0, limit_s=60.0)
    sender.join()
    assert tally.take().numbers.tolist() == [0, 1, 2]


def received(*numbers: int) -> Arrivals:
    """What a tally takes of events with these numbers."""
    tally = Tally()
    for number in numbers:
        tally.receive((stamped(number),))
    return tally.take()


def outcome(set_up: str, mean_us: float, case: Case, busy: float = 0.5) -> Outcome:
    """An outcome whose local events take `mean_us` on average, remote ones twice as long."""
    local = [mean_us * share for share in (0.5, 1.0, 1.5)]
    us = {("B", "A"): local, ("C", "A"): [2 * one for one in local]}
    return Outcome(case, set_up, busy, us, 0, 100, 20_000, 0, 4 * (set_up == FEDERATED), 4)


def test_the_load_is_governed() -> None:
    for wanted, others, work in ((0.2, 0.1, 0.1), (0.6, 0.1, 0.5), (0.9, 0.1, 0.8), (0.3, 0.8, 0.0), (0.0, 0.0, 0.0)):
        governor = Governor()
        governor.want(0.9)
        governor.want(wanted)
        for _ in range(50):
            governor.correct(min(1.0, governor.work + others))
        assert governor.work == pytest.approx(work, abs=0.01 * (work > 0.0))


def test_the_report_of_the_network(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = network_report.ratio(np.array([1.0, 1.2, 0.8, 1.0]), np.array([2.0, 2.2, 1.8, 2.0]))
    assert found.value == pytest.approx(0.5) and 0.4 < found.low < 0.5 < found.high < 0.6
    assert network_report.mean(np.full(5, 3.0)) == Interval(3.0, 3.0, 3.0)
    us = {FEDERATED: 500.0, "I": 400.0, "II": 600.0, "servers": 1000.0}
    cases = [Case(PUSHED, link, "A, B", load) for link in (PAPER, DELAYS[2]) for load in (0.5, 0.55)]
    runs = [outcome(set_up, us[set_up], case) for case in cases for set_up in SET_UPS * 2]
    cells = network_report.cells(runs)
    assert [(cell.case, cell.place) for cell in cells] == list(itertools.product(sorted(cases), ("I", "II", "servers")))
    row = network_report.row(cells[2])
    assert row["std ms"] == pytest.approx(1.5)  # half of the events take 1 ms on average, half 2 ms
    assert (row["fed/std (95 %)"], row["local"], row["remote"]) == ("0.50 (0.50-0.50)", 0.5, 0.5)
    # Only where a gain is possible, the mark is one; with 1 ms the channel in II would have to be slower.
    verdicts = {mark.what: mark.is_reached for mark in network_report.marks(cells)}
    assert verdicts.pop("ratio, 1 ms, scans of A, B, central in II") is False
    assert verdicts["cost, 10BASE-T, scans of A, B, central in I"] and all(verdicts.values())
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    assert network_report.write_report([one for one in runs if one.case.link == PAPER], 0.0, {})
    for others_cores, busy, reason in ((0.5, 0.5, "0.50 cores"), (0.0, 0.9, "40 points")):
        bad = [outcome(set_up, us[set_up], cases[0], busy) for set_up in SET_UPS]
        with pytest.raises(NotMeasured, match=f"invalid: .*{reason}"):
            network_report.write_report(bad, others_cores, {})
    polling = [outcome(each, us[each], Case(POLLING, PAPER, "A, B", 0.9), 0.7) for each in SET_UPS]
    assert network_report.write_report(polling, 0.0, {}), "a leader that is the load itself can't reach each"


@pytest.mark.parametrize("value, verdict", [(1.0, "reached"), (3.0, "missed by 1"), (math.nan, "not measured")])
def test_a_summary_is_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], value: float, verdict: str
) -> None:
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    monkeypatch.setattr(report, "run", report.Run({"rounds": 3, "only": "a b"}, {"only": "a b"}, ["bench"]))
    rows: list[dict[str, Any]] = [{"peer": "a", "p50": 1.5}, {"peer": "b", "lost": 12345, "p50": math.nan}]
    marks, samples = [at_most("a ratio", value, 2.0)], {"few": [1.0, 2.0], "many": list(range(1001))}
    assert summarize("some", "A title", rows, marks, samples, "ms") == (verdict == "reached")
    printed = capsys.readouterr().out
    assert "A title" in printed and "12,345" in printed and verdict in printed
    found = json.loads((tmp_path / "some-only-a-b.json").read_text())
    assert (found["rows"], found["marks"][0]["verdict"]) == ([rows[0], {**rows[1], "p50": "not measured"}], verdict)
    assert found["samples"] == {"few": [1.0, 2.0], "many": {"count": 1001, "percentiles": list(range(0, 1001, 10))}}
    assert (found["options"], found["changed options"]) == ({"rounds": 3, "only": "a b"}, {"only": "a b"})
    assert found["machine"]["cores"] and found["other programs, cores"] >= 0.0
    with pytest.raises(NotMeasured, match="too busy"):
        summarize("bad", "", rows, marks, invalid="too busy")
    assert json.loads((tmp_path / "bad-only-a-b.json").read_text())["marks"][0]["verdict"] == "invalid"


def test_every_figure_is_measured() -> None:
    found = measure("rooms of 16", 40, 0.5, 0.2)
    assert len(found["update"]) == len(found["after"]) == EDITS
    assert len(found["query"]) == len(found["octile"]) == len(found["straight"]) > 200
    assert not {"failure", "touch", "left"} & set(found)
    assert all(
        0.7 < to_octile <= 1.0 + 1e-9 <= to_straight + 2e-9
        for to_octile, to_straight in zip(found["octile"], found["straight"], strict=True)
    )
    none = row("cave", 1.0, defaultdict(list))
    assert none["queries"] == 0 and none["median ms"] is None


def test_the_exit_code_says_whether_marks_were_reached_missed_or_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot_measure() -> bool:
        raise NotMeasured("needs root")

    monkeypatch.setattr(sys, "argv", ["bench"])
    for judge, code in ((lambda: True, 0), (lambda: False, 1), (cannot_measure, NOT_MEASURED)):
        with pytest.raises(SystemExit) as ended:
            run(judge)
        assert ended.value.code == code


def test_every_bench_goes_through_the_one_function() -> None:
    for name in (f"{subject}.{command.split()[0]}" for subject, commands in BENCHES.items() for command in commands):
        path = ROOT / "bench" / name.replace(".", "/")
        file = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
        assert re.search(r'^if __name__ == "__main__":\n    run\(', file.read_text(), re.MULTILINE), name
    assert not [file for file in (ROOT / "bench").rglob("*.py") if "RESULTS" in file.read_text()]  # summarize writes
