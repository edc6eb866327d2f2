"""The path planning agent as a remote object."""

from __future__ import annotations

from robocorba.corba.conversion import paths
from robocorba.corba.orb import Orb
from robocorba.corba.remote.remote_object import RemoteObject
from robocorba.planning.request import Path, PathRequest
from robocorba.stubs import RoboCorba

#: Timeouts for resolving the agent and for a call [s].
FIND_LIMIT_S, CALL_LIMIT_S = 5.0, 5.0


class RemotePlanner:
    """Resolves the agent on first use, and again after a failed call."""

    def __init__(self, orb: Orb) -> None:
        what = "the path planning agent"
        self._agent = RemoteObject(orb, "PathPlanner", RoboCorba.PathPlanner, what, FIND_LIMIT_S, CALL_LIMIT_S)

    def paths(self, request: PathRequest) -> list[Path]:
        """The best path first. Raises PathError and NotReachable."""
        found = self._agent.call(lambda agent: agent.findPaths(paths.request(request)))
        return [paths.path_of(struct) for struct in found]
