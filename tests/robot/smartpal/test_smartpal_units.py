"""Metres and radians to millimetres and degrees, and answers to errors, with units that record their calls."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.errors.robots import AdaptorFailed, UnitFailed
from robocorba.errors.services import NotReachable
from robocorba.robot.corba import remote_smartpal_units as smartpal_units
from robocorba.robot.corba.remote_smartpal_units import CALL_TIMEOUT_S, RemoteSmartPalUnits, units_at
from robocorba.robot.kinematics.smartpal import Side
from robocorba.stubs import _GlobalIDL
from robocorba.system.settings import Address, InvalidSetting

HERE = Address("127.0.0.1", 1)
FEVER = _GlobalIDL.Alarm(0x99, _GlobalIDL.FAULT, "fever")


class Notes:
    """Replaces an ORB and all units: `calls` records all calls; `answers` are those other than success."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []
        self.answers: dict[tuple[str, str], Any] = {}

    def resolve_in_other_naming_service(self, naming: Address, name: str, interface: Any, call_timeout_s: float) -> Any:
        assert naming == HERE
        assert call_timeout_s <= 0.3
        return Noting(self, name)


class Noting:
    def __init__(self, notes: Notes, unit: str) -> None:
        self._notes, self._unit = notes, unit

    def __getattr__(self, operation: str) -> Any:
        def call(*arguments: Any) -> Any:
            self._notes.calls.append((self._unit, operation, *arguments))
            answer = self._notes.answers.get((self._unit, operation), 0 if self._unit.startswith("Mnp") else True)
            if callable(answer):
                answer = answer()
            if isinstance(answer, Exception):
                raise answer
            return answer

        return call


@pytest.fixture
def notes() -> Notes:
    return Notes()


@pytest.fixture
def units(notes: Notes) -> RemoteSmartPalUnits:
    return RemoteSmartPalUnits(notes, HERE)  # type: ignore[arg-type]


def test_what_is_told_is_in_millimetres_and_degrees_and_what_is_read_in_metres_and_radians(
    notes: Notes, units: RemoteSmartPalUnits
) -> None:
    units.set_pose(1.5, -2.0, math.pi / 2)
    units.set_base_limits(1.0, math.radians(100), 0.5, math.radians(50))
    units.jog_base(0.3, -0.1, math.radians(20))
    units.jog_arm(Side.RIGHT, np.radians([1.0, 2, 3, 4, 5, 6, 7]))
    units.move_lumbar(math.radians(-3), math.radians(40), math.radians(30), math.radians(60))
    units.move_grip(Side.LEFT, math.radians(-58), math.radians(120), math.radians(480))
    units.set_arm_acceleration(0.5)
    expected: list[tuple[str, str, list[float]]] = [
        ("Mobility.Unit", "setPosition", [1500.0, -2000.0, 90.0]),
        ("Mobility.Unit", "setVelocity", [1000.0, 100.0]),
        ("Mobility.Unit", "setAcceleration", [500.0, 50.0]),
        ("Mobility.Unit", "moveJog", [300.0, -100.0, 20.0]),
        ("MnpR", "moveJogJoint", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]),
        ("Lumbar", "move", [-3.0, 40.0, 30.0, 60.0]),
        ("GripperL", "move", [-58.0, 120.0, 480.0]),
    ]
    for call, (unit, operation, values) in zip(notes.calls, expected, strict=False):
        assert call[:2] == (unit, operation)
        assert np.hstack(call[2:]) == pytest.approx(values)
    assert {call[2] for call in notes.calls[len(expected) :]} == {500}
    units.set_jog_timeout(0.12)
    assert {call[2] for call in notes.calls[-3:]} == {120}
    notes.answers = {
        ("Mobility.Unit", "getPosition"): (True, 1500.0, -250.0, 180.0),
        ("MnpL", "getFeedbackPos"): (0, [90.0, 0, 0, 0, 0, 0, -90.0]),
        ("Lumbar", "getFeedback"): (True, -9.0, 18.0),
        ("GripperR", "getFeedback"): (True, -36.0),
    }
    assert units.pose() == pytest.approx((1.5, -0.25, math.pi))
    assert units.arm(Side.LEFT) == pytest.approx([math.pi / 2, 0, 0, 0, 0, 0, -math.pi / 2])
    assert units.lumbar() == pytest.approx([-math.pi / 20, math.pi / 10])
    assert units.grip(Side.RIGHT) == pytest.approx(-math.pi / 5)


def test_a_refusal_names_unit_code_and_reason(notes: Notes, units: RemoteSmartPalUnits) -> None:
    notes.answers = {
        ("MnpR", "moveJogJoint"): -6,
        ("MnpR", "getActiveAlarm"): (0, 0, []),
        ("MnpR", "getState"): (0, 0x12, "Ready"),
        ("Mobility.Unit", "moveJog"): False,
        ("Mobility.Unit", "getActiveAlarm"): (True, 1, [FEVER]),
        ("GripperL", "isServoOn"): False,
        ("GripperL", "getActiveAlarm"): (True, 1, [FEVER]),
        ("Lumbar", "getState"): (True, 0x15, "Alarm"),
        ("Lumbar", "getActiveAlarm"): (True, 1, [FEVER]),
    }
    with pytest.raises(UnitFailed, match="greatest velocity") as fast:
        units.jog_arm(Side.RIGHT, np.zeros(7))
    assert (fast.value.unit, fast.value.code) == ("MnpR", -6)
    with pytest.raises(UnitFailed, match="fever") as refused:
        units.jog_base(0.0, 0.0, 0.0)
    assert refused.value.unit == "Mobility"
    for unit, code in (("GripperL", -1), ("Lumbar", 0x15)):
        with pytest.raises(UnitFailed, match="fever") as failed:
            units.check(unit)
        assert (failed.value.unit, failed.value.code) == (unit, code)
    for warning in (-100, -101):
        notes.answers[("MnpR", "moveJogJoint")] = warning
        units.jog_arm(Side.RIGHT, np.zeros(7))
    notes.answers[("GripperL", "getFeedback")] = CORBA.COMM_FAILURE()
    with pytest.raises(AdaptorFailed, match="GripperL does not answer"):
        units.grip(Side.LEFT)


@pytest.mark.parametrize(("paused_s", "calls"), [(0.0, 1), (0.1, 2), (2.0, 1)])
def test_a_call_is_repeated_only_after_a_short_pause_of_this_process(
    notes: Notes, units: RemoteSmartPalUnits, monkeypatch: pytest.MonkeyPatch, paused_s: float, calls: int
) -> None:
    now = [0.0]
    monkeypatch.setattr(smartpal_units, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def answer() -> Any:
        now[0] += CALL_TIMEOUT_S + paused_s
        return CORBA.TIMEOUT() if len(notes.calls) == 1 else (True, 90.0)

    notes.answers = {("GripperL", "getFeedback"): answer}
    if calls == 2:
        assert units.grip(Side.LEFT) == pytest.approx(math.pi / 2)
    else:
        with pytest.raises(AdaptorFailed, match="GripperL does not answer"):
            units.grip(Side.LEFT)
    assert len(notes.calls) == calls


def test_a_unit_that_is_not_to_be_found() -> None:
    orb = MagicMock(**{"resolve_in_other_naming_service.side_effect": NotReachable("Mobility.Unit is not known")})
    with pytest.raises(AdaptorFailed, match=r"Mobility\.Unit is not known"):
        RemoteSmartPalUnits(orb, HERE)
    with pytest.raises(InvalidSetting):
        units_at(orb)("nowhere")
