"""Calls of one operation with made arguments, and what came of them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any

from omniORB import CORBA

from robocorba.system.backoff import Backoff
from testkit.fuzzing.examples import title
from testkit.fuzzing.operations import Operation
from testkit.fuzzing.values import Seen, Values
from testkit.fuzzing.wire import Wire

#: Share of the inputs that are ill-formed on the wire.
WIRE_SHARE = 0.15
#: Time limit for a server that has ended to be back [s]; at the end its process is another one.
RESTART_LIMIT_S = 60.0
_AGAIN = Backoff(0.1, 0.1)
#: What a server may raise besides the exceptions of the operation. TRANSIENT: something else is missing now, or busy.
#: After an ill-formed message the ORB may also close the connection, which is a COMM_FAILURE.
ALLOWED = (
    CORBA.BAD_PARAM,
    CORBA.DATA_CONVERSION,
    CORBA.MARSHAL,
    CORBA.BAD_OPERATION,
    CORBA.BAD_TYPECODE,
    CORBA.NO_PERMISSION,
    CORBA.NO_IMPLEMENT,
    CORBA.IMP_LIMIT,
    CORBA.INV_OBJREF,
    CORBA.OBJECT_NOT_EXIST,
    CORBA.TRANSIENT,
)

#: Arguments of a plausible call.
Example = Callable[[], tuple[Any, ...]]


@dataclass
class Target:
    """Objects of one interface. name: that of the interface unless others have it as well. make: a reference to a fresh
    or to the only one. examples: arguments, by operation. after: called with the operation and its result, None after
    an exception, to undo what the call has done. ends: operations that end the object, so that each call gets a fresh
    one. also: exceptions that are right here as well. omitted: operations that are not called. unseen: operations that
    get nothing that the system has returned, such as names of robots that they would end."""

    interface: Any
    make: Callable[[], Any]
    examples: Mapping[str, Sequence[Example]] = field(default_factory=dict)
    after: Callable[[str, Any], None] = lambda name, result: None
    ends: frozenset[str] = frozenset()
    also: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    omitted: frozenset[str] = frozenset()
    unseen: frozenset[str] = frozenset()
    name: str = ""

    def __post_init__(self) -> None:
        self.name = self.name or title(self.interface)


def call_many(target: Target, operation: Operation, inputs: int, seed: int, seen: Seen) -> dict[str, str]:
    """Call an operation with `inputs` inputs: what came of it that no server may do, each with the arguments of its
    first call. The same seed makes the same inputs, as far as the system returned the same."""
    random = Random(f"{seed} {target.name} {operation.name}")
    values, wire = Values(random, Seen() if operation.name in target.unseen else seen), Wire(random)
    faults: dict[str, str] = {}
    reference: Any = None
    allowed = (*ALLOWED, *target.also.get(operation.name, ()), *target.also.get("", ()))
    is_disturbed = True  # the message before was ill-formed, perhaps, and the ORB closes the connection
    for _ in range(inputs):
        if reference is None or operation.name in target.ends:
            reference = _AGAIN.call(target.make, RESTART_LIMIT_S, CORBA.TRANSIENT, CORBA.COMM_FAILURE)
        examples = target.examples.get(operation.name, ())
        arguments: Sequence[Any] = values.arguments(operation.wanted, examples)
        descriptor = operation.descriptor
        is_ill_formed = random.random() < WIRE_SHARE
        if is_ill_formed:
            wanted, arguments = wire.ill_formed(operation.wanted, arguments)
            descriptor = (wanted, *descriptor[1:])
        result = None
        try:
            result = reference._obj.invoke(operation.name, descriptor, tuple(arguments))
            _note(seen, random, operation, result)
        except CORBA.UserException:
            pass
        except CORBA.SystemException as error:
            is_disturbed |= is_ill_formed
            if not isinstance(error, allowed) and not (is_disturbed and isinstance(error, CORBA.COMM_FAILURE)):
                faults.setdefault(str(error), _shown(arguments))
            if isinstance(error, CORBA.OBJECT_NOT_EXIST | CORBA.COMM_FAILURE):
                reference = None
        except Exception as error:  # of the client: the answer can't be read
            faults.setdefault(repr(error)[:300], _shown(arguments))
        is_disturbed = is_ill_formed
        with contextlib.suppress(CORBA.Exception):
            target.after(operation.name, result)
    return faults


def _note(seen: Seen, random: Random, operation: Operation, result: Any) -> None:
    returned = operation.returned or ()
    for descriptor, value in zip(returned, result if len(returned) > 1 else (result,), strict=False):
        seen.note(random, descriptor, value)


def _shown(arguments: Sequence[Any]) -> str:
    """The arguments as text, shortened."""
    return ", ".join(_short(each) for each in arguments)


def _short(value: Any) -> str:
    if isinstance(value, str | bytes | list) and len(value) > 1000:
        value = value[:100]
    text = repr(value)
    return text if len(text) <= 600 else f"{text[:600]}..."
