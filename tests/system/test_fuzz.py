"""Nonsense of every kind over the wire: a typed exception each time, and a system that stays as it was."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from robocorba.stubs import RoboCorba
from testkit.fuzzing.calls import call_many
from testkit.fuzzing.fuzzed_system import FuzzedSystem, fuzzed_system
from testkit.fuzzing.operations import interfaces, operations
from testkit.fuzzing.targets import OF_CLIENTS, OUT_OF_REACH, targets
from testkit.simulation import error_lines

pytestmark = [pytest.mark.system, pytest.mark.full]

#: Inputs for each operation.
INPUTS = 3
#: Operations of which one call takes long.
SLOW = {"startRobot", "switchAdaptor", "check", "checkFloor", "buildTopologicalMap"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def fuzzed(folder: Path) -> Iterator[FuzzedSystem]:
    """The same processes serve at the end."""
    with fuzzed_system(folder) as system:
        yield system
        assert not system.ended()


def test_every_operation_answers_nonsense_with_an_exception_of_its_own(fuzzed: FuzzedSystem, folder: Path) -> None:
    everything = targets(fuzzed)
    called = {target.interface for target in everything}
    bases = {RoboCorba.Server}  # all that servers have of it is called by their own interfaces
    assert set(interfaces()) - called == {*OF_CLIENTS, *OUT_OF_REACH, *bases}
    faults = {}
    for target in everything:
        for operation in operations(target.interface):
            is_called = operation.name not in target.omitted | SLOW
            if is_called and (found := call_many(target, operation, INPUTS, 1, fuzzed.seen)):
                faults[f"{target.name}.{operation.name}"] = found
    assert not faults
    assert not error_lines(folder / "state") + error_lines(folder / "actual" / "state")
