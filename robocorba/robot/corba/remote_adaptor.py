"""Client of a robot adaptor in another process, possibly in another language."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from omniORB import CORBA

from robocorba.errors.robots import AdaptorFailed, RobotLost
from robocorba.errors.services import NotReachable
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import Answer, translated
from robocorba.robot.adaptor import ArgumentParser, RobotAdaptor
from robocorba.robot.corba import robot_states
from robocorba.robot.corba.senses import CALL_TIMEOUT_S, RemoteSenses
from robocorba.robot.model_switcher import AdaptorContext
from robocorba.robot.motion.robot_state import ActorCommand, RobotState
from robocorba.stubs import RoboCorba
from robocorba.system.names import ADAPTORS


def adaptor(context: AdaptorContext) -> RobotAdaptor:
    """The entry point `corba` of the adaptors."""
    return RemoteAdaptor(context.orb, context.name)


class RemoteAdaptor(RobotAdaptor):
    """Client of the RoboCorba::RobotAdaptor at `--uri URI` in argv, by default of the one bound as
    RoboCorba/Adaptors/NAME. The other arguments are passed to its `start`, which may take 30 s, other calls 0.3 s.
    It has senses if that is a RoboCorba::RobotSensors, too."""

    def __init__(self, orb: Orb, robot_name: str) -> None:
        self._orb, self._name = orb, robot_name
        self._adaptor: Any = None

    def start(self, argv: Sequence[str]) -> bool:
        parser = ArgumentParser()
        parser.add_argument("--uri", default="")
        given, rest = parser.parse_known_args(list(argv))
        try:
            found = (
                self._orb.reference(given.uri, RoboCorba.RobotAdaptor)
                if given.uri
                else self._orb.resolve(f"{ADAPTORS}/{self._name}", RoboCorba.RobotAdaptor, 5.0)
            )
        except NotReachable as error:
            raise RobotLost(str(error)) from None
        uri = self._orb.uri(found)
        starter = self._orb.reference(uri, RoboCorba.RobotAdaptor, 30.0)
        self._adaptor = self._orb.reference(uri, RoboCorba.RobotAdaptor, CALL_TIMEOUT_S)
        is_new = bool(self._call(lambda: starter.start(rest)))
        has_senses = self._call(lambda: self._adaptor._is_a(RoboCorba.RobotSensors._NP_RepositoryId))
        self.senses = RemoteSenses(self._orb, uri) if has_senses else None
        return is_new

    def stop(self) -> bool:
        return self._adaptor is not None and self._call(lambda: bool(self._adaptor.stop()))

    def read(self, state: RobotState) -> bool:
        if self._adaptor is None:
            return False
        done, struct = self._call(lambda: self._adaptor.read())
        if done:
            robot_states.fill(state, struct)
        return bool(done)

    def write(self, command: ActorCommand) -> bool:
        return self._adaptor is not None and self._call(
            lambda: bool(self._adaptor.write(robot_states.actor_command(command)))
        )

    @staticmethod
    def _call(call: Callable[[], Answer]) -> Answer:
        try:
            with translated("the robot's adaptor", RobotLost):
                return call()
        except CORBA.UserException as error:  # one that RoboCorba's IDL does not have
            raise AdaptorFailed(str(error)) from None
