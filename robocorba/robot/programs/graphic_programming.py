"""The graphic programming agent: specifies a robot's task as a list of icons, in Python, one method for each icon.

    fetch = ProgramBuilder("fetch")
    fetch.mhand_posture("both", "home")
    with fetch.stop_if_closer("laser", 0.4):
        fetch.mbase_path("L3", 10, 4)
    fetch.write("fetch.json")

There is a method for each icon, also for those of other packages. Icons that contain others are context managers; all
other methods return the builder, so that calls can be chained. The classes in `icons` document the parameters;
`program` checks them. The console's program page edits the same programs in a browser."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from robocorba.robot.programs.base_checks import Planner
from robocorba.robot.programs.checker import UNKNOWN_START, Start, check
from robocorba.robot.programs.icons import ICONS, Branch, Condition, Icon, Repeat, Sensor, StopIfCloser
from robocorba.robot.programs.program import Program, checked, dumps
from robocorba.robot.programs.report import CheckReport

if TYPE_CHECKING:
    from robocorba.robot.kinematics.inverse import InverseKinematics


class ProgramBuilder:
    """A program under construction."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._icons: list[Icon] = []

    def program(self) -> Program:
        """The finished program. Raises InvalidProgram, which names icon and parameter."""
        return checked(Program(name=self._name, icons=tuple(self._icons)))

    def check(
        self, kinematics: InverseKinematics | None, planner: Planner | None, start: Start = UNKNOWN_START
    ) -> CheckReport:
        """Whether a robot at `start` can run the finished program. Raises InvalidProgram, and as `checker.check`."""
        return check(self.program(), kinematics, planner, start)

    def write(self, file: str | Path) -> None:
        """Write the finished program's file. Raises InvalidProgram, OSError."""
        Path(file).write_text(dumps(self.program()))

    if TYPE_CHECKING:

        def __getattr__(self, tag: str) -> Callable[..., ProgramBuilder]: ...

    # ---- icons that contain others ----

    def stop_if_closer(self, sensor: Sensor, distance: float) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: StopIfCloser(sensor, distance, body))

    def repeat(self, times: int) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: Repeat(times, body))

    def branch(self, condition: Condition) -> contextlib.AbstractContextManager[None]:
        return self._containing(lambda body: Branch(condition, body))

    def otherwise(self) -> contextlib.AbstractContextManager[None]:
        """The icons that the preceding branch runs otherwise. Raises ValueError if there is none."""
        if not self._icons or not isinstance(self._icons[-1], Branch) or self._icons[-1].otherwise:
            raise ValueError("otherwise() comes after the end of a branch()")
        branch = self._icons.pop()
        return self._containing(lambda body: msgspec.structs.replace(branch, otherwise=body))

    @contextlib.contextmanager
    def _containing(self, icon: Callable[[tuple[Icon, ...]], Icon]) -> Iterator[None]:
        outside, self._icons = self._icons, []
        try:
            yield
        finally:
            inside, self._icons = self._icons, outside
        self._icons.append(icon(tuple(inside)))


def _method(icon: type[Icon]) -> Callable[..., ProgramBuilder]:
    """The method that adds an icon; it has the parameters and the documentation of the icon's class."""

    def add(self: ProgramBuilder, *parameters: Any, **named: Any) -> ProgramBuilder:
        self._icons.append(icon(*parameters, **named))
        return self

    fields = inspect.signature(icon).parameters.values()
    builder = inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    add.__doc__ = icon.__doc__
    add.__signature__ = inspect.Signature([builder, *fields])  # type: ignore[attr-defined]
    return add


for _tag, _icon in ICONS.items():
    if not hasattr(ProgramBuilder, _tag):
        setattr(ProgramBuilder, _tag, _method(_icon))
