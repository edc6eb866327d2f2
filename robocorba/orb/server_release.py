"""What the servants of all servers have."""

from __future__ import annotations

from robocorba import __version__


class ServerServant:
    """RoboCorba::Server, to derive from together with the class of the POA."""

    def _get_release(self) -> str:
        return __version__
