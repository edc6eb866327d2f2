"""Errors of processes and of the naming service."""

from __future__ import annotations

from robocorba.errors.base import RoboCorbaError


class ServiceError(RoboCorbaError):
    """A process or its environment is unusable."""


class AlreadyRunning(ServiceError):
    """Another process uses this state folder."""


class PortInUse(ServiceError):
    """Another process listens on `host`:`port`."""

    def __init__(self, host: str, port: int, purpose: str) -> None:
        self.host, self.port, self.purpose = host, port, purpose
        super().__init__(f"port {port} on {host}, wanted for {purpose}, is in use; choose another one")


class StateMismatch(ServiceError):
    """The state folder contains another building than the requested one."""


class StartFailed(ServiceError):
    """A process did not start in time."""


class NotReachable(ServiceError):
    """A name could not be resolved, or its object did not answer, in time."""


class ProcessExists(ServiceError):
    """The system runs a robot called `name` already."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"this system runs a robot called {name[:80]} already")


class UnknownProcess(ServiceError):
    """The system has no process called `name`, or no robot was started here by this name."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"this system has started nothing called {name[:80]!r}")
