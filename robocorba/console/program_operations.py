"""Operations of the program page: schema and examples, check, run, adaptors, the arm poser."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from robocorba.console.arguments import InvalidArguments, is_number
from robocorba.console.operations import RESOLVE_TIMEOUT_S
from robocorba.errors.robots import InvalidProgram, Unreachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.orb.orb import Orb
from robocorba.robot.corba.remote_agent import RemoteAgent
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import JOINTS, Side
from robocorba.robot.kinematics.tasks import POSTURES
from robocorba.robot.programs import program as programs
from robocorba.robot.programs.program import Program
from robocorba.robot.programs.python_source import python_source
from robocorba.robot.programs.report import CheckReport
from robocorba.system.settings import Address

if TYPE_CHECKING:
    from robocorba.robot.kinematics.inverse import InverseKinematics

#: Maximum length of an adaptor's arguments together [characters].
MAX_ARGUMENTS = 2000

Answer = dict[str, Any]
Pose = dict[str, float]


class ProgramOperations:
    """Operations of the program page. `robot` is a robot's name, `program` the JSON text of a program file. All of
    them raise NotReachable if the robot does not answer.

    folder: of programs beside the samples. Poses of hands are in the robot's frame [m, rad] with the keys x, y, z,
    roll, pitch, yaw; joints are 18 angles [rad] in the order of the model."""

    def __init__(self, orb: Orb, agent: Callable[[str], RemoteAgent] | None = None, folder: Path | None = None) -> None:
        self._agent = agent or (lambda robot: RemoteAgent(orb, robot, RESOLVE_TIMEOUT_S))
        self._folders = [*([folder] if folder else []), Path(str(files("robocorba") / "samples"))]
        self._lock = threading.Lock()
        self._inverse: InverseKinematics | None = None

    # ---- what there is ----

    def program_schema(self) -> Answer:
        """`schema`: the JSON schema of program files. `postures`: names of the arms' postures."""
        return {"schema": programs.schema(), "postures": list(POSTURES)}

    def example_programs(self) -> dict[str, str]:
        """The programs of the console's folder and the samples: JSON text by name."""
        found: dict[str, str] = {}
        for file in [file for folder in self._folders for file in sorted(folder.glob("*.json"))]:
            if file.stem not in found:
                found[file.stem] = file.read_text()
        return found

    def loaded_program(self, robot: str) -> str:
        """The JSON text of the program that a robot has loaded; empty if there is none."""
        return self._agent(robot).program()

    def loaded_name(self, robot: str) -> str:
        """The name of that program; empty if there is none."""
        text = self.loaded_program(robot)
        return programs.loads(text).name if text else ""

    # ---- check and run ----

    def check_program(self, robot: str, program: str) -> Answer:
        """Check a program from a robot's present state; without a robot only its form.

        `findings`: each with `kind` (error or note), `icon` (its path), `parameter` and `reason`. `python`: the
        program as Python; empty if it can't be read."""
        try:
            read = programs.loads(program)
        except InvalidProgram as error:
            return _checked(CheckReport(error), None)
        if robot:
            return _checked(self._agent(robot).check(program), read)
        report = CheckReport()
        report.add_note("", "no robot is chosen: drives and arms are not checked")
        return _checked(report, read)

    def run_program(self, robot: str, program: str, step: bool = False, first: int = 0) -> None:
        """Load a program and run it from icon `first` on; with `step` it pauses before each icon. Raises InvalidProgram
        (whose icons count from `first`), IllegalOrder."""
        wanted = program
        if first:
            read = programs.loads(program)
            if not 0 < first < len(read.icons):
                raise InvalidArguments(f"the program has no icon {first}; it has {len(read.icons)}")
            wanted = programs.dumps(msgspec.structs.replace(read, icons=read.icons[first:]))
        agent = self._agent(robot)
        agent.load(wanted)
        agent.run(step)

    def pause_program(self, robot: str) -> None:
        """Let the robot slow down and wait. Raises IllegalOrder if it runs no program."""
        self._agent(robot).pause()

    def resume_program(self, robot: str) -> None:
        """Continue a paused program. Raises IllegalOrder if the robot runs none."""
        self._agent(robot).resume()

    def step_program(self, robot: str) -> None:
        """Continue a paused program up to the next icon. Raises IllegalOrder if the robot runs none."""
        self._agent(robot).step()

    def abort_program(self, robot: str) -> None:
        """End a robot's program; the robot slows down and stops."""
        self._agent(robot).abort()

    def jog(self, robot: str, ahead: float, left: float, turn: float) -> None:
        """Drive ahead and to the left [m/s] and turn [rad/s] for 0.5 s or until the next call. Raises IllegalOrder if
        another program runs."""
        self._agent(robot).drive((ahead, left, turn), 0.5)

    def answer_question(self, robot: str, number: int, yes: bool) -> None:
        """Answer what a robot's program asks. Raises IllegalOrder if it does not ask this question at present."""
        if not 0 <= number < 2**32:
            raise InvalidArguments(f"number: {number} is none of a question")
        self._agent(robot).answer(number, yes)

    def program_progress(self, robot: str, first: int) -> Answer:
        """`begun`: icons of the present or last program that have begun from number `first` on, each with `number`,
        `icon` (its path) and `kind`. `report`: `name`, `result` (no_result while it runs), `icon`, `reason`,
        `icons_done`, `seconds`. `condition`, `reason` (why the robot is stopped) and `adaptor` of the robot."""
        agent = self._agent(robot)
        state = agent.state()  # before the icons, so that all icons of an ended program are among them
        begun = agent.begun(first)
        return {
            "begun": [{"number": icon.number, "icon": icon.icon, "kind": icon.kind} for icon in begun],
            "report": state.program.plain(),
            "condition": state.condition.name.lower(),
            "reason": state.reason,
            "adaptor": state.adaptor,
        }

    # ---- virtual and actual robot ----

    def adaptors(self, robot: str) -> list[str]:
        """Names of the adaptors that a robot can switch to."""
        return self._agent(robot).adaptors()

    def switch_adaptor(self, robot: str, adaptor: str, arguments: list[str] | None = None) -> None:
        """Connect another robot to a robot's agent. Raises UnknownAdaptor, AdaptorFailed; IllegalOrder while a program
        runs."""
        words = arguments or []
        if sum(map(len, words)) > MAX_ARGUMENTS:
            raise InvalidArguments(f"arguments of an adaptor have at most {MAX_ARGUMENTS} characters together")
        self._agent(robot).switch(adaptor, words)

    # ---- a robot's own computer ----

    def reach_computer(self, host: str, port: int) -> Answer:
        """The agent on a robot's own computer: `name`, `adaptor`, `sensors` (names), `display` (text), and all
        `reports` that it has kept, each with `number`, `upload`, `ended` (POSIX time [s]) and `program`."""
        agent = self._agent(_address(host, port))
        reports, _ = agent.reports("")
        return {
            "name": agent.name,
            "adaptor": agent.state().adaptor,
            "sensors": agent.sensors(),
            "display": agent.display().text,
            "reports": [each.plain() for each in reports],
        }

    def upload_program(self, host: str, port: int, program: str, robot: str = "", run: bool = False) -> Answer:
        """Upload a program to a robot's own computer, checked by `robot`, by default by that itself; `run`: and run it.
        `name` of the robot there, and `number` of the upload.

        Raises InvalidProgram, IllegalOrder, FingerprintMismatch."""
        target = self._agent(_address(host, port))
        checker = self._agent(robot) if robot else target
        checked = checker.fingerprint(program)
        checker.check(program).require_valid()
        number = target.upload(program, checked)
        if run:
            target.run()
        return {"name": target.name, "number": number}

    # ---- the arm poser ----

    def solve_hand(
        self,
        joints: Sequence[float],
        side: str,
        pose: Mapping[str, float],
        with_attitude: bool = True,
        use_lumbar: bool = False,
    ) -> dict[str, object]:
        """`joints` that bring a hand to a pose, as near to the given ones as possible, and both `hands` there.

        side: left, right, or both: the pose is the left hand's, the right hand mirrors it. Raises Unreachable."""
        seed, target = _joints(joints), _pose(pose)
        targets = {Side.LEFT: target, Side.RIGHT: target.mirrored()} if side == "both" else {_side(side): target}
        with self._lock:
            inverse = self._solver()
            options = {"with_attitude": bool(with_attitude), "use_lumbar": bool(use_lumbar)}
            try:
                found = inverse.solve(targets, seed, allow_restarts=False, **options)
            except Unreachable:
                found = inverse.solve(targets, seed, **options)
            return {"joints": found.tolist(), "hands": _hands(inverse, found)}

    def hand_poses(self, joints: Sequence[float]) -> dict[str, Pose]:
        """Poses of the `left` and the `right` hand."""
        checked = _joints(joints)
        with self._lock:
            return _hands(self._solver(), checked)

    def arm_postures(self) -> dict[str, list[float]]:
        """The named postures: 7 angles of an arm each [rad]."""
        return {name: posture.tolist() for name, posture in POSTURES.items()}

    def _solver(self) -> InverseKinematics:
        if self._inverse is None:
            from robocorba.robot.kinematics.inverse import InverseKinematics  # here, since it loads kernels

            self._inverse = InverseKinematics()
        return self._inverse


def _checked(report: CheckReport, read: Program | None) -> Answer:
    errors = [
        {"kind": "error", "icon": found.icon, "parameter": found.parameter, "reason": found.reason}
        for found in report.findings
    ]
    notes = [{"kind": "note", "icon": note.icon, "parameter": "", "reason": note.what} for note in report.notes]
    return {"findings": errors + notes, "python": python_source(read) if read else ""}


def _address(host: object, port: object) -> str:
    """HOST:PORT. Raises InvalidSetting."""
    if not isinstance(host, str) or not isinstance(port, int):
        raise InvalidArguments("host is a text and port a number")
    return str(Address.checked(host, port))


def _hands(inverse: InverseKinematics, joints: Floats) -> dict[str, Pose]:
    return {side.value: inverse.body.hand(side, joints)._asdict() for side in Side}


def _joints(values: object) -> Floats:
    if not isinstance(values, Sequence) or len(values) != len(JOINTS) or not all(map(is_number, values)):
        raise InvalidArguments(f"joints: {len(JOINTS)} angles are needed")
    return np.array(values, float)


def _pose(values: object) -> HandPose:
    if not isinstance(values, Mapping) or not {"x", "y", "z"} <= values.keys() <= set(HandPose._fields):
        raise InvalidArguments("pose: x, y and z are needed, and roll, pitch, yaw are possible")
    for name, value in values.items():
        if not is_number(value):
            raise InvalidArguments(f"pose: {name} is not a number")
    return HandPose(**values)


def _side(name: object) -> Side:
    try:
        return Side(name)
    except ValueError:
        raise InvalidArguments(f"side: {str(name)[:80]!r} is not left, right or both") from None
