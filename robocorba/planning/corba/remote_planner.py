"""Client of the path planning agent."""

from __future__ import annotations

from robocorba.orb.orb import Orb
from robocorba.orb.remote_object import RemoteObject
from robocorba.planning.corba import paths
from robocorba.planning.request import Path, PathRequest
from robocorba.stubs import RoboCorba


class RemotePlanner:
    """Resolves the agent on first use, and again after a failed call. Timeouts to resolve it, and for a call [s]."""

    def __init__(self, orb: Orb, resolve_timeout_s: float = 5.0, call_timeout_s: float = 5.0) -> None:
        what, timeouts = "the path planning agent", (resolve_timeout_s, call_timeout_s)
        self._agent = RemoteObject(orb, "PathPlanner", RoboCorba.PathPlanner, what, *timeouts)

    def paths(self, request: PathRequest) -> list[Path]:
        """The best path first. Raises PathError and NotReachable."""
        found = self._agent.call(lambda agent: agent.findPaths(paths.request(request)))
        return [paths.path_of(struct) for struct in found]
