"""What a robot senses: sensors by their names in programs, and the bumper of a virtual robot."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.robots import AdaptorFailed, RobotLost
from robocorba.errors.sensing import SensorBehind, UnknownSensor
from robocorba.robot.motion.robot_state import RobotState
from robocorba.robot.senses import RangeSensor, nearest_m, program_ranges_m, usual_sensors
from robocorba.robot.simulated_adaptor import SimulatedAdaptor
from robocorba.simulation.registry import Description, Pose
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.scan import RAY_SENSORS, Mount, ScanSpec
from tests.robot.places import InProcessSession, Measured, Place
from tests.robot.stepped_robot import Session, World
from tests.simulation.places import tower

RING = RAY_SENSORS["proximity"].rays


@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.01, math.pi / 4),
    st.integers(1, 40),
    st.floats(-math.pi, math.pi),
    st.data(),
)
def test_a_ring_of_any_rays_is_named_by_where_they_point(
    first: float, step: float, count: int, heading: float, data: st.DataObject
) -> None:
    count = min(count, int(math.tau / step) + 1)
    ring = RangeSensor("proximity", Mount(0.1, 0.0, heading), ScanSpec(Fan(first, step, count, 2.0)))
    distances = np.array(data.draw(st.lists(st.floats(0.0, 2.0), min_size=count, max_size=count)))
    senses = Measured((ring, distances))
    for index, name in enumerate(RING):
        towards = index * math.pi / 4
        apart = [abs(math.remainder(heading + first + step * k - towards, math.tau)) for k in range(count)]
        if any(abs(angle - math.pi / 8) < 1e-6 for angle in apart):  # on the border of two
            continue
        seen = [distance for distance, angle in zip(distances, apart, strict=True) if angle < math.pi / 8]
        if seen:
            assert nearest_m(senses, name) == min(seen) and program_ranges_m(senses)[name] == 2.0
        else:
            with pytest.raises(UnknownSensor):
                nearest_m(senses, name)
    assert nearest_m(senses, "proximity") == distances.min()


def test_the_papers_ring_has_a_ray_for_each_name_and_what_a_robot_lacks_is_named() -> None:
    laser, ring = usual_sensors()
    senses = Measured((laser, np.linspace(8.0, 2.0, 181)), (ring, np.arange(1.0, 9.0) / 10.0))
    assert [nearest_m(senses, name) for name in RING] == pytest.approx(np.arange(1.0, 9.0) / 10.0)
    assert [nearest_m(senses, name) for name in ("laser", "proximity")] == pytest.approx([2.0, 0.1])
    assert program_ranges_m(senses) == {"laser": 8.0, **dict.fromkeys(("proximity", *RING), 1.0)}
    sonar = RangeSensor("sonar", Mount(), ScanSpec(Fan(0.0, 1.0, 1, 3.0)))
    only_ahead = RangeSensor("proximity", Mount(), ScanSpec(Fan(0.0, 1.0, 1, 0.5)))
    for senses, name, known in (
        (None, "laser", ()),
        (Measured((sonar, np.ones(1))), "laser", ()),
        (Measured((only_ahead, np.ones(1))), "back", ("front", "proximity")),
    ):
        with pytest.raises(UnknownSensor) as raised:
            nearest_m(senses, name)
        assert (raised.value.name, raised.value.known) == (name, known)
    with pytest.raises(UnknownSensor, match="no sensor 'laser'; known are sonar"):
        Measured((sonar, np.ones(1))).sensor("laser")


def test_a_virtual_robot_senses_its_place_in_the_building(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    session = place.session("A", Pose("L1", 6.5, 8.0))
    senses = SimulatedAdaptor(session).senses
    with pytest.raises(RobotLost):
        senses.ranges("laser")
    session.log_on()
    assert nearest_m(senses, "front") == pytest.approx(0.6, abs=1e-3)  # the shelf, less the robot's radius
    assert nearest_m(senses, "laser") == pytest.approx(1.0, abs=1e-3)
    assert len(senses.ranges("laser").distances) == 181
    with pytest.raises(UnknownSensor, match="known are laser, proximity"):
        senses.ranges("sonar")
    monkeypatch.setattr(session, "scan", MagicMock(side_effect=SensorBehind(2.0, 1.0)))
    with pytest.raises(AdaptorFailed, match="floor data is 2"):
        senses.ranges("laser")
    session.log_off()


def test_the_bumper_counts_what_happens_between_two_readings(tmp_path: Path) -> None:
    """Another robot pushes this one three times, and leaves each time."""
    with contextlib.closing(World(tower(), tmp_path)) as world:
        session = Session(world, Pose("L1", 7.0, 2.0))
        other = InProcessSession(world, Description("B", Pose("L1", 8.2, 2.0)))  # type: ignore[arg-type]
        other.log_on()
        adaptor = SimulatedAdaptor(session)
        adaptor.start(())
        assert [reading[:2] for reading in adaptor.senses.readings()] == [("bumper", "contacts")]

        def contacts() -> float:
            adaptor.read(RobotState())
            (bumper,) = adaptor.senses.readings()
            assert bumper.time == session.latest.time
            return bumper.value

        assert contacts() == 0.0
        for speed, steps in ((-0.3, 130), (0.3, 100)) * 3:
            for _ in range(steps):
                other.command((speed, 0.0, 0.0), 0.1)
                world.step()
        assert contacts() == 3.0
