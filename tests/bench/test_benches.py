"""What the benches compute without any process, how they report it, and their exit code."""

from __future__ import annotations

import csv
import json
import math
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.axes import Axes

from bench.common.harness import NOT_MEASURED, NotMeasured, run
from bench.console.returns import PLACES, Shown, Sight, sight
from bench.events.channel.consumers import slope_an_hour
from bench.events.channel.stamps import Arrivals, Quality, Tally, gaps, quality, stamped, stamped_run
from bench.events.network import report as network_report
from bench.events.network.experiment import FEDERATED, SET_UPS, STANDARD, Outcome
from bench.events.network.load import Governor
from bench.events.network.report import Interval
from bench.planning.geometric import EDITS, measure, row
from bench.robots import virtual_and_actual as bench
from bench.starts.kills import longest_pause_s
from robocorba.map_editor.validation import problems
from robocorba.robot.kinematics.smartpal import Side
from testkit import report
from testkit.grid_maps import FLOOR, KINDS, OctileGraph, building_of, place_of, random_cells
from testkit.peers.base import PAYLOAD_BYTES
from testkit.report import at_least, at_most, summarize
from testkit.router import DelayLine
from testkit.virtual_and_actual import StateDifference


def test_stamps_and_their_quality() -> None:
    tally = Tally()
    before = time.monotonic_ns()
    payload = stamped(7, supplier=3)
    tally.receive((payload,))
    arrivals = tally.take()
    assert len(payload) == PAYLOAD_BYTES
    assert (arrivals.suppliers.tolist(), arrivals.numbers.tolist()) == ([3], [7])
    assert before <= arrivals.made[0] <= arrivals.came[0] <= time.monotonic_ns()
    assert arrivals.latencies_us().tolist() == [(arrivals.came[0] - arrivals.made[0]) / 1000]
    tally.receive(stamped_run(5, 3, supplier=1))
    assert tally.count == 3
    arrivals = tally.take()
    assert (arrivals.suppliers.tolist(), arrivals.numbers.tolist()) == ([1, 1, 1], [5, 6, 7])
    assert len(set(arrivals.made.tolist())) == 1
    assert len(arrivals.latencies_us(6)) == 2
    assert tally.count == len(tally.take().numbers) == 0  # what was taken is gone
    for numbers, expected_quality in (
        ([0, 1, 2, 3, 99], Quality(0, 0, 0)),  # the last one of an earlier flood
        ([0, 1, 3], Quality(1, 0, 0)),
        ([0, 1, 1, 2, 3], Quality(0, 1, 0)),
        ([3, 0, 1, 2], Quality(0, 0, 3)),
        ([], Quality(4, 0, 0)),
    ):
        assert quality(received(*((number,) for number in numbers)), [range(4)]) == expected_quality
    of_two = received((0, 1), (0, 0), (1, 1), (2, 0), (1, 0))
    assert quality(of_two, [range(3), range(3)]) == Quality(lost=1, repeated=0, misordered=1)
    assert gaps(received((10,), (11,), (15,), (16,), (19,)), range(10, 22)) == [(12, 15), (17, 19), (20, 22)]
    tally.wait(1, quiet_s=0.05, limit_s=60.0)
    sender = threading.Timer(0.05, tally.receive, (stamped_run(0, 3),))
    sender.start()
    tally.wait(3, quiet_s=60.0, limit_s=60.0)
    sender.join()
    assert tally.take().numbers.tolist() == [0, 1, 2]


def received(*stamps: tuple[int, ...]) -> Arrivals:
    """What a tally takes of events with these numbers and suppliers."""
    tally = Tally()
    for stamp in stamps:
        tally.receive((stamped(*stamp),))
    return tally.take()


def outcome(set_up: str, mean_us: float, load: float = 0.5, delay_us: int = 1000, lost: int = 0) -> Outcome:
    """A outcome whose local events take `mean_us` on average, remote ones twice as long."""
    local = mean_us * np.array([0.5, 1.0, 1.5])
    return Outcome(set_up, delay_us, load, load, local, 2 * local, lost, 100, 20_000, 4, 900, 6, 10, 4)


def test_the_network_delays_and_loads() -> None:
    line = DelayLine()
    line.delay_ns = 200
    line.put(b"a", 1000)
    line.put(b"bc", 1100)
    assert line.due_ns == 1200
    assert [line.take(at_ns) for at_ns in (1199, 1200, 1200, 5000, 9000)] == [None, b"a", None, b"bc", None]
    assert line.due_ns is None
    assert (line.packets, line.bytes) == (2, 3)
    line.delay_ns = 500
    line.put(b"first", 10_000)
    line.delay_ns = 0
    line.put(b"second", 10_001)  # a shorter delay lets no packet overtake
    assert [line.take(at_ns) for at_ns in (10_400, 10_500, 10_500)] == [None, b"first", b"second"]
    for wanted, others, work in ((0.2, 0.1, 0.1), (0.6, 0.1, 0.5), (0.9, 0.1, 0.8), (0.3, 0.8, 0.0), (0.0, 0.0, 0.0)):
        governor = Governor()
        governor.want(0.9)
        governor.want(wanted)
        for _ in range(50):
            governor.correct(min(1.0, governor.work + others))
        assert governor.work == pytest.approx(work, abs=0.01 * (work > 0.0))


def test_the_report_of_the_network() -> None:
    found = network_report.ratio(np.array([1.0, 1.2, 0.8, 1.0]), np.array([2.0, 2.2, 1.8, 2.0]))
    assert found.value == pytest.approx(0.5)
    assert 0.4 < found.low < 0.5 < found.high < 0.6
    assert network_report.mean(np.full(5, 3.0)) == Interval(3.0, 3.0, 3.0)
    runs = [outcome(set_up, 1000, load, delay) for delay in (1000, 0) for load in (0.9, 0.1) for set_up in SET_UPS * 2]
    cells = network_report.cells(runs)
    assert [(cell.delay_us, cell.load) for cell in cells] == [(0, 0.1), (0, 0.9), (1000, 0.1), (1000, 0.9)]
    assert all(len(cell.standard) == len(cell.federated) == 2 for cell in cells)
    by_delay = [network_report.row(cell) for cell in network_report.by_delay(cells)]
    assert [(row["delay, ms"], row["load, %"]) for row in by_delay] == [(0, None), (1, None)]
    assert len(network_report.draw(cells).axes) == 4
    (cell,) = network_report.cells([outcome(STANDARD, 1000), outcome(FEDERATED, 500)])
    row = network_report.row(cell)
    assert row["standard mean"] == pytest.approx(1.5)  # half of the events take 1 ms on average, half 2 ms
    assert (row["federated local"], row["federated remote"]) == pytest.approx((0.5, 1.0))
    assert (row["ratio"], row["ratio remote"]) == pytest.approx((0.5, 0.5))
    assert row["standard KB over the link"] == pytest.approx(20)


def test_marks_look_at_the_worst_cell_and_at_lost_events() -> None:
    def marks(*runs: Outcome) -> dict[str, report.Mark]:
        return {mark.what: mark for mark in network_report.marks(network_report.cells(runs))}

    standard, federated = outcome(STANDARD, 1000, 0.1), outcome(FEDERATED, 400, 0.1)
    found = marks(standard, federated, outcome(STANDARD, 1000, 0.9), outcome(FEDERATED, 600, 0.9))
    assert found["ratio of the means, worst load and delay"].value == pytest.approx(0.6)
    assert found["ratio of remote events, 1 ms"].value == pytest.approx(0.5)
    missed = {what for what, mark in found.items() if not mark.is_reached}
    assert missed == {"ratio of the means, worst load with 1 ms"}
    for one, other, wanted in (
        (outcome(STANDARD, 1000, 0.1, lost=1), federated, "events lost"),
        (standard, federated._replace(forwarded=5), "over the federation's link"),
    ):
        (what,) = (what for what, mark in marks(one, other).items() if not mark.is_reached)
        assert wanted in what


ROWS: list[dict[str, Any]] = [{"peer": "a", "p50": 1.5, "lost": 0}, {"peer": "b", "p50": None, "lost": 12345}]


@pytest.mark.parametrize("value", [1.0, 3.0])
def test_a_summary_is_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], value: float
) -> None:
    monkeypatch.setattr(report, "RESULTS", tmp_path)

    def draw(axes: Axes) -> None:
        axes.plot([1, 2], [1, 2])

    reached = summarize("some", "A title", ROWS, [at_most("a ratio", value, 2.0)], draw)

    assert reached == (value <= 2.0)
    printed = capsys.readouterr().out
    assert "A title" in printed and "12,345" in printed
    assert ("reached" if reached else "missed") in printed
    found = json.loads((tmp_path / "some.json").read_text())
    assert found["rows"] == ROWS
    assert found["marks"] == [
        {"what": "a ratio", "value": value, "relation": "at most", "limit": 2.0, "reached": reached}
    ]
    with (tmp_path / "some.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == [
            {"peer": "a", "p50": "1.5", "lost": "0"},
            {"peer": "b", "p50": "", "lost": "12345"},
        ]
    assert (tmp_path / "some.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", KINDS)
def test_maps_are_the_same_for_the_same_seed_and_mostly_connected(kind: str) -> None:
    cells = KINDS[kind](200, 1)
    assert cells.shape == (200, 200) and cells.dtype == np.bool_
    assert (cells == KINDS[kind](200, 1)).all() and (cells != KINDS[kind](200, 2)).any()
    reached = np.isfinite(OctileGraph(cells, 1.0).lengths_from(random_cells(cells, 1, 0)[0]))
    assert reached.sum() >= (1.0 if kind.startswith(("rooms", "maze")) else 0.75) * cells.sum()


def test_walls_are_the_borders_of_the_free_cells_and_octile_lengths_do_not_cut_them() -> None:
    cells = KINDS["laser"](80, 3)
    building = building_of(cells, 0.5)
    assert problems(building) == []
    drawn = [shapely.LineString([w.a, w.b]) for w in building.floors[FLOOR].geometrical.walls.values()]
    rows, columns = np.nonzero(cells)
    free = shapely.union_all(shapely.box(columns * 0.5, rows * 0.5, columns * 0.5 + 0.5, rows * 0.5 + 0.5))
    borders = free.boundary.difference(shapely.box(0.0, 0.0, 40.0, 40.0).exterior)
    assert shapely.union_all(drawn).symmetric_difference(borders).length == pytest.approx(0.0)
    cells = np.ones((3, 3), np.bool_)
    assert OctileGraph(cells, 2.0).lengths_from((0, 0))[2, 2] == pytest.approx(4.0 * 2**0.5)
    cells[1, 1] = False
    assert len(building_of(cells, 1.0).floors[FLOOR].geometrical.walls) == 4  # runs are maximal
    lengths = OctileGraph(cells, 2.0).lengths_from((0, 0))
    assert lengths[2, 2] == 8.0 and np.isinf(lengths[1, 1])
    assert place_of((2, 0), 0.5)[1:] == (0.25, 1.25)


def test_every_figure_is_reported() -> None:
    found: dict[str, list[Any]] = defaultdict(list)
    report: Any = SimpleNamespace(send=lambda what: found[what[0]].append(what[1]))
    measure(report, "rooms of 16", 40, 0.5, 0.2)
    assert list(found)[:3] == ["ready", "planner", "first"] and list(found)[-1] == "done"
    assert len(found["update"]) == len(found["after"]) == EDITS
    assert len(found["query"]) == len(found["octile"]) == len(found["straight"]) > 200
    assert not {"failure", "touch"} & set(found)
    assert all(
        0.7 < to_octile <= 1.0 + 1e-9 <= to_straight + 2e-9
        for to_octile, to_straight in zip(found["octile"], found["straight"], strict=True)
    )
    none = row("cave", 1.0, defaultdict(list))
    assert none["queries"] == 0 and none["median ms"] is None and none["finished"] == "limit"


def test_pauses_growth_and_marks() -> None:
    assert longest_pause_s([9.5, 9.995, 10.0, 10.5, 10.505]) == pytest.approx(0.5)
    seconds = [float(second) for second in range(0, 4000, 100)]
    sizes = [50 + (second / 100 if second < 1000 else 10 + (second - 1000) / 3600) for second in seconds]
    assert slope_an_hour(seconds, sizes) == pytest.approx(1.0, abs=0.05)  # after the warm-up
    marks = (at_most("x", 1.0, 1.0), at_most("x", 1.1, 1.0), at_least("x", 1.0, 1.0), at_least("x", 0.9, 1.0))
    assert [mark.is_reached for mark in (*marks, at_most("x", math.nan, 1.0))] == [True, False, True, False, False]
    near = StateDifference(0.001, 0.001, dict.fromkeys(Side, 0.001))
    for base_m, is_reached in ((0.009, True), (0.011, False)):
        far = StateDifference(base_m, 0.0, dict.fromkeys(Side, 0.0))
        found = bench.marks([bench.row(1, near), bench.row(2, far)])
        assert all(mark.is_reached for mark in found) == is_reached


FINE = {"status": "", "robots": "", "channels": "", "isFresh": True}


def shown(*moments: dict[str, object]) -> Shown:
    """Moments a second apart, from 10 s on."""
    return [(1e3 * at_s, {**FINE, **moment}) for at_s, moment in enumerate(moments, 10)]


def test_a_page_works_when_the_last_problem_is_gone_and_news_are_fresh() -> None:
    lost, stale = {"status": "lost", "robots": "R1"}, {"isFresh": False}
    assert sight(shown({}, lost, {}, lost, stale, {}, stale), PLACES) == Sight("lost; R1", 14.0, 15.0)
    assert sight(shown({"channels": "a"}, {}), ("status",)) == Sight("", 10.0, 10.0)  # other places don't count
    assert sight(shown({}, {"robots": "R1"}), PLACES) == Sight("R1", math.inf, math.inf)
    assert sight(shown({"robots": "R1"}, {"isFresh": False}), PLACES) == Sight("R1", 11.0, math.inf)


def test_the_exit_code_says_whether_marks_were_reached_missed_or_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def cannot_measure() -> bool:
        raise NotMeasured("needs root")

    monkeypatch.setattr(sys, "argv", ["bench"])
    for judge, code in ((lambda: True, 0), (lambda: False, 1), (cannot_measure, NOT_MEASURED)):
        with pytest.raises(SystemExit) as ended:
            run(judge)
        assert ended.value.code == code
