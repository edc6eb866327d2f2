"""The high controller on a robot that is one of the documentation's, in real time."""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from robocorba.control import high_controller
from robocorba.control.adaptor import RobotAdaptor
from robocorba.control.high_controller import IDLE_AFTER_S, IDLE_TICK_S, TICK_S, VALID_S, HighController
from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.kinematics.smartpal import BASE_LIMITS, JOINT_LOWER, JOINT_SPEED, JOINT_UPPER
from robocorba.motion.driving import Drive, DriveAt
from robocorba.motion.motion import MotionCommand
from robocorba.motion.robot_state import ActorCommand, RobotState
from robocorba.simulation.registry import Pose
from robocorba.stop_latch import StopLatch
from tests.control.places import controller, documented_adaptor, eventually
from tests.waits import outlast, pause, stays

pytestmark = pytest.mark.slow

HERE = SimpleNamespace(session=SimpleNamespace(latest=SimpleNamespace(at=Pose("L1", 0.0, 0.0))))


class Watched(RobotAdaptor):
    """Wraps the documented adaptor; records commands, and fails with `failure`."""

    def __init__(self) -> None:
        self.disc = documented_adaptor()(HERE)  # type: ignore[arg-type]
        self.commands: list[ActorCommand] = []
        self.failure: BaseException | None = None
        self.starts = self.stops = 0
        self.stop_failure: Exception | None = None
        self.defect: BaseException | None = None
        self.is_virtual = False
        self.hangs = threading.Event()
        self.goes_on = threading.Event()
        #: What happens at the same time, before the adaptor has started, and before it is read.
        self.before_start: Callable[[], None] = lambda: None
        self.before_read: Callable[[], None] = lambda: None

    @property
    def is_in_building(self) -> bool:  # type: ignore[override]
        """Asked by the control loop, between the calls of the adaptor."""
        if self.defect:
            raise self.defect
        return self.is_virtual

    @property
    def waits_for(self) -> str:  # type: ignore[override]
        """The same, also while it moves."""
        if self.defect:
            raise self.defect
        return "the robot's adaptor"

    def start(self, argv: Sequence[str]) -> bool:
        self.starts += 1
        if self.failure:
            raise self.failure
        self.before_start()
        return self.disc.start(argv)

    def stop(self) -> bool:
        self.stops += 1
        if self.stop_failure:
            raise self.stop_failure
        return self.disc.stop()

    def read(self, state: RobotState) -> bool:
        if self.failure:
            raise self.failure
        self.before_read()
        return self.disc.read(state)

    def write(self, command: ActorCommand) -> bool:
        self.commands.append(command)
        if self.hangs.is_set():
            self.goes_on.wait(60.0)
            if self.failure:
                raise self.failure
        return self.disc.write(command)


@pytest.fixture
def adaptor() -> Watched:
    return Watched()


@pytest.fixture
def high(adaptor: Watched) -> Iterator[HighController]:
    high = controller(adaptor)
    high.start(())
    yield high
    adaptor.failure = None
    high.close()
    assert adaptor.stops


def in_background(call: Any, *arguments: Any) -> tuple[threading.Thread, list[Exception]]:
    raised: list[Exception] = []

    def run() -> None:
        try:
            call(*arguments)
        except Exception as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, raised


def test_a_motion_ends_where_it_shall(high: HighController) -> None:
    high.move(Drive([(0.3, 0.1)], None, 1.0, BASE_LIMITS))
    assert (high.state.x, high.state.y) == pytest.approx((0.3, 0.1), abs=0.003)


def test_commands_keep_the_cap_and_the_acceleration(high: HighController, adaptor: Watched) -> None:
    high.speed_cap = 0.2
    high.move(DriveAt((5.0, 5.0, 9.0), 0.5))
    velocities = np.array([command.velocity for command in adaptor.commands])
    assert np.hypot(velocities[:, 0], velocities[:, 1]).max() == pytest.approx(0.2)
    assert np.abs(velocities[:, 2]).max() <= BASE_LIMITS.turn_speed
    turns = np.abs(np.diff(velocities[:, 2]))
    assert turns.max() <= BASE_LIMITS.turn_acceleration * TICK_S + 1e-9


def test_an_idle_virtual_robot_gets_fewer_commands(high: HighController, adaptor: Watched) -> None:
    adaptor.is_virtual = True
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))
    outlast(IDLE_AFTER_S + 0.2)
    began, count = time.monotonic(), len(adaptor.commands)
    pause(1.0)
    most = (time.monotonic() - began) / IDLE_TICK_S
    assert 1 <= len(adaptor.commands) - count <= most + 1
    count = len(adaptor.commands)
    high.move(DriveAt((0.1, 0.0, 0.0), 1.0))
    assert len(adaptor.commands) - count > 2 * 1.0 / IDLE_TICK_S


def test_a_control_loop_that_ends_by_a_defect_stops_the_robot(high: HighController, adaptor: Watched) -> None:
    adaptor.defect = ValueError("a fault")
    eventually(lambda: bool(high.stopped), "the stop")
    assert "internal fault in 'high controller' (ValueError: a fault)" in high.stopped
    eventually(lambda: adaptor.stops > 0, "the adaptor's stop")
    with pytest.raises(IllegalOrder, match="is stopped: internal fault"):
        high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_motion_ends_with_the_defect_of_the_control_loop_and_a_reset_starts_another_loop(
    high: HighController, adaptor: Watched
) -> None:
    for defect, text in ((ValueError("a fault"), "ValueError: a fault"), (SystemExit(3), "SystemExit: 3")):
        thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
        eventually(lambda: high.state.velocity[0] > 0.1, "moving")
        adaptor.defect = defect
        thread.join(60.0)
        assert f"is stopped: internal fault in 'high controller' ({text})" in str(raised[0])
        assert text in high.stopped
        adaptor.defect = None
        stays(lambda: high.stopped, high_controller.HANG_LIMIT_S)  # a loop that has ended does not hang
        high.reset_stop()
        high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_defect_of_the_loop_is_shown_also_if_the_robot_was_lost(high: HighController, adaptor: Watched) -> None:
    def fail() -> None:
        raise SystemExit("of a library")

    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    high._before_start = fail
    eventually(lambda: "SystemExit: of a library" in high.stopped, "the defect")
    high._before_start, adaptor.failure = lambda: None, None
    high.reset_stop()
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


@pytest.mark.parametrize("failure", [KeyError("joint"), SystemExit("joint")])
def test_an_adaptor_may_raise_anything_in_a_cycle(
    high: HighController, adaptor: Watched, failure: BaseException
) -> None:
    for where in ("read", "write"):
        thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
        eventually(lambda: high.state.velocity[0] > 0.1, "moving")
        if where == "read":
            adaptor.failure = failure
        else:
            adaptor.goes_on.set()
            adaptor.hangs.set()
            adaptor.failure = failure
        thread.join(60.0)
        assert type(failure).__name__ in str(raised[0])
        assert type(failure).__name__ in high.stopped
        with pytest.raises(AdaptorFailed, match=f"{type(failure).__name__}: "):
            high.reset_stop()  # its start fails
        adaptor.failure = None
        adaptor.hangs.clear()
        high.reset_stop()
        high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_stop_ends_the_motion_even_if_the_adaptor_fails_to_stop(high: HighController, adaptor: Watched) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.stop_failure = KeyError("a unit")
    high.emergency_stop("button")
    thread.join(60.0)
    assert "is stopped: button" in str(raised[0])
    assert not high.is_stop_confirmed
    adaptor.stop_failure = None


def test_an_adaptor_that_was_stopped_after_a_reset_is_started_again(high: HighController, adaptor: Watched) -> None:
    """As by the thread of a stop that is so slow that a reset is quicker."""
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.stop()
    thread.join(60.0)
    assert str(raised[0]) == "its adaptor was stopped"
    eventually(lambda: high.stopped == "", "found again")
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_motion_that_fails_is_reported_and_the_robot_stops(high: HighController) -> None:
    class Wrong:
        def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
            raise ZeroDivisionError("of its own")

    with pytest.raises(MotionFailed, match="ZeroDivisionError: of its own"):
        high.move(Wrong())
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_limit_of_time_ends_a_motion(high: HighController) -> None:
    with pytest.raises(MotionFailed, match=r"not done within 0\.2 s"):
        high.move(DriveAt((0.1, 0.0, 0.0), 60.0), 0.2)


def test_one_motion_at_a_time(high: HighController) -> None:
    thread, raised = in_background(high.move, DriveAt((0.1, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.05, "moving")
    with pytest.raises(IllegalOrder, match="is moving"):
        high.move(DriveAt((0.1, 0.0, 0.0), 1.0))
    high.cancel(MotionFailed("enough"))
    thread.join(60.0)
    assert [str(error) for error in raised] == ["enough"]
    eventually(lambda: high.state.velocity[0] == 0.0, "standing")


def test_a_pause_takes_no_time_of_the_motion(high: HighController) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 1.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    high.is_paused = True
    eventually(lambda: high.state.velocity[0] == 0.0, "standing")
    stays(thread.is_alive, 1.2)
    high.is_paused = False
    thread.join(60.0)
    assert not thread.is_alive() and raised == []


def test_an_emergency_stop_works_while_the_adaptor_hangs(high: HighController, adaptor: Watched) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.hangs.set()
    stops = adaptor.stops
    high.emergency_stop("button")
    assert adaptor.stops == stops + 1
    assert high.stopped == "button"
    thread.join(60.0)
    assert [str(error) for error in raised] == ["can't continue: the robot is stopped: button"]
    adaptor.hangs.clear()
    adaptor.goes_on.set()
    with pytest.raises(IllegalOrder, match="is stopped: button"):
        high.move(DriveAt((0.2, 0.0, 0.0), 1.0))
    high.reset_stop()
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))
    with pytest.raises(IllegalOrder, match="was not stopped"):
        high.reset_stop()


def test_a_robot_that_fails_is_stopped_until_somebody_lets_it_go(high: HighController, adaptor: Watched) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.failure = AdaptorFailed("the arm smokes")
    thread.join(60.0)
    assert "the arm smokes" in str(raised[0])
    adaptor.failure = None
    stays(lambda: high.stopped == "the arm smokes", 0.7)
    high.reset_stop()
    assert high.stopped == ""


def test_a_robot_that_was_lost_is_found_again(high: HighController, adaptor: Watched) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.failure = RobotLost("nobody answers")
    thread.join(60.0)
    assert isinstance(raised[0], RobotLost)
    assert high.stopped == "nobody answers"
    adaptor.failure = None
    eventually(lambda: high.stopped == "", "found again")
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_lost_robot_shows_why_it_stays_lost(
    high: HighController, adaptor: Watched, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    adaptor.failure = NotReachable("the name is taken")  # no RobotError
    attempts = adaptor.starts
    eventually(lambda: adaptor.starts > attempts + 2, "attempts")
    assert high.stopped == "nobody answers; it can't reconnect: the name is taken"
    assert sum("the name is taken" in record.getMessage() for record in caplog.records) == 1
    adaptor.failure = None
    eventually(lambda: high.stopped == "", "found again")


def test_a_lost_robot_that_was_stopped_by_hand_stays_so(high: HighController, adaptor: Watched) -> None:
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    high.emergency_stop("button")
    assert not high.is_lost
    with pytest.raises(IllegalOrder, match="is stopped: button"):
        high.check()  # no RobotLost, after which a program would wait for it
    adaptor.failure = None
    stays(lambda: high.stopped == "button", 1.2)


def once(call: Callable[[], None]) -> tuple[Callable[[], None], list[bool]]:
    """A function that makes this call the first time, and then notes it."""
    done: list[bool] = []

    def first() -> None:
        if not done:
            call()
            done.append(True)

    return first, done


def test_a_stop_while_a_lost_robot_reconnects_stays(high: HighController, adaptor: Watched) -> None:
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    adaptor.before_start, done = once(lambda: high.emergency_stop("button"))
    adaptor.failure = None
    eventually(lambda: done, "a reconnection")
    eventually(lambda: high.is_stop_confirmed, "that it stands")  # it has started, and is stopped at once
    assert (high.stopped, high.is_lost) == ("button", False)
    state = RobotState()
    assert not adaptor.disc.read(state)
    with pytest.raises(IllegalOrder, match="is stopped: button"):
        high.move(DriveAt((0.2, 0.0, 0.0), 1.0))
    high.reset_stop()
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


@pytest.mark.parametrize("where", ["before_start", "before_read"])
def test_a_stop_during_a_reset_is_not_reset_by_it(high: HighController, adaptor: Watched, where: str) -> None:
    high.emergency_stop("first")
    call, _ = once(lambda: high.emergency_stop("second"))
    setattr(adaptor, where, call)
    with pytest.raises(IllegalOrder, match="was stopped again: second"):
        high.reset_stop()
    assert high.stopped == "second"
    assert not adaptor.disc.read(RobotState())
    high.reset_stop()
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_loss_during_a_reset_is_no_end_of_it(high: HighController, adaptor: Watched) -> None:
    high.emergency_stop("button")
    adaptor.before_start, _ = once(lambda: high.lose("nobody answers"))
    with pytest.raises(IllegalOrder, match="was stopped again: nobody answers"):
        high.reset_stop()
    eventually(lambda: high.stopped == "", "found again")


def test_a_reset_that_is_refused_elsewhere_leaves_the_robot_stopped(high: HighController, adaptor: Watched) -> None:
    high.emergency_stop("button")

    def refuse(number: int) -> None:
        raise RobotLost("the server does not answer")

    with pytest.raises(RobotLost):
        high.reset_stop(end=refuse)
    assert high.stopped == "button" and high.is_stop_confirmed
    assert not adaptor.disc.read(RobotState())


def test_a_stop_of_the_latch_reaches_the_adaptor(adaptor: Watched) -> None:
    """Whoever has set it, such as while this controller was about to replace another one."""
    latch = StopLatch()
    high = HighController(adaptor, BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, stops=latch)
    high.start(())
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    latch.stop("button")
    thread.join(60.0)
    assert [str(error) for error in raised] == ["can't continue: the robot is stopped: button"]
    eventually(lambda: high.is_stop_confirmed, "that it stands")
    high.close()


def test_a_stop_of_the_latch_reaches_an_adaptor_that_hangs(adaptor: Watched) -> None:
    latch = StopLatch()
    high = HighController(adaptor, BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, stops=latch, hang_limit_s=600.0)
    high.start(())
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    count = len(adaptor.commands)
    adaptor.hangs.set()
    eventually(lambda: len(adaptor.commands) > count, "a write that hangs")
    latch.stop("button")
    thread.join(30.0)
    assert [str(error) for error in raised] == ["can't continue: the robot is stopped: button"]
    assert adaptor.stops == 1
    adaptor.hangs.clear()
    adaptor.goes_on.set()
    high.close()


def test_a_controller_of_a_stopped_robot_starts_and_stops_its_adaptor(adaptor: Watched) -> None:
    latch = StopLatch()
    latch.stop("button")
    high = HighController(adaptor, BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, stops=latch)
    high.start(())
    assert high.stopped == "button" and high.is_stop_confirmed
    assert not adaptor.disc.read(RobotState())
    high.close()


def test_an_adaptor_that_starts_after_the_end_is_stopped(high: HighController, adaptor: Watched) -> None:
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    adaptor.before_start, done = once(lambda: in_background(high.close)[0].join(0.5))
    adaptor.failure = None
    eventually(lambda: done, "a reconnection")
    eventually(lambda: not adaptor.disc.read(RobotState()), "that it is stopped")


def test_a_fault_of_an_adaptor_stops_the_robot(high: HighController, adaptor: Watched) -> None:
    adaptor.failure = KeyError("joint")
    eventually(lambda: high.stopped == "KeyError: 'joint'", "stopped")


def test_an_adaptor_that_hangs_is_noticed_and_comes_back(high: HighController, adaptor: Watched) -> None:
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    adaptor.hangs.set()
    eventually(lambda: high.check_alive() or high.stopped != "", "noticed")
    thread.join(60.0)
    assert isinstance(raised[0], RobotLost) and "the robot's adaptor did not answer for " in str(raised[0])
    with pytest.raises(RobotLost, match="did not answer"):
        high.check()
    high.emergency_stop("button")
    with pytest.raises(AdaptorFailed, match="still hangs"):
        high.reset_stop()
    adaptor.hangs.clear()
    adaptor.goes_on.set()
    ticks = len(high.late_s)
    eventually(lambda: len(high.late_s) > ticks, "ticks again")
    high.reset_stop()
    high.check()
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def test_a_call_to_the_simulation_server_that_is_held_up_is_no_fault_of_the_adaptor(
    high: HighController, adaptor: Watched
) -> None:
    goes_on = threading.Event()
    high._on_state = lambda state: goes_on.wait(60.0)
    eventually(lambda: high.check_alive() or high.stopped != "", "noticed")
    assert high.stopped.startswith("the simulation server did not answer for ")
    goes_on.set()
    eventually(lambda: high.stopped == "", "found again")


class Paused:
    """A controller whose process can be paused: meanwhile no thread attends, and the loop is between two ticks or in a
    call of the adaptor."""

    def __init__(self, adaptor: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(high_controller, "LONGEST_CHECK_PAUSE_S", 0.1)
        monkeypatch.setattr(high_controller, "CHECK_INTERVAL_S", 600.0)
        self.adaptor, self.pause_s = adaptor, 0.0
        self._sleep = time.sleep
        monkeypatch.setattr(high_controller.time, "sleep", self.sleep)
        limits = BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED
        self.high = HighController(adaptor, *limits, hang_limit_s=1.0)
        self.high.start(())
        self.thread, self.raised = in_background(self.high.move, DriveAt((0.2, 0.0, 0.0), 2.0))
        eventually(lambda: self.high.state.velocity[0] > 0.1, "moving")

    def sleep(self, seconds: float) -> None:
        pause_s, is_loop = self.pause_s, threading.current_thread().name == "high controller"
        if is_loop:
            self.pause_s = 0.0
        self._sleep(seconds + pause_s * is_loop)

    def pause(self, seconds: float, where: str) -> None:
        if where == "between ticks":
            self.pause_s = seconds
            eventually(lambda: not self.pause_s, "the pause")
        else:
            self.adaptor.before_read, _ = once(lambda: self._sleep(seconds))
        self.thread.join(60.0)


@pytest.mark.parametrize("where", ["between ticks", "in a call"])
def test_after_a_short_pause_of_the_process_the_robot_stops_and_goes_on(
    adaptor: Watched, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    monkeypatch.setattr(high_controller, "PAUSE_LIMIT_S", 60.0)
    paused = Paused(adaptor, monkeypatch)
    paused.pause(1.2, where)
    assert paused.raised == []
    assert adaptor.stops == adaptor.starts - 1 >= 1
    paused.high.close()


def test_after_a_long_pause_of_the_process_the_motion_has_failed(
    adaptor: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(high_controller, "PAUSE_LIMIT_S", 1.1)
    paused = Paused(adaptor, monkeypatch)
    paused.pause(1.2, "between ticks")
    assert "the robot's process was paused for " in str(paused.raised[0])
    eventually(lambda: paused.high.stopped == "", "found again")
    paused.high.close()


def test_a_motion_does_not_run_ahead_while_no_tick_comes(high: HighController, adaptor: Watched) -> None:
    class Watching:
        def __init__(self) -> None:
            self.elapsed: list[float] = []

        def command(self, state: RobotState, elapsed_s: float) -> MotionCommand | None:
            self.elapsed.append(elapsed_s)
            return MotionCommand() if elapsed_s < 0.6 else None

    watching = Watching()
    thread, _ = in_background(high.move, watching)
    eventually(lambda: len(watching.elapsed) > 5, "running")
    adaptor.hangs.set()
    pause(0.5)
    adaptor.hangs.clear()
    adaptor.goes_on.set()
    thread.join(60.0)
    assert max(np.diff(watching.elapsed)) <= VALID_S + 1e-6


def test_what_fails_because_the_robot_is_stopped_is_no_other_reason(high: HighController, adaptor: Watched) -> None:
    adaptor.hangs.set()
    count = len(adaptor.commands)
    eventually(lambda: len(adaptor.commands) > count, "a write that hangs")
    adaptor.failure = AdaptorFailed("it was stopped")
    high.emergency_stop("button")
    adaptor.hangs.clear()
    adaptor.goes_on.set()
    stays(lambda: high.stopped == "button", 0.2)


def test_a_bug_in_the_start_of_an_adaptor_has_a_name(adaptor: Watched) -> None:
    adaptor.failure = ZeroDivisionError("a bug")
    with pytest.raises(AdaptorFailed, match="ZeroDivisionError: a bug"):
        controller(adaptor).start(())


def test_each_start_is_prepared(adaptor: Watched) -> None:
    prepared: list[bool] = []
    high = HighController(
        adaptor, BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, before_start=lambda: prepared.append(True)
    )
    high.start(())
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    adaptor.failure = None
    eventually(lambda: high.stopped == "", "found again")
    high.close()
    assert len(prepared) >= 2


def test_the_end_ends_a_motion(adaptor: Watched) -> None:
    high = HighController(adaptor, BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED, hang_limit_s=1.0)
    high.start(())
    thread, raised = in_background(high.move, DriveAt((0.2, 0.0, 0.0), math.inf))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    high.close()
    thread.join(60.0)
    assert [str(error) for error in raised] == ["can't continue: the robot is switched off"]
    outlast(1.0)  # hang_limit_s
    high.check_alive()
    assert high.stopped == ""


@pytest.fixture
def resting(adaptor: Watched) -> Iterator[HighController]:
    """A controller that rests."""
    adaptor.is_virtual = True
    limits = BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED
    high = HighController(adaptor, *limits, rests=lambda: True)
    high.start(())
    eventually(lambda: high.is_idle, "idle")
    yield high
    high.close()


def test_a_robot_at_rest_is_read_when_somebody_asks(
    resting: HighController, adaptor: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(high_controller, "REST_TICK_S", 600.0)
    monkeypatch.setattr(high_controller, "REFRESH_LIMIT_S", 60.0)
    resting.wake()
    eventually(lambda: resting._ticked_at > time.monotonic() + 500.0, "a long rest")
    state = resting.state
    outlast(2 * high_controller.IDLE_TICK_S)  # older than that of an idle robot
    resting.refresh()
    assert resting.state is not state
    resting.check_alive()  # it rests, and does not hang
    assert resting.stopped == ""


def test_a_motion_ends_the_rest(resting: HighController, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(high_controller, "REST_TICK_S", 600.0)
    resting.wake()
    eventually(lambda: resting._ticked_at > time.monotonic() + 500.0, "a long rest")
    resting.move(DriveAt((0.1, 0.0, 0.0), 0.1))
    resting.close()  # as does the end


def test_a_stop_at_rest_and_its_end_are_told(adaptor: Watched) -> None:
    seen: list[str] = []
    limits = BASE_LIMITS, JOINT_LOWER, JOINT_UPPER, JOINT_SPEED
    stopped_one = HighController(adaptor, *limits, rests=lambda: True, on_stop=lambda: seen.append(stopped_one.stopped))
    stopped_one.start(())
    stopped_one.emergency_stop("button")
    stopped_one.refresh()  # at once: it is not read
    stopped_one.reset_stop()
    stopped_one.close()
    assert seen == ["", "button", ""]
