"""Setpoints keep their limits of speed and acceleration and reach their targets."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.smartpal_stand_in.dynamics import STEP_S
from robocorba.smartpal_stand_in.setpoint import Setpoint


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.floats(0.05, 2),
    st.floats(0.1, 10),
    st.floats(-1, 1).map(lambda s: round(s, 3)),
)
def test_a_setpoint_reaches_its_target_within_its_limits(
    at: float, target: float, most: float, acceleration: float, speed: float
) -> None:
    setpoint = Setpoint(at, min(most, max(-most, speed)))
    limit_s = 2 * abs(target - at) / most + 4 * most / acceleration + 1.0
    before = setpoint.speed
    for _ in range(round(limit_s / STEP_S)):
        setpoint.step_towards(target, most, acceleration)
        assert abs(setpoint.speed) <= most + 1e-9
        assert abs(setpoint.speed - before) <= acceleration * STEP_S + 1e-9
        before = setpoint.speed
    assert (setpoint.position, setpoint.speed) == (target, 0.0)


def test_it_stops_within_its_braking_distance() -> None:
    setpoint = Setpoint(0.0, 1.0)
    for _ in range(round(0.5 / STEP_S)):
        setpoint.step_at_velocity(0.0, 2.0)
    assert setpoint.speed == 0.0
    assert abs(setpoint.position - 0.25) < 0.002
