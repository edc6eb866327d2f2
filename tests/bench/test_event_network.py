"""What the paper's experiment computes, without any process."""

from __future__ import annotations

import numpy as np
import pytest

from bench.events.network import mission, report
from bench.events.network.experiment import FEDERATED, SET_UPS, STANDARD, Outcome
from bench.events.network.load import Governor
from bench.events.network.mission import Sent, expected
from bench.events.network.networks import SUBNET_OF
from bench.events.network.report import Interval
from robocorba.testing.router import DelayLine


def run(set_up: str, mean_us: float, load: float = 0.5, delay_us: int = 1000, lost: int = 0) -> Outcome:
    """A run whose local events take `mean_us` on average, remote ones twice as long."""
    local = mean_us * np.array([0.5, 1.0, 1.5])
    return Outcome(set_up, delay_us, load, load, local, 2 * local, lost, 100, 20_000, 4, 900, 6, 10, 4)


# ---- the router ----


def test_packets_come_out_in_order_after_the_delay() -> None:
    line = DelayLine()
    line.delay_ns = 200
    line.put(b"a", 1000)
    line.put(b"bc", 1100)
    assert line.due_ns == 1200
    assert line.take(1199) is None
    assert line.take(1200) == b"a"
    assert line.take(1200) is None
    assert line.take(5000) == b"bc"
    assert line.due_ns is None
    assert line.take(9000) is None
    assert (line.packets, line.bytes) == (2, 3)


def test_a_shorter_delay_lets_no_packet_overtake() -> None:
    line = DelayLine()
    line.delay_ns = 500
    line.put(b"first", 1000)
    line.delay_ns = 0
    line.put(b"second", 1001)
    assert line.take(1400) is None
    assert [line.take(1500), line.take(1500)] == [b"first", b"second"]


# ---- the load ----


@pytest.mark.parametrize("wanted", [0.2, 0.6, 0.9])
def test_the_load_settles_where_the_core_is_as_busy_as_wanted(wanted: float) -> None:
    governor = Governor()
    governor.want(wanted)
    others = 0.1  # what the leader itself needs
    for _ in range(50):
        governor.correct(min(1.0, governor.work + others))
    assert governor.work + others == pytest.approx(wanted, abs=0.01)


def test_no_load_is_no_load() -> None:
    governor = Governor()
    governor.want(0.9)
    governor.want(0.0)
    governor.correct(0.0)
    assert governor.work == 0.0


def test_a_core_that_others_keep_busy_gets_no_load() -> None:
    governor = Governor()
    governor.want(0.3)
    for _ in range(50):
        governor.correct(0.8)
    assert governor.work == 0.0


# ---- the mission ----


def test_each_mission_event_has_as_many_consumers_near_as_far() -> None:
    """So local and remote events weigh the same in the mean."""
    types = [(mission.STATE, source) for source in mission.ROBOTS]
    types += [(f"{mission.SUBPLAN}.{helper}", "A") for helper in mission.HELPERS]
    types += [(mission.GO, "A"), (mission.DONE, "A")]
    types += [(type, helper) for type in (mission.READY, mission.RESULT) for helper in mission.HELPERS]
    near = far = 0
    for type, source in types:
        for robot in mission.ROBOTS:
            count = expected(robot, [Sent(type, source, 1)])
            near += count * (SUBNET_OF[robot] == SUBNET_OF[source])
            far += count * (SUBNET_OF[robot] != SUBNET_OF[source])
    assert near == far == 7


def test_scans_interest_nobody_in_the_other_subnetwork() -> None:
    scans = [Sent(mission.SCAN, source, 10) for source in mission.ROBOTS]
    assert {robot: expected(robot, scans) for robot in mission.ROBOTS} == {"A": 10, "B": 10, "C": 0}
    assert not mission.is_mission(mission.SCAN)


def test_no_robot_receives_its_own_events() -> None:
    assert all(expected(robot, [Sent(mission.STATE, robot, 5)]) == 0 for robot in mission.ROBOTS)


# ---- the analysis ----


def test_ratio_of_means_with_its_interval() -> None:
    found = report.ratio(np.array([1.0, 1.2, 0.8, 1.0]), np.array([2.0, 2.2, 1.8, 2.0]))
    assert found.value == pytest.approx(0.5)
    assert 0.4 < found.low < 0.5 < found.high < 0.6


def test_equal_runs_have_no_spread() -> None:
    assert report.mean(np.full(5, 3.0)) == Interval(3.0, 3.0, 3.0)


@pytest.mark.parametrize(("slope", "word"), [(3.0, "rises"), (-3.0, "falls"), (0.0, "has no clear trend")])
def test_trends(slope: float, word: str) -> None:
    noise = np.tile([20.0, -20.0, 10.0, -10.0], 12)
    loads = np.repeat(np.linspace(0, 0.2, 6), 8)
    runs = [run(STANDARD, 1000 * (1 + slope * load) + off, load) for load, off in zip(loads, noise, strict=True)]
    change, found = report.trend(runs)
    assert found == word
    assert change.low <= change.value <= change.high


def test_cells_are_ordered_and_hold_the_runs_of_both_set_ups() -> None:
    runs = [run(set_up, 1000, load, delay) for delay in (1000, 0) for load in (0.9, 0.1) for set_up in SET_UPS * 2]
    found = report.cells(runs)
    assert [(cell.delay_us, cell.load) for cell in found] == [(0, 0.1), (0, 0.9), (1000, 0.1), (1000, 0.9)]
    assert all(len(cell.standard) == len(cell.federated) == 2 for cell in found)


def test_a_row_has_the_means_of_its_runs() -> None:
    (cell,) = report.cells([run(STANDARD, 1000), run(FEDERATED, 500)])
    row = report.row(cell)
    assert row["standard mean"] == pytest.approx(1.5)  # half of the events take 1 ms on average, half 2 ms
    assert (row["federated local"], row["federated remote"]) == pytest.approx((0.5, 1.0))
    assert (row["ratio"], row["ratio remote"]) == pytest.approx((0.5, 0.5))
    assert row["standard KB over the link"] == pytest.approx(20)


def test_marks_look_at_the_worst_cell() -> None:
    runs = [run(STANDARD, 1000, 0.1), run(FEDERATED, 400, 0.1), run(STANDARD, 1000, 0.9), run(FEDERATED, 600, 0.9)]
    marks = {mark.what: mark for mark in report.marks(report.cells(runs))}
    assert marks["ratio of the means, worst load and delay"].value == pytest.approx(0.6)
    assert marks["ratio of the means, worst load and delay"].is_reached
    assert not marks["ratio of the means, worst load with 1 ms"].is_reached
    assert marks["ratio of remote events, 1 ms"].value == pytest.approx(0.5)
    assert marks["events lost"].is_reached


def test_a_lost_event_misses_a_mark() -> None:
    marks = report.marks(report.cells([run(STANDARD, 1000, lost=1), run(FEDERATED, 400)]))
    assert [mark.what for mark in marks if not mark.is_reached] == ["events lost"]


def test_an_event_that_nobody_wanted_misses_a_mark() -> None:
    runs = [run(STANDARD, 1000), run(FEDERATED, 400)._replace(forwarded=5)]
    marks = report.marks(report.cells(runs))
    assert [mark.is_reached for mark in marks if "over the federation's link" in mark.what] == [False]


def test_differences_from_the_paper_are_named() -> None:
    loads = np.tile(np.linspace(0.1, 0.6, 6), 4).round(1)
    runs = [run(set_up, 1000 + 500 * load, load) for load in loads for set_up in SET_UPS]
    sentences = report.differences(report.cells(runs))
    assert "1 ms, standard: the latency rises with the leader's load, unlike in the paper" in sentences[0]
    assert "standard 1.95 ms to the paper's 18.5" in sentences[2]


def test_the_figure_has_panels_and_the_table_a_row_for_each_delay() -> None:
    cells = report.cells(
        run(set_up, 1000, load, delay) for delay in (0, 5000) for load in (0.1, 0.6) for set_up in SET_UPS
    )
    assert [report.row(cell)["delay, ms"] for cell in report.by_delay(cells)] == [0, 5]
    assert [report.row(cell)["load, %"] for cell in report.by_delay(cells)] == [None, None]
    assert len(report.draw(cells).axes) == 4
