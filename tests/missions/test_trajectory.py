"""Trajectories of a carried body."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.errors.robots import InvalidPlan
from robocorba.map_editor.spatial.pose import Limits
from robocorba.missions.trajectory import Trajectory

PLACES = ((-1.42, 0.0, 0.0), (1.42, 0.0, math.pi), (0.4, 1.02, -math.pi / 2))
poses = st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-7, 7)), min_size=1, max_size=6)
limits = st.builds(Limits, st.floats(0.05, 1.0), st.floats(0.1, 1.0), st.floats(0.1, 1.0))


@settings(max_examples=20, deadline=None)
@given(poses, limits)
def test_no_carrier_exceeds_the_limits(path: list[tuple[float, float, float]], limits: Limits) -> None:
    speed, turn_speed, acceleration, _ = limits
    trajectory = Trajectory(path, PLACES, limits)
    times = np.linspace(0.0, trajectory.duration, 400)
    step = 1e-4
    for place in (*PLACES, (0.0, 0.0, 0.0)):
        for t in times:
            _, (vx, vy, turn) = trajectory.carrier(t, place)
            assert math.hypot(vx, vy) <= speed * (1 + 1e-9)
            assert abs(turn) <= turn_speed * (1 + 1e-9)
            _, (wx, wy, _) = trajectory.carrier(t + step, place)
            assert math.hypot(wx - vx, wy - vy) / step <= acceleration * 1.01 + 1e-6


@settings(max_examples=20, deadline=None)
@given(poses)
def test_velocities_are_the_derivatives_of_poses(path: list[tuple[float, float, float]]) -> None:
    trajectory = Trajectory(path, PLACES)
    step = 1e-5
    for t in np.linspace(0.0, trajectory.duration, 100)[1:-1]:
        before, _ = trajectory.carrier(t - step, PLACES[2])
        after, _ = trajectory.carrier(t + step, PLACES[2])
        _, velocity = trajectory.carrier(t, PLACES[2])
        assert (np.subtract(after, before) / (2 * step)).tolist() == pytest.approx(velocity, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(poses)
def test_a_transmitted_trajectory_is_identical(path: list[tuple[float, float, float]]) -> None:
    trajectory = Trajectory(path, PLACES)
    received = Trajectory.from_rows(msgpack.unpackb(msgpack.packb(trajectory.to_rows())))
    assert received.to_rows() == trajectory.to_rows()
    assert received.duration == trajectory.duration
    for t in np.linspace(-1.0, trajectory.duration + 1.0, 50).tolist():
        assert received.at(t) == trajectory.at(t)


@settings(max_examples=20, deadline=None)
@given(poses)
def test_the_body_stops_at_each_pose(path: list[tuple[float, float, float]]) -> None:
    trajectory = Trajectory(path, PLACES)
    assert trajectory.at(-1.0)[0] == trajectory.start
    assert trajectory.start == pytest.approx(path[0], abs=1e-6)
    assert trajectory.at(trajectory.duration) == (path[-1], (0.0, 0.0, 0.0))
    for begins, x, y, heading, _ in trajectory.to_rows():
        pose, velocity = trajectory.at(begins)
        assert pose == pytest.approx((x, y, heading), abs=1e-9)
        assert velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_four_metres_straight() -> None:
    trajectory = Trajectory([(0, 0, 0), (4, 0, 0)], PLACES)
    ramp_s = 1.5 * 0.25 / 0.4
    assert trajectory.duration == pytest.approx(16.0 + ramp_s)
    (x, _, _), (vx, _, _) = trajectory.at(trajectory.duration / 2)
    assert (x, vx) == pytest.approx((2.0, 0.25))


def test_carriers_of_a_body_that_turns_on_the_spot() -> None:
    trajectory = Trajectory([(1, 2, 0), (1, 2, math.pi / 2)], PLACES[:2])
    (x, y, heading), velocity = trajectory.carrier(trajectory.duration, PLACES[0])
    assert (x, y, heading) == pytest.approx((1.0, 0.58, math.pi / 2))
    assert velocity == (0.0, 0.0, 0.0)
    standing = Trajectory([(1, 2, 3), (1, 2, 3)], PLACES)
    assert standing.duration == 0.0
    assert standing.at(5.0) == ((1.0, 2.0, 3.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [(0.0, 0.0, 0.0, 0.0, 0.0)] * 2001,
        [(0.0, 1.0, 2.0)],
        [(0.0, 0.0, 0.0, math.nan, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 0.0), (2.0, 1.0, 0.0, 0.0, 0.0)],
        [(0.0, 0.0, 0.0, 0.0, 1.5), (2.0, 1.0, 0.0, 0.0, 0.0)],
    ],
)
def test_invalid_rows_are_refused(rows: list[tuple[float, ...]]) -> None:
    with pytest.raises(InvalidPlan):
        Trajectory.from_rows(rows)
