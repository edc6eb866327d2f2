"""Errors of processes and of the naming service."""

from __future__ import annotations

from robocorba.errors.base import NamedError, RoboCorbaError, StructuredError


class ServiceError(RoboCorbaError):
    """A process or its environment is unusable."""


class AlreadyRunning(ServiceError):
    """Another process uses this state folder."""


class PortInUse(StructuredError, ServiceError):
    """Another process listens on `host`:`port`."""

    host: str
    port: int
    purpose: str
    message = "port {port} on {host}, wanted for {purpose}, is in use; choose another one"


class StartFailed(ServiceError):
    """A process did not start in time."""


class NotReachable(ServiceError):
    """A name could not be resolved, or its object did not answer, in time."""


class NotBound(NotReachable):
    """The naming service does not know a name."""


class NotPermitted(StructuredError, NotReachable):
    """`what` refuses a call: the caller's role does not include it."""

    what: str
    message = (
        "{what} refuses this call: your role in this guarded system does not include it; take another one by "
        "--naming FILE or ROBOCORBA_NAMING, such as access/operator.ior (robots: robot.ior) of the state folder"
    )


class NameHeld(NamedError, ServiceError):
    """Somebody else holds the name `name`."""

    def __str__(self) -> str:
        return f"another program holds the name {self.name[:200]!r}"


class InvalidBinding(NamedError, ServiceError):
    """`name` can't be bound."""

    reason: str

    def __str__(self) -> str:
        return f"{self.name[:200]!r} can't be bound: {self.reason}"


class ProcessExists(NamedError, ServiceError):
    """The system runs a robot called `name` already."""

    message = "this system runs a robot called {name:.80} already"


class UnknownProcess(NamedError, ServiceError):
    """The system has no process called `name`, or no robot was started here by this name."""

    message = "this system has started nothing called {name!q}"
