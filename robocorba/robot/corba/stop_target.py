"""Client of robots' stop targets, whose references only the simulation server and the state folder have."""

from __future__ import annotations

import logging

from omniORB import CORBA

from robocorba.orb.calls import describe
from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import translated
from robocorba.simulation.corba import sessions
from robocorba.simulation.emergency_stops import StopAnswer
from robocorba.stubs import RoboCorba

_log = logging.getLogger(__name__)


def stop_at(orb: Orb, target: str, reason: str, number: int = 0) -> StopAnswer:
    """Stop the robot whose stop target is at a URI. number: of the simulation server's stop; 0 for another caller's.
    Raises NotReachable."""
    reference = orb.reference(target, RoboCorba.StopTarget, 3.0)  # its adaptor may take a second to confirm it
    with translated("the robot"):
        if number:
            try:
                return sessions.stop_answer_of(reference.stopNumbered(reason, number))
            except (CORBA.TIMEOUT, CORBA.TRANSIENT, CORBA.COMM_FAILURE, CORBA.OBJECT_NOT_EXIST):
                raise
            except CORBA.SystemException as error:  # of an earlier release; ORBs answer in different ways
                _log.info("a stop target does not know numbers of stops: %s", describe(error))
        return sessions.stop_answer_of(reference.stop(reason))
