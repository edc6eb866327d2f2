"""A property that is computed at its first access, without a lock.

functools.cached_property of Python 3.10 and 3.11 has one lock for all instances of a class. Threads that are first to
read new instances queue for it, and each of them then for the interpreter: with a thread for each of 300 robots,
one of twenty readings of a robot's state took a tenth of a second. From Python 3.12 on it has no lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

T = TypeVar("T")


class lazy_property(Generic[T]):
    """Decorates a method without arguments and effects of an immutable object that has a __dict__.

    Threads that read it at the same time may compute it at the same time; all get the same object."""

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> lazy_property[T]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> T: ...

    def __get__(self, instance: object | None, owner: type) -> lazy_property[T] | T:
        if instance is None:
            return self
        # Found there from now on: attributes of an instance come before this, which can't be set.
        found: T = instance.__dict__.setdefault(self._name, self._compute(instance))
        return found
