"""The high controller on a robot that is one of the documentation's, in real time."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from robocorba.errors.robots import AdaptorFailed, IllegalOrder, MotionFailed, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.robot.adaptor import SIMULATION_SERVER, RobotAdaptor
from robocorba.robot.high_controller import TICK_S, Callbacks, HighController, Timing
from robocorba.robot.kinematics.smartpal import BASE_LIMITS
from robocorba.robot.motion.driving import DriveAt
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.simulation.registry import Pose
from robocorba.system.stop_latch import StopLatch
from tests.robot.places import documented_adaptor, eventually
from tests.waits import outlast, pause, stays

pytestmark = pytest.mark.slow

HERE = SimpleNamespace(session=SimpleNamespace(latest=SimpleNamespace(at=Pose("L1", 0.0, 0.0))))


THREADS = ThreadPoolExecutor()


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
        return SIMULATION_SERVER if self.is_virtual else RobotAdaptor.waits_for

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

    def hang(self) -> None:
        """Returns once a call hangs."""
        count = len(self.commands)
        self.hangs.set()
        eventually(lambda: len(self.commands) > count, "a write that hangs")

    def go_on(self) -> None:
        self.hangs.clear()
        self.goes_on.set()


@pytest.fixture
def adaptor() -> Watched:
    return Watched()


@pytest.fixture
def high(adaptor: Watched) -> Iterator[HighController]:
    high = made(adaptor)
    yield high
    adaptor.failure = None
    high.close()
    assert adaptor.stops


def driving(high: HighController) -> Future[None]:
    """A motion that is under way."""
    moving = THREADS.submit(high.move, DriveAt((0.2, 0.0, 0.0), 60.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    return moving


def works(high: HighController) -> None:
    high.move(DriveAt((0.1, 0.0, 0.0), 0.1))


def made(adaptor: Watched, *how: Any) -> HighController:
    """A controller that has started."""
    high = HighController(adaptor, *how)
    high.start(())
    return high


def test_an_idle_virtual_robot_gets_fewer_commands(high: HighController, adaptor: Watched) -> None:
    adaptor.is_virtual = True
    works(high)
    outlast(Timing.idle_after_s + 0.2)
    began, count = time.monotonic(), len(adaptor.commands)
    pause(1.0)
    most = (time.monotonic() - began) / Timing.idle_tick_s
    assert 1 <= len(adaptor.commands) - count <= most + 1
    count = len(adaptor.commands)
    high.move(DriveAt((0.1, 0.0, 0.0), 1.0))
    assert len(adaptor.commands) - count > 2 * 1.0 / Timing.idle_tick_s


def test_a_motion_ends_with_the_control_loop_and_a_reset_starts_it(high: HighController, adaptor: Watched) -> None:
    for defect, text in ((ValueError("a fault"), "ValueError: a fault"), (SystemExit(3), "SystemExit: 3")):
        moving = driving(high)
        adaptor.defect = defect
        assert f"is stopped: internal fault in 'high controller' ({text})" in str(moving.exception(60.0))
        assert text in high.stopped
        adaptor.defect = None
        stays(lambda: high.stopped, Timing.hang_limit_s)  # a loop that has ended does not hang
        high.reset_stop()
        works(high)


FAILURES = [(KeyError("it"), "KeyError: 'it'"), (SystemExit("it"), "SystemExit: it"), (AdaptorFailed("it"), "it")]


@pytest.mark.parametrize(("failure", "text"), FAILURES)
def test_an_adaptor_that_raises_anything_stops_the_robot_until_a_reset(
    high: HighController, adaptor: Watched, failure: BaseException, text: str
) -> None:
    for where in ("read", "write"):
        moving = driving(high)
        if where == "write":
            adaptor.goes_on.set()
            adaptor.hangs.set()
        adaptor.failure = failure
        assert text in str(moving.exception(60.0)) and high.stopped == text and not high.is_lost
        with pytest.raises(AdaptorFailed, match=text):
            high.reset_stop()  # its start fails
        adaptor.failure = None
        adaptor.hangs.clear()
        high.reset_stop()
        works(high)


def test_a_stop_or_loss_during_a_reset_stays_and_so_does_a_stop_that_no_server_ends(
    high: HighController, adaptor: Watched, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(number: int) -> None:
        raise RobotLost("the server does not answer")

    for _ in range(3):  # by three ways
        high.emergency_stop("button")
    assert [record.getMessage() for record in caplog.records] == ["stopped: button"]
    with pytest.raises(RobotLost):
        high.reset_stop(end=refuse)
    assert high.stopped == "button" and high.is_stop_confirmed
    high.reset_stop()
    for where in ("before_start", "before_read"):
        high.emergency_stop("first")
        setattr(adaptor, where, once(lambda: high.emergency_stop("second"))[0])
        with pytest.raises(IllegalOrder, match="was stopped again: second"):
            high.reset_stop()
        assert not adaptor.disc.read(RobotState())
        high.reset_stop()
        works(high)
    high.emergency_stop("button")
    adaptor.before_start, _ = once(lambda: high.lose("nobody answers"))
    with pytest.raises(IllegalOrder, match="was stopped again: nobody answers"):
        high.reset_stop()
    eventually(lambda: high.stopped == "", "found again")


def test_an_adaptor_that_was_stopped_after_a_reset_is_started_again(high: HighController, adaptor: Watched) -> None:
    """As by the thread of a stop that is so slow that a reset is quicker."""
    moving = driving(high)
    adaptor.stop()
    assert str(moving.exception(60.0)) == "its adaptor was stopped"
    eventually(lambda: high.stopped == "", "found again")
    works(high)


def test_commands_keep_the_cap_and_the_acceleration_and_what_ends_a_motion(
    high: HighController, adaptor: Watched
) -> None:
    high.speed_cap = 0.2
    high.move(DriveAt((5.0, 5.0, 9.0), 0.5))
    velocities = np.array([command.velocity for command in adaptor.commands])
    assert np.hypot(velocities[:, 0], velocities[:, 1]).max() == pytest.approx(0.2)
    assert np.abs(velocities[:, 2]).max() <= BASE_LIMITS.turn_speed
    turns = np.abs(np.diff(velocities[:, 2]))
    assert turns.max() <= BASE_LIMITS.turn_acceleration * TICK_S + 1e-9
    with pytest.raises(MotionFailed, match="ZeroDivisionError: of its own"):
        high.move(MagicMock(**{"command.side_effect": ZeroDivisionError("of its own")}))
    moving = driving(high)
    with pytest.raises(IllegalOrder, match="is moving"):
        works(high)
    high.cancel(MotionFailed("enough"))
    assert str(moving.exception(60.0)) == "enough"
    eventually(lambda: high.state.velocity[0] == 0.0, "standing")


def test_a_lost_robot_shows_why_it_stays_lost_and_obeys_a_stop(
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
    high.emergency_stop("button")
    assert not high.is_lost
    with pytest.raises(IllegalOrder, match="is stopped: button"):
        high.check()  # no RobotLost, after which a program would wait for it
    adaptor.failure = None
    stays(lambda: high.stopped == "button", 1.2)


def test_the_loop_shows_a_defect_of_a_lost_robot_and_who_is_silent(adaptor: Watched) -> None:
    high = made(adaptor, None, None, Timing(server_limit_s=1.0))

    def fail() -> None:
        raise SystemExit("of a library")

    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    high._calls.before_start = fail
    eventually(lambda: "SystemExit: of a library" in high.stopped, "the defect")
    high._calls.before_start, adaptor.failure = lambda: None, None
    high.reset_stop()
    works(high)
    goes_on = threading.Event()
    high._calls.on_state = lambda state: goes_on.wait(60.0)  # type: ignore[assignment, return-value]
    eventually(lambda: high.check_alive() or high.stopped != "", "noticed")
    assert high.stopped.startswith("the simulation server did not answer for ")
    goes_on.set()
    eventually(lambda: high.stopped == "", "found again")
    high.close()


@pytest.mark.parametrize("is_virtual", [True, False])
def test_a_motion_goes_on_after_a_server_that_was_silent_from_standstill(adaptor: Watched, is_virtual: bool) -> None:
    """Its silence counts neither as a pause of the robot's process nor as a hang of the adaptor."""
    timing = Timing(hang_limit_s=1.0, server_limit_s=600.0, longest_check_pause_s=600.0, pause_limit_s=1.5)
    adaptor.is_virtual = is_virtual
    high = made(adaptor, None, None, timing)
    driving(high)
    waiting = MagicMock(side_effect=lambda *state: adaptor.goes_on.wait(60.0))
    adaptor.before_read, high._calls.on_state = (waiting, MagicMock()) if is_virtual else (MagicMock(), waiting)
    eventually(lambda: waiting.called, "a call of the server")
    outlast(2 * timing.hang_limit_s)
    high.check_alive()
    assert high.awaited == "the simulation server, which does not answer"
    count = len(adaptor.commands)
    adaptor.go_on()
    eventually(lambda: len(adaptor.commands) > count + 50, "driving again")
    speeds = [abs(command.velocity[0]) for command in adaptor.commands[count:]]
    assert speeds[0] < 0.1 and max(speeds) > 0.15 and adaptor.stops == 0
    high.close()


def once(call: Callable[[], None]) -> tuple[Callable[[], None], list[bool]]:
    """A function that makes this call the first time, and then notes it."""
    done: list[bool] = []

    def first() -> None:
        if not done:
            call()
            done.append(True)

    return first, done


def test_a_stop_works_while_the_adaptor_hangs_or_fails_to_stop(high: HighController, adaptor: Watched) -> None:
    moving = driving(high)
    adaptor.hang()
    adaptor.failure, stops = AdaptorFailed("it was stopped"), adaptor.stops
    adaptor.stop_failure = KeyError("a unit")
    high.emergency_stop("button")
    assert (adaptor.stops, high.stopped, high.is_stop_confirmed) == (stops + 1, "button", False)
    assert str(moving.exception(60.0)) == "can't continue: the robot is stopped: button"
    adaptor.go_on()
    stays(lambda: high.stopped == "button", 0.2)  # what fails now is no other reason
    with pytest.raises(IllegalOrder, match="is stopped: button"):
        works(high)
    adaptor.failure = adaptor.stop_failure = None
    high.reset_stop()
    works(high)
    with pytest.raises(IllegalOrder, match="was not stopped"):
        high.reset_stop()


@pytest.mark.parametrize("hangs", [False, True])
def test_a_stop_of_the_latch_reaches_the_adaptor(adaptor: Watched, hangs: bool) -> None:
    """Whoever has set it, such as while this controller was about to replace another one."""
    latch = StopLatch()
    high = made(adaptor, latch, None, Timing(hang_limit_s=600.0))
    moving = driving(high)
    if hangs:
        adaptor.hang()
    latch.stop("button")
    assert str(moving.exception(60.0)) == "can't continue: the robot is stopped: button"
    eventually(lambda: high.is_stop_confirmed, "that it stands")
    assert adaptor.stops == 1
    adaptor.go_on()
    eventually(lambda: not any(high.state.velocity), "that its state says so")
    high.close()


def test_an_adaptor_that_starts_after_the_end_is_stopped(high: HighController, adaptor: Watched) -> None:
    adaptor.failure = RobotLost("nobody answers")
    eventually(lambda: high.stopped == "nobody answers", "lost")
    adaptor.before_start, done = once(lambda: wait([THREADS.submit(high.close)], 0.5))
    adaptor.failure = None
    eventually(lambda: done, "a reconnection")
    eventually(lambda: not adaptor.disc.read(RobotState()), "that it is stopped")


def test_an_adaptor_that_hangs_is_noticed_and_comes_back(high: HighController, adaptor: Watched) -> None:
    moving = driving(high)
    adaptor.hangs.set()
    eventually(lambda: high.check_alive() or high.stopped != "", "noticed")
    with pytest.raises(RobotLost, match="the robot's adaptor did not answer for "):
        moving.result(60.0)
    with pytest.raises(RobotLost, match="did not answer"):
        high.check()
    high.emergency_stop("button")
    with pytest.raises(AdaptorFailed, match="still hangs"):
        high.reset_stop()
    adaptor.go_on()
    ticks = len(high.late_s)
    eventually(lambda: len(high.late_s) > ticks, "ticks again")
    high.reset_stop()
    high.check()
    works(high)


@pytest.mark.parametrize(("limit_s", "where"), [(60.0, "between ticks"), (60.0, "in a call"), (1.1, "between ticks")])
def test_a_motion_goes_on_from_standstill_after_a_pause_of_its_process_unless_it_was_long(
    adaptor: Watched, limit_s: float, where: str
) -> None:
    """Meanwhile no thread attends, and the loop is between two ticks or in a call of the adaptor."""
    timing = Timing(hang_limit_s=0.5, longest_check_pause_s=0.1, check_interval_s=600.0, pause_limit_s=limit_s)
    high = made(adaptor, None, None, timing)
    moving = THREADS.submit(high.move, DriveAt((0.2, 0.0, 0.0), 2.0))
    eventually(lambda: high.state.velocity[0] > 0.1, "moving")
    paused, _ = once(lambda: pause(1.2))
    if where == "in a call":
        adaptor.before_read = paused
    else:
        high._calls.on_command = lambda state, command: paused()
    error = moving.exception(60.0)
    if limit_s > 1.2:
        assert error is None and adaptor.stops == 0
        assert np.diff([command.velocity[0] for command in adaptor.commands]).min() < -0.08
    else:
        assert "the robot's process was paused for " in str(error)
        eventually(lambda: high.stopped == "", "found again")
    high.close()


def test_the_end_ends_a_motion(adaptor: Watched) -> None:
    high = made(adaptor, None, None, Timing(hang_limit_s=1.0))
    moving = driving(high)
    high.close()
    assert str(moving.exception(60.0)) == "can't continue: the robot is switched off"
    outlast(1.0)  # hang_limit_s
    high.check_alive()
    assert high.stopped == ""


def test_a_robot_at_rest_is_read_when_somebody_asks_and_wakes_for_a_motion(adaptor: Watched) -> None:
    adaptor.is_virtual = True
    timing = Timing(rest_tick_s=600.0, refresh_limit_s=60.0)
    high = made(adaptor, None, Callbacks(rests=lambda: True), timing)
    for _ in range(2):  # a motion ends a rest, and so does the end
        high.wake()
        eventually(lambda: high._ticked_at > time.monotonic() + 500.0, "a long rest")
        state = high.state
        outlast(2 * timing.idle_tick_s)  # older than that of an idle robot
        high.refresh()
        assert high.state is not state
        high.check_alive()  # it rests, and does not hang
        assert high.stopped == ""
        eventually(lambda: high._ticked_at > time.monotonic() + 500.0, "a long rest")
        works(high)
    high.close()


def test_a_stop_at_rest_and_its_end_are_told(adaptor: Watched) -> None:
    seen: list[str] = []
    high = HighController(adaptor, None, Callbacks(rests=lambda: True, on_stop=lambda: seen.append(high.stopped)))
    high.start(())
    high.emergency_stop("button")
    high.refresh()  # at once: it is not read
    high.reset_stop()
    high.close()
    assert seen == ["", "button", ""]
