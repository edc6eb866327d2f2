"""Glides: limits of speed and acceleration are kept, and targets are reached."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from robocorba.smartpal.dynamics import STEP_S
from robocorba.smartpal.glide import Glide


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-5, 5),
    st.floats(-5, 5),
    st.floats(0.05, 2),
    st.floats(0.1, 10),
    st.floats(-1, 1).map(lambda s: round(s, 3)),
)
def test_a_glide_gets_there_within_its_limits(
    at: float, target: float, most: float, acceleration: float, speed: float
) -> None:
    glide = Glide(at, min(most, max(-most, speed)))
    limit_s = 2 * abs(target - at) / most + 4 * most / acceleration + 1.0
    before = glide.speed
    for _ in range(round(limit_s / STEP_S)):
        glide.go(target, most, acceleration)
        assert abs(glide.speed) <= most + 1e-9
        assert abs(glide.speed - before) <= acceleration * STEP_S + 1e-9
        before = glide.speed
    assert (glide.at, glide.speed) == (target, 0.0)


def test_it_stands_where_it_is_by_its_deceleration() -> None:
    glide = Glide(0.0, 1.0)
    for _ in range(round(0.5 / STEP_S)):
        glide.run(0.0, 2.0)
    assert glide.speed == 0.0
    assert abs(glide.at - 0.25) < 0.002
