"""Base classes of all errors."""

from __future__ import annotations

import inspect
import string
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:  # of Python 3.11 and later

    def dataclass_transform(**_: object) -> Any:
        """Only type checkers need it."""
        return lambda kind: kind


class RoboCorbaError(Exception):
    """Root of all errors that RoboCorba raises on purpose."""


@dataclass_transform(eq_default=False)
class StructuredError(RoboCorbaError):
    """An error with fields: the annotations of its class are the parameters of its constructor, in their order, and its
    attributes. Of a sequence it keeps a tuple.

    message: the text, a format string whose names are attributes; `!q` quotes the first 80 characters of a text, `!l`
    lists the members of a sequence, or `none`."""

    message: ClassVar[str]
    _fields: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls._fields = (*cls._fields, *inspect.get_annotations(cls))

    # Not as of dataclasses, which would compile each class when it is imported: some 10 ms at each start.
    def __init__(self, *values: Any, **named: Any) -> None:
        given = dict(zip(self._fields, values, strict=False), **named)
        for name in self._fields:
            value = given[name] if name in given else getattr(type(self), name)  # its default
            is_sequence = isinstance(value, Iterable) and not isinstance(value, str | Mapping)
            setattr(self, name, tuple(value) if is_sequence else value)

    def __str__(self) -> str:
        return _Formatter().vformat(self.message, (self,), {})


class _Formatter(string.Formatter):
    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        return getattr(args[0], str(key))

    def convert_field(self, value: Any, conversion: Any) -> Any:
        if conversion == "q":
            return repr(value[:80])
        if conversion == "l":
            return ", ".join(value) or "none"
        return super().convert_field(value, conversion)


class FieldError(StructuredError):
    """`field` of a request is invalid; `reason` is why."""

    field: str
    reason: str
    message = "{field}: {reason}"


class NamedError(StructuredError):
    """About something called `name`."""

    name: str
