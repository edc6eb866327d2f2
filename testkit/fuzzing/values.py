"""Arguments that an ORB can send, made from type descriptors.

A descriptor is a kind of tcInternal, or a tuple that begins with one and holds the descriptors of its parts."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

import omniORB
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.stubs import RoboCorba
from testkit.random_anys import DISCRIMINATORS

#: Maximum number of parts of the arguments of one call, except for octets and texts.
MAX_PARTS = 20_000
#: Number of values of a type that are kept.
MAX_SEEN = 200
#: Length of the longest texts and octet sequences.
HUGE = 1_000_000

NUMBERS = (math.nan, math.inf, -math.inf, 1.7e308, -1.7e308, 5e-324, -0.0, 0.0, -1.0, 1e-9, 1e7, 1e6, 2.0**53, 3.5e38)
TEXTS = (
    "",
    " ",
    ".",
    "..",
    "../../etc/passwd",
    "/",
    "-a",
    "--help",
    "'",
    "%s%n{0}",
    "a b",
    "*",
    "?",
    "a" * 61,
    "a" * 201,
    "ж" * 201,
    "\N{GRINNING FACE}",
    "two\nlines",
    "\r\n\t",
    "\x01\x1b[2J\x7f",
    "\x80\x9f",
    "\N{RIGHT-TO-LEFT OVERRIDE}",
    "\ufeff",
    "\uffff",
    "e\u0301" * 100,
    "nan",
    "1e999",
    "null",
    "[" * 100_000,
    '{"icons":' * 1000,
    "x" * HUGE,
)
#: What JSON can hold in one place.
JSON: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    2**63,
    -(2**63),
    10**30,
    1e308,
    math.nan,
    math.inf,
    "",
    "\ud800",
    "\0",
    "a" * 300,
    [],
    {},
    [[]],
    [0] * 1000,
    {"": ""},
    {"icon": "wait"},
)
#: Bounds of the integer kinds.
INTEGERS = {tc.tv_octet: (0, 2**8 - 1), **DISCRIMINATORS}


def resolved(descriptor: Any) -> Any:
    """A descriptor without names for it in between."""
    while isinstance(descriptor, tuple) and descriptor[0] in (tc.tv_alias, tc.tv__indirect):
        descriptor = descriptor[3] if descriptor[0] == tc.tv_alias else descriptor[1][0]
        if isinstance(descriptor, str):
            descriptor = omniORB.typeMapping[descriptor]
    return descriptor


def kind_of(descriptor: Any) -> int:
    """The kind of a resolved descriptor."""
    return int(descriptor[0] if isinstance(descriptor, tuple) else descriptor)


class Seen:
    """Texts, structs and references that a running system has returned."""

    def __init__(self, texts: Sequence[str] = (), references: Sequence[Any] = ()) -> None:
        self.texts, self.references = list(texts), list(references)
        self._known = set(self.texts)
        self.structs: dict[str, list[Any]] = {}

    def note(self, random: Random, descriptor: Any, value: Any) -> None:
        """Keep the parts of a result."""
        descriptor = resolved(descriptor)
        kind = kind_of(descriptor)
        if kind == tc.tv_string and 0 < len(value) <= 200 and value not in self._known and len(self.texts) < 300:
            self.texts.append(value)
            self._known.add(value)
        elif kind == tc.tv_objref and value is not None and len(self.references) < 100:
            self.references.append(value)
        elif kind == tc.tv_struct:
            kept = self.structs.setdefault(descriptor[2], [])
            if len(kept) < MAX_SEEN:
                kept.append(value)
            else:
                kept[random.randrange(MAX_SEEN)] = value
            for member, part in zip(descriptor[4::2], descriptor[5::2], strict=True):
                self.note(random, part, getattr(value, member))
        elif kind == tc.tv_union:
            self.structs.setdefault(descriptor[2], []).append(value)
            del self.structs[descriptor[2]][:-MAX_SEEN]
        elif kind == tc.tv_sequence and not isinstance(value, bytes | str):
            for part in value[:20]:
                self.note(random, descriptor[1], part)


class Values:
    """Makes values of any type. seen: from which plausible parts are taken."""

    def __init__(self, random: Random, seen: Seen) -> None:
        self._random, self._seen = random, seen
        self._left = MAX_PARTS

    def arguments(self, wanted: Sequence[Any], examples: Sequence[Callable[[], tuple[Any, ...]]]) -> list[Any]:
        """Arguments of one call: a third wild, a third plausible, a third plausible with a wild part."""
        random = self._random
        self._left = MAX_PARTS
        if random.random() < 1 / 3:
            return [self.wild(each) for each in wanted]
        if examples and random.random() < 0.6:
            found = list(random.choice(examples)())
        else:
            found = [self.plausible(each) for each in wanted]
        if wanted and random.random() < 0.5:
            number = random.randrange(len(wanted))
            found[number] = self.changed(wanted[number], found[number])
        return found

    # ---- plausible ----

    def plausible(self, descriptor: Any) -> Any:
        """A value as callers send it."""
        return self._made(resolved(descriptor), self.plausible, self._plausible_leaf, 3)

    def _plausible_leaf(self, descriptor: Any, kind: int) -> Any:
        random = self._random
        if kind in INTEGERS:
            return random.choice((0, 1, 2, 3, 10, 100))
        if kind in (tc.tv_float, tc.tv_double):
            return random.choice((0.0, 0.1, 0.5, 1.0, random.uniform(0.0, 20.0), random.uniform(-3.0, 3.0)))
        if kind == tc.tv_string:
            return random.choice(self._seen.texts) if self._seen.texts else "a"
        if kind == tc.tv_objref:
            return random.choice(self._seen.references) if self._seen.references else None
        return self._wild_leaf(descriptor, kind)

    # ---- wild ----

    def wild(self, descriptor: Any) -> Any:
        """An extreme value, whose parts are extreme as well."""
        return self._made(resolved(descriptor), self.wild, self._wild_leaf, self._random.choice((0, 1, 2, 5, 1000)))

    def _wild_leaf(self, descriptor: Any, kind: int) -> Any:
        random = self._random
        if kind in INTEGERS:
            low, high = INTEGERS[kind]
            return random.choice(
                (low, high, high - 1, high // 2, high // 2 + 1, random.randint(low, high), max(low, -1))
            )
        if kind == tc.tv_float:
            return random.choice([number for number in NUMBERS if not 3.4e38 < abs(number) < math.inf])
        if kind == tc.tv_double:
            return random.choice(NUMBERS)
        if kind == tc.tv_boolean:
            return random.random() < 0.5
        if kind == tc.tv_char:
            return chr(random.randrange(1, 128))
        if kind == tc.tv_string:
            return self._wild_text()
        if kind == tc.tv_enum:
            return random.choice(descriptor[3])
        if kind == tc.tv_objref:
            return random.choice([None, *self._seen.references])
        if kind == tc.tv_any:
            return self.any()
        if kind == tc.tv_TypeCode:
            return random.choice(_TYPES)
        raise NotImplementedError(descriptor)

    def _wild_text(self) -> str:
        random = self._random
        text = random.choice(TEXTS)
        if len(text) > 1000 and (self._left <= 0 or random.random() < 0.9):
            text = random.choice(TEXTS[:20])
        if random.random() < 0.2:
            text = "".join(
                chr(random.choice((random.randrange(1, 0xD800), random.randrange(32, 127)))) for _ in range(9)
            )
        return text

    def any(self, depth: int = 0) -> Any:
        """An any, also with others inside."""
        random = self._random
        way = random.randrange(8)
        if way == 0 and depth < 60:
            return CORBA.Any(CORBA.TC_any, self.any(depth + random.choice((1, 1, 20))))
        if way == 1:
            return CORBA.Any(CORBA.TC_string, self._wild_text())
        if way == 2:
            return CORBA.Any(CORBA.TC_double, random.choice(NUMBERS))
        if way == 3:
            return CORBA.Any(CORBA.TC_TypeCode, random.choice(_TYPES))
        if way == 4:
            return CORBA.Any(RoboCorba._tc_Event, self.wild(RoboCorba._d_Event))
        if way == 5:
            return CORBA.Any(RoboCorba._tc_EventRunSeq, self.wild(RoboCorba._d_EventRunSeq))
        if way == 6:
            return CORBA.Any(CORBA.TC_Object, random.choice([None, *self._seen.references]))
        return CORBA.Any(CORBA.TC_null, None)

    # ---- values with a change ----

    def changed(self, descriptor: Any, value: Any) -> Any:
        """A value with one part, or all of it, made extreme."""
        descriptor, random = resolved(descriptor), self._random
        kind = kind_of(descriptor)
        if kind == tc.tv_struct and random.random() < 0.95:
            members = descriptor[4::2]
            number = random.randrange(len(members))
            parts = [getattr(value, member) for member in members]
            parts[number] = self.changed(descriptor[5::2][number], parts[number])
            return descriptor[1](*parts)
        if kind == tc.tv_union and random.random() < 0.95 and value._d in descriptor[8]:
            part = descriptor[8][value._d][2]
            return descriptor[1](value._d, self.changed(part, value._v))
        if kind == tc.tv_sequence and isinstance(value, list | tuple) and value and random.random() < 0.8:
            parts = list(value)
            number = random.randrange(len(parts))
            parts[number] = self.changed(descriptor[1], parts[number])
            return parts
        if kind == tc.tv_sequence and isinstance(value, list | tuple) and value and random.random() < 0.5:
            return [*value] * random.choice((2, 3, 100))
        if kind == tc.tv_sequence and isinstance(value, bytes) and value and random.random() < 0.8:
            return self._changed_octets(value)
        if kind == tc.tv_string and value and random.random() < 0.6:
            return self._changed_text(value)
        return self.wild(descriptor)

    def _changed_text(self, text: str) -> str:
        """Another JSON document, or a text with a piece removed, repeated or inserted."""
        random = self._random
        if text[0] in "{[" and random.random() < 0.8:
            try:
                return json.dumps(self.changed_json(json.loads(text)))
            except ValueError:
                pass
        start, end = sorted((random.randrange(len(text)), random.randrange(len(text) + 1)))
        piece = random.choice(("", text[start:end] * 2, random.choice(TEXTS[:20])))
        return text[:start] + piece + text[end:]

    def _changed_octets(self, octets: bytes) -> bytes:
        random = self._random
        start, end = sorted((random.randrange(len(octets)), random.randrange(len(octets) + 1)))
        return octets[:start] + random.choice((b"", random.randbytes(end - start), b"\xff" * 9)) + octets[end:]

    def changed_json(self, value: Any) -> Any:
        """JSON with one part replaced, added or left out."""
        random = self._random
        if isinstance(value, dict) and value and random.random() < 0.9:
            key = random.choice(list(value))
            rest = dict(value)
            way = random.random()
            if way < 0.08:
                del rest[key]
            elif way < 0.16:
                rest[random.choice(("unknown", "", "\ud800", "icon", "\0"))] = rest[key]
            else:
                rest[key] = self.changed_json(rest[key])
            return rest
        if isinstance(value, list) and value and random.random() < 0.9:
            number = random.randrange(len(value))
            return [*value[:number], self.changed_json(value[number]), *value[number + 1 :]]
        if isinstance(value, float | int) and random.random() < 0.5:
            return value * random.choice((-1, 0, 0.5, 2, 10, 1e6)) + random.choice((0, 1e-9, 1))
        return random.choice(JSON)

    # ---- compound types ----

    def _made(self, descriptor: Any, part: Callable[[Any], Any], leaf: Callable[[Any, int], Any], most: int) -> Any:
        kind, random = kind_of(descriptor), self._random
        self._left -= 1
        if kind in (tc.tv_struct, tc.tv_union):
            seen = self._seen.structs.get(descriptor[2])
            if part == self.plausible and seen and random.random() < 0.8:
                return random.choice(seen)
            if kind == tc.tv_struct:
                return descriptor[1](*(part(each) for each in descriptor[5::2]))
            label, _, body = random.choice(descriptor[6])
            return descriptor[1](label, part(body))
        if kind == tc.tv_sequence:
            inner = resolved(descriptor[1])
            if kind_of(inner) == tc.tv_octet:
                is_large = most > 3 and self._left > 0
                size = random.choice((0, 1, 40, 41, 1000, HUGE)) if is_large else random.choice((0, 1, 40, 80))
                self._left -= size // 100
                return random.choice((bytes(size), b"\xff" * size, random.randbytes(size)))
            count = random.randint(0, most) if self._left > 0 else 0
            if count > 100:  # of the same few values: to make them all differ takes too long
                self._left = 0  # none of them is large
                return [part(inner) for _ in range(3)] * (count // 3)
            return [part(inner) for _ in range(count)]
        return leaf(descriptor, kind)


_TYPES = (
    CORBA.TC_null,
    CORBA.TC_any,
    CORBA.TC_string,
    RoboCorba._tc_Event,
    RoboCorba._tc_Element,
    RoboCorba._tc_EventChannel,
    RoboCorba._tc_ChannelState,
)
