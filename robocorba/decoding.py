"""Decode into msgspec types, also in several threads at once.

msgspec examines a type when it meets it for the first time. In version 0.22, a thread that decodes the type meanwhile,
or one which contains it, reads unfinished memory: the process crashes. Here one thread at a time examines types, and
the others wait for it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")
_examining = threading.Lock()
_json: dict[Any, msgspec.json.Decoder[Any]] = {}
_msgpack: dict[Any, msgspec.msgpack.Decoder[Any]] = {}


def decode_json(data: bytes | str, schema: type[T]) -> T:
    """A JSON document as `schema`. Raises msgspec.DecodeError, msgspec.ValidationError."""
    found: T = _decoder(schema, _json, msgspec.json.Decoder).decode(data)
    return found


def decode_msgpack(data: bytes, schema: type[T]) -> T:
    """A msgpack document as `schema`. Raises msgspec.DecodeError, msgspec.ValidationError."""
    found: T = _decoder(schema, _msgpack, msgspec.msgpack.Decoder).decode(data)
    return found


def convert(plain: Any, schema: type[T]) -> T:
    """Plain maps, lists and values as `schema`. Raises msgspec.ValidationError."""
    _decoder(schema, _msgpack, msgspec.msgpack.Decoder)
    return msgspec.convert(plain, schema)


def _decoder(schema: type[T], known: dict[Any, Any], make: Callable[[type[T]], Any]) -> Any:
    """The decoder of a type, which is examined when it is not yet known."""
    decoder = known.get(schema)
    if decoder is None:
        with _examining:
            decoder = known[schema] = make(schema)
    return decoder
