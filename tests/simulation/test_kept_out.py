"""Robots that an administrator keeps out, against a model: also over restarts of the server."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from robocorba.errors.simulation import (
    InvalidChoice,
    InvalidDescription,
    NameTaken,
    RobotKeptOut,
    SessionExpired,
    UnknownRobot,
)
from robocorba.simulation import management_agent
from robocorba.simulation.management_agent import ManagementAgent
from robocorba.simulation.session import Session
from robocorba.simulation.store import SimulationStore
from tests.simulation.places import robot, tower

PLACES = {"A": 1.0, "B": 4.0, "C": 7.0}
names = st.sampled_from(sorted(PLACES))


class Doors(RuleBasedStateMachine):
    """Robots come and go, an administrator keeps some out, and the server is killed at any moment."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self._open()
        self.here: dict[str, Session] = {}
        self.kept_out: set[str] = set()

    def _open(self) -> None:
        self._store = SimulationStore(Path(self._folder.name) / "simulation.sqlite")
        self._store.__enter__()
        self.agent = ManagementAgent(tower(), 7, self._store)

    def _close(self) -> None:
        self._store.__exit__(None, None, None)

    @rule(name=names)
    def register(self, name: str) -> None:
        if name in self.kept_out:
            with pytest.raises(RobotKeptOut, match=f"robocorba simulation admit {name}"):
                self.agent.register(robot(name, x=PLACES[name]))
        elif name in self.here:
            with pytest.raises(NameTaken):
                self.agent.register(robot(name, x=PLACES[name]))
        else:
            self.here[name] = self.agent.register(robot(name, x=PLACES[name]))

    @rule(name=names)
    def keep_out(self, name: str) -> None:
        session = self.here.pop(name, None)
        assert self.agent.keep_out(name) is (session is not None)
        self.kept_out.add(name)
        if session:
            with pytest.raises(SessionExpired):
                session.heartbeat()

    @rule(name=names)
    def evict(self, name: str) -> None:
        if self.here.pop(name, None):
            self.agent.evict(name)
        else:
            with pytest.raises(UnknownRobot):
                self.agent.evict(name)

    @rule(name=names)
    def admit(self, name: str) -> None:
        assert self.agent.admit(name) is (name in self.kept_out)
        self.kept_out.discard(name)

    @rule()
    def restart(self) -> None:
        self._close()
        self._open()
        self.here = {session.name: session for session in self.agent.sessions.values()}

    @rule(name=names)
    def kill_between_the_two_writes(self, name: str) -> None:
        """The name is kept out on disk, the log-off is not."""
        self._store.keep_out(name)
        self.kept_out.add(name)
        self.here.pop(name, None)
        self.restart()

    @invariant()
    def as_in_the_model(self) -> None:
        assert {session.name for session in self.agent.sessions.values()} == set(self.here)
        assert self.agent.kept_out == sorted(self.kept_out)

    def teardown(self) -> None:
        self._close()
        self._folder.cleanup()


Doors.TestCase.settings = settings(max_examples=25, stateful_step_count=20, deadline=None)
test_doors = Doors.TestCase


def test_names_that_no_robot_can_have_and_too_many_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(management_agent, "MAX_KEPT_OUT", 1)
    with SimulationStore(tmp_path / "simulation.sqlite") as store:
        agent = ManagementAgent(tower(), 7, store)
        with pytest.raises(InvalidChoice, match="letters, digits"):
            agent.keep_out("no name")
        agent.keep_out("A")
        agent.keep_out("A")
        with pytest.raises(InvalidChoice, match="1 names are kept out already"):
            agent.keep_out("B")
        with pytest.raises(InvalidDescription):  # as clients of the released IDL see it
            agent.register(robot("A"))
