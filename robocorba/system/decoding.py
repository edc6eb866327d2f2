"""Decode what others have written: into msgspec types, also in several threads at once, and compressed data.

Data and files have limits, which are checked before anything is made from them: `decompress_*` by the declared and by
the actual size, `Work` by time. A document that is nested too deeply is as invalid as any other.

msgspec examines a type when it meets it for the first time. In version 0.22, a thread that decodes the type meanwhile,
or one which contains it, reads unfinished memory: the process crashes. Here one thread at a time examines types, and
the others wait for it."""

from __future__ import annotations

import io
import threading
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from robocorba.errors.files import LimitExceeded, WorkEnded

T = TypeVar("T")
_examining = threading.Lock()
_json: dict[Any, msgspec.json.Decoder[Any]] = {}
_msgpack: dict[Any, msgspec.msgpack.Decoder[Any]] = {}


def decode_json(data: bytes | str, schema: type[T]) -> T:
    """A JSON document as `schema`. Raises msgspec.DecodeError, msgspec.ValidationError."""
    return _decoded(_decoder(schema, _json, msgspec.json.Decoder).decode, data)


def decode_msgpack(data: bytes, schema: type[T]) -> T:
    """A msgpack document as `schema`. Raises msgspec.DecodeError, msgspec.ValidationError."""
    return _decoded(_decoder(schema, _msgpack, msgspec.msgpack.Decoder).decode, data)


def convert(plain: Any, schema: type[T]) -> T:
    """Plain maps, lists and values as `schema`. Raises msgspec.ValidationError."""
    _decoder(schema, _msgpack, msgspec.msgpack.Decoder)
    return _decoded(lambda data: msgspec.convert(data, schema), plain)


def read_text(file: Path, limit: int = 64 * 1024) -> str:
    """The text of a small file, such as with a reference, an address or a password, that somebody names and that may be
    anything, such as /dev/zero. limit: of its size [bytes]. Raises OSError,
    UnicodeDecodeError, LimitExceeded."""
    with file.open("rb") as source:
        data = source.read(limit + 1)
    if len(data) > limit:
        raise LimitExceeded(str(file), f"more than {limit}", limit, "bytes")
    return data.decode()


def decompress_gzip(data: bytes, limit: int, what: str) -> bytes:
    """The first member of gzipped data, of at most `limit` bytes. Raises LimitExceeded; zlib.error, EOFError for
    damaged data."""
    stream = zlib.decompressobj(wbits=31)
    found = stream.decompress(data, limit + 1)
    if len(found) > limit:
        raise LimitExceeded(what, f"more than {limit}", limit, "bytes after decompression")
    if not stream.eof:
        raise EOFError(f"{what} ends too early")
    return found


def decompress_zstd(data: bytes, declared: int, limit: int, what: str) -> bytes:
    """Data of `declared` bytes, at most `limit`. Raises LimitExceeded; ValueError, zstandard.ZstdError for damaged
    data."""
    import zstandard  # here: most users of this module decompress nothing

    if declared > limit:
        raise LimitExceeded(what, declared, limit, "bytes after decompression")
    # By pieces: at once, the decoder would allocate what the data itself declares.
    reader = zstandard.ZstdDecompressor(max_window_size=limit).stream_reader(io.BytesIO(data))
    found = reader.read(declared + 1)
    if len(found) != declared:
        raise ValueError(f"{what} does not have the {declared} bytes that it declares")
    return found


class Work:
    """Work that others wait for, at most `limit_s` [s]. The thread that does it calls `check` often. Thread-safe."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s, self._ends_s = limit_s, time.monotonic() + limit_s
        self._is_cancelled = threading.Event()

    def cancel(self) -> None:
        """Nobody waits for it any more."""
        self._is_cancelled.set()

    def check(self) -> None:
        """Raises WorkEnded once it was cancelled, or its time is over."""
        if self._is_cancelled.is_set():
            raise WorkEnded("cancelled, since its caller waits no longer")
        if time.monotonic() > self._ends_s:
            raise WorkEnded(f"not complete after {self._limit_s:g} s, its limit")


def _decoded(decode: Callable[[Any], Any], data: Any) -> Any:
    try:
        return decode(data)
    except RecursionError:
        raise msgspec.DecodeError("nested too deeply") from None


def _decoder(schema: type[T], known: dict[Any, Any], make: Callable[[type[T]], Any]) -> Any:
    """The decoder of a type, which is examined when it is not yet known."""
    decoder = known.get(schema)
    if decoder is None:
        with _examining:
            decoder = known[schema] = make(schema)
    return decoder
