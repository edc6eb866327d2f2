"""The path planning agent as a remote object."""

from __future__ import annotations

from typing import Any

from omniORB import CORBA

from robocorba.corba.calls import describe
from robocorba.corba.conversion import paths
from robocorba.corba.conversion.errors import domain_error
from robocorba.corba.orb import Orb
from robocorba.errors.services import NotReachable
from robocorba.planning.request import Path, PathRequest
from robocorba.stubs import RoboCorba

#: Timeouts for resolving the agent and for a call [s].
FIND_LIMIT_S, CALL_LIMIT_S = 5.0, 5.0


class RemotePlanner:
    """Resolves the agent on first use, and again after a failed call."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb
        self._planner: Any = None

    def paths(self, request: PathRequest) -> list[Path]:
        """The best path first. Raises PathError and NotReachable."""
        try:
            if self._planner is None:
                self._planner = self._orb.resolve("PathPlanner", RoboCorba.PathPlanner, FIND_LIMIT_S, CALL_LIMIT_S)
            found = self._planner.findPaths(paths.request(request))
        except CORBA.UserException as wrong:
            raise (domain_error(wrong) or wrong) from None
        except CORBA.SystemException as wrong:
            self._planner = None
            raise NotReachable(f"the path planning agent does not answer ({describe(wrong)})") from None
        return [paths.path_of(struct) for struct in found]
