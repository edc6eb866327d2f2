"""The hardware adaptor and the stand-in of the actual robot, as real processes: adaptor, CORBA, units, dynamics."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.errors.robots import AdaptorFailed, UnitFailed
from robocorba.orb.calls import set_call_timeout
from robocorba.robot.corba.remote_smartpal_units import units_at
from robocorba.robot.kinematics.smartpal import ARM, GRIP, JOINTS, LUMBAR, OPEN_RAD, Side
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.robot.smartpal_adaptor import SmartPalAdaptor
from robocorba.stubs import RoboCorba, YeRTUnitMobility, _GlobalIDL
from testkit.actual_robot import StandIn, running_stand_in
from testkit.processes import eventually
from tests.robot.smartpal.driving import TICK_S, drive_to, ticks
from tests.waits import pause

pytestmark = pytest.mark.system

PATIENCE_S = 120.0
#: Slower than this a base stands.
STANDS_M_S = 0.02


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StandIn]:
    with running_stand_in(tmp_path_factory.mktemp("robot"), "--seed", "7") as found:
        yield found


@pytest.fixture
def adaptor(place: StandIn) -> Iterator[SmartPalAdaptor]:
    """Started where the robot stands, called 2, 1, heading 0.5."""
    place.faults.none()
    made = SmartPalAdaptor(units_at(place.orb))
    assert made.start(["--naming", str(place.naming), "--pose=2,1,0.5"])
    yield made
    place.faults.none()
    made.stop()


def posture() -> np.ndarray:
    joints = np.zeros(len(JOINTS))
    joints[ARM[Side.LEFT]] = np.radians([10, -20, 5, 60, 10, 5, -5])
    joints[ARM[Side.RIGHT]] = np.radians([20, -10, 0, 40, 0, 0, 0])
    joints[LUMBAR] = np.radians([-3, 10])
    joints[GRIP[Side.LEFT]] = OPEN_RAD
    return joints


def test_base_and_arms_go_where_they_shall(adaptor: SmartPalAdaptor) -> None:
    to = 2 + math.cos(0.5), 1 + math.sin(0.5)
    state = drive_to(adaptor, *to, 1.0, posture())
    assert math.dist((state.x, state.y), to) < 0.005
    assert abs(state.heading - 1.0) < 0.005
    assert np.abs(state.joints - posture()).max() < 0.005

    def is_stationary() -> bool:
        assert adaptor.read(state)
        return math.hypot(*state.velocity[:2]) < 0.03 and bool(np.abs(state.joint_velocities).max() < 0.03)

    eventually(is_stationary, PATIENCE_S, "that it is stationary")


def test_the_paper_s_booleans(place: StandIn, adaptor: SmartPalAdaptor) -> None:
    assert not adaptor.start(["--naming", str(place.naming)])
    assert adaptor.stop()
    assert not adaptor.stop()
    assert not adaptor.read(RobotState())
    assert not adaptor.write(ActorCommand())
    assert adaptor.start(["--naming", str(place.naming)])
    state = RobotState()
    assert adaptor.read(state)
    # Without --pose it goes on from where it was said to be.
    assert (state.x, state.y, state.heading) == pytest.approx((2, 1, 0.5), abs=0.01)


def test_what_it_can_t_start_with_is_named(place: StandIn) -> None:
    for argv, why in (
        ([], "--naming"),
        (["--naming", "here"], "--naming"),
        (["--naming", "127.0.0.1:1", "--pose=1,2"], "--pose"),
        (["--nothing"], "--naming"),
        (["--naming", "127.0.0.1:1"], r"127\.0\.0\.1:1 does not answer"),
    ):
        with pytest.raises(AdaptorFailed, match=why):
            SmartPalAdaptor(units_at(place.orb)).start(argv)


# ---- it stands when it must ----


def swinging(state: RobotState) -> np.ndarray:
    """Velocities of joints: the left arm lifts, or lowers where it is up."""
    velocities, shoulder = np.zeros(len(JOINTS)), ARM[Side.LEFT].start
    velocities[shoulder] = 0.5 if state.joints[shoulder] < 1.0 else -0.5
    return velocities


def jog(adaptor: SmartPalAdaptor) -> None:
    """Speed up to 0.45 m/s and swing an arm for 0.6 s; on a busy machine, on which commands expire, until it drives."""
    state, begun, wait = RobotState(), time.monotonic(), ticks(PATIENCE_S)
    speed = 0.0
    while wait():
        speed = min(0.45, speed + 0.9 * TICK_S)
        assert adaptor.read(state)
        assert adaptor.write(ActorCommand((speed, 0.0, 0.0), state.joints, swinging(state)))
        if time.monotonic() > begun + 0.6 and state.velocity[0] > 0.2:
            return
    raise AssertionError(f"it does not drive: {state}")


def stands(place: StandIn, over_s: float = 0.1) -> bool:
    """Whether its base and its left arm stay where they are, as the robot itself says."""
    mobility, arm = place.unit("Mobility.Unit", YeRTUnitMobility.mobility), place.unit("MnpL", _GlobalIDL.ArmUnit)
    before, joints = mobility.getPosition(), arm.getFeedbackPos(_GlobalIDL.JOINT)[1]
    pause(over_s)
    after, joints_after = mobility.getPosition(), arm.getFeedbackPos(_GlobalIDL.JOINT)[1]
    way_mm = math.dist(before[1:3], after[1:3])
    return way_mm < 1000 * STANDS_M_S * over_s and abs(joints[0] - joints_after[0]) < 0.2


def test_stop(place: StandIn, adaptor: SmartPalAdaptor) -> None:
    """It brakes at once: 22 mm from 0.45 m/s. After a client's silence it goes on for 0.1 s: 66 mm in all. A busy
    machine may delay the call of one stop, not of all."""
    mobility = place.unit("Mobility.Unit", YeRTUnitMobility.mobility)

    def way_mm() -> float:
        jog(adaptor)
        before = mobility.getPosition()
        assert adaptor.stop()
        eventually(lambda: stands(place), PATIENCE_S, "that it stands")
        after = mobility.getPosition()
        assert adaptor.start(["--naming", str(place.naming)])
        return math.dist(before[1:3], after[1:3])

    eventually(lambda: way_mm() < 44.0, PATIENCE_S, "a stop within 44 mm")


def test_a_client_that_falls_silent(place: StandIn, adaptor: SmartPalAdaptor) -> None:
    jog(adaptor)
    eventually(lambda: stands(place), PATIENCE_S, "that it stands")  # its jogs hold for 0.1 s, then it brakes
    jog(adaptor)  # and it goes on when the client is back


#: What happens to a unit, and what is said of it, for UNIT its name.
FAULTS: dict[str, tuple[Callable[[Any, str], None], str]] = {
    "alarm": (lambda faults, unit: faults.alarm(unit, 0x99, _GlobalIDL.FAULT, "too hot"), "too hot"),
    "lost": (lambda faults, unit: faults.lost(unit, True), "UNIT does not answer"),
    "stuck": (lambda faults, unit: faults.stuck(unit, True), "does not follow its servo"),
    "switch": (lambda faults, unit: faults.emergencySwitch(True), "emergency switch"),
}


@pytest.mark.parametrize(
    "case", ["alarm Mobility", "alarm GripperL", "stuck MnpL", "switch", "lost Mobility", "lost Lumbar"]
)
def test_a_unit_that_fails(place: StandIn, adaptor: SmartPalAdaptor, case: str) -> None:
    fault, _, unit = case.partition(" ")
    happens, why = FAULTS[fault]
    jog(adaptor)
    happens(place.faults, unit)
    with pytest.raises(AdaptorFailed, match=why.replace("UNIT", unit)) as failed:
        run_until_it_fails(adaptor)
    if isinstance(failed.value, UnitFailed):
        assert fault != "lost"
        assert unit in ("", failed.value.unit)  # the switch locks all of them
        adaptor.stop()
        eventually(lambda: stands(place), PATIENCE_S, "that it stands")
        place.faults.none()  # while it lasts it can't be cleared; then a start does
    else:
        begun = time.monotonic()
        with pytest.raises(AdaptorFailed, match=unit):
            adaptor.stop()
        assert (fault, time.monotonic() - begun < PATIENCE_S) == ("lost", True)  # it waits for no answer for ever
        place.faults.none()
        eventually(lambda: stands(place), PATIENCE_S, "that it stands")
    assert adaptor.start(["--naming", str(place.naming)])
    jog(adaptor)


def run_until_it_fails(adaptor: SmartPalAdaptor) -> None:
    """Goes on driving, until a read or a write raises."""
    state, wait = RobotState(), ticks(PATIENCE_S)
    while wait():
        adaptor.read(state)
        adaptor.write(ActorCommand((0.3, 0.0, 0.0), state.joints, swinging(state)))


# ---- a client of its own ----


def test_a_plain_client(place: StandIn) -> None:
    """By corbaname and the robot's own interface, step by step, as the notes of the IDL say."""
    place.faults.none()
    orb = CORBA.ORB_init([], CORBA.ORB_ID)
    mobility = orb.string_to_object(f"corbaname::{place.naming}#Mobility.Unit")._narrow(YeRTUnitMobility.mobility)
    arm = orb.string_to_object(f"corbaname::{place.naming}#MnpR")._narrow(_GlobalIDL.ArmUnit)
    assert mobility.setServo(False) and mobility.setPower(False)
    assert mobility.getState() == (True, 0x19, "Unpowered")
    assert not mobility.moveForward(100.0)
    assert not mobility.setServo(True)
    assert mobility.setPower(True)
    assert mobility.getState()[1] == 0x18
    assert mobility.setServo(True)
    eventually(lambda: mobility.getState()[1] == 0x10)
    assert mobility.setPosition(0.0, 0.0, 0.0)
    assert mobility.setVelocity(500.0, 50.0) and mobility.setAcceleration(500.0, 50.0)
    assert mobility.moveForward(500.0)  # which takes more than a second
    assert mobility.getState()[1] == 0x11
    assert not mobility.moveForward(100.0)
    eventually(lambda: mobility.getState()[1] == 0x10)
    assert mobility.getPosition()[1:] == pytest.approx((500.0, 0.0, 0.0), abs=3.0)

    arm.powerOff()
    to = [10.0, -10.0, 0.0, 20.0, 0.0, 0.0, 0.0]
    assert arm.moveJointAbs(to, 10.0) == -4
    assert arm.powerOn() == 0 and arm.servoOn() == 0
    eventually(lambda: arm.getState()[1] == 0x12)
    assert arm.moveJointAbs(to, 91.0) == -6
    assert arm.setJointAcceleration(10) == -7
    assert arm.moveJointAbs(to, 20.0) == 0  # which takes more than a second
    assert arm.getState()[1] == 0x13
    assert arm.moveJogJoint([1.0] * 7) == -2
    eventually(lambda: arm.getState()[1] == 0x12)
    code, joints = arm.getFeedbackPos(_GlobalIDL.JOINT)
    assert (code, joints) == (0, pytest.approx(to, abs=0.1))
    limits = arm.getJointSoftLimit()[1]
    assert (limits[0].upper, limits[0].lower) == pytest.approx((180.0, -45.0))


def test_faults_of_the_stand_in(place: StandIn) -> None:
    faults, lumbar = place.faults, place.unit("Lumbar", _GlobalIDL.LumbarUnit)
    for order, field in ((lambda: faults.lost("Wheel", False), "unit"), (lambda: faults.slowNetwork(6.0), "delay")):
        with pytest.raises(RoboCorba.InvalidFault) as refused:
            order()
        assert refused.value.field == field
    faults.lost("Lumbar", True)
    set_call_timeout(lumbar, 0.2)
    with pytest.raises(CORBA.TIMEOUT):
        lumbar.isMoving()
    set_call_timeout(lumbar, PATIENCE_S)
    faults.lost("Lumbar", False)  # a call that was held back ends with its fault
    assert lumbar.isMoving() in (True, False)
