"""Client of robots' stop targets, whose references only the simulation server and the state folder have."""

from __future__ import annotations

import contextlib

from omniORB import CORBA

from robocorba.corba.conversion import simulation
from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import translated
from robocorba.simulation.emergency_stops import StopAnswer
from robocorba.stubs import RoboCorba

#: Timeout of a stop [s]: the robot's adaptor may take a second to confirm it.
CALL_TIMEOUT_S = 3.0


def stop_at(orb: Orb, target: str, reason: str, number: int = 0) -> StopAnswer:
    """Stop the robot whose stop target is at a URI. number: of the simulation server's stop; 0 for another caller's.
    Raises NotReachable."""
    reference = orb.reference(target, RoboCorba.StopTarget, CALL_TIMEOUT_S)
    with translated("the robot"):
        if number:
            with contextlib.suppress(CORBA.BAD_OPERATION):  # of an earlier release
                return simulation.stop_answer_of(reference.stopNumbered(reason, number))
        return simulation.stop_answer_of(reference.stop(reason))
