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


class NotPermitted(NotReachable):
    """`what` refuses a call: the caller's role does not include it."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(
            f"{what} refuses this call: your role in this guarded system does not include it; take another one by "
            "--naming FILE or ROBOCORBA_NAMING, such as access/operator.ior (robots: robot.ior) of the state folder"
        )


class NameHeld(ServiceError):
    """Somebody else holds the name `name`."""

    def __init__(self, name: str) -> None:
        self.name = name
        super().__init__(f"somebody else holds the name {name[:200]!r}")


class InvalidBinding(ServiceError):
    """`name` can't be bound."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(f"{name[:200]!r} can't be bound: {reason}")


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
