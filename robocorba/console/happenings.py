"""What happens in the system, in words: noticed as differences between what servers and robots report."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from robocorba.console.contacts import Contact
from robocorba.console.history import KEPT_S

#: Maximum length of a text [characters]; names may be long.
MAX_TEXT = 300
#: Contacts that are named in the text of a collision.
MAX_CONTACTS = 6
Rows = Mapping[str, Any]


class Happening(NamedTuple):
    """number: increases by one. at: time by the clock of `note` [s]. kind: collision, robot, stop, program, mission,
    server or channel. robot, floor: those that it concerns; empty for all."""

    number: int
    at: float
    kind: str
    robot: str
    floor: str
    text: str


class Happenings:
    """The happenings of the last KEPT_S seconds. Thread-safe.

    contacts: says who has begun to touch whom before a time [s]."""

    def __init__(self, contacts: Callable[[float], Sequence[Contact]] = lambda at_s: ()) -> None:
        self._contacts = contacts
        self._lock = threading.Lock()
        self._kept: deque[Happening] = deque(maxlen=2000)
        self._count = 0
        self._before: Rows | None = None
        #: Whether `note` waits for `restore`.
        self.is_held = False

    def restore(self, earlier: Sequence[Happening]) -> None:
        """Begin with what was noted before this process; numbers go on."""
        with self._lock:
            self._kept.extend(earlier)
            self._count = max((happening.number for happening in earlier), default=0)
            self.is_held = False

    def note(self, rows: Rows, at_s: float) -> None:
        """Compare rows, as of SystemState, with those of the last call. at_s: by a clock that passes steadily [s]."""
        if self.is_held:
            return
        found = list(_differences(self._before, rows)) if self._before is not None else []
        if self._before is not None or not rows["naming"]:  # what was there before the console is no news
            self._before = rows
        # Outside of the lock: naming collisions takes a while.
        found = [("collision", *self._collision(each[3], at_s)) if each[0] == "collision" else each for each in found]
        with self._lock:
            for kind, robot, floor, text in found:
                self._count += 1
                self._kept.append(Happening(self._count, at_s, kind, robot, floor, text[:MAX_TEXT]))
            while self._kept and self._kept[0].at < at_s - KEPT_S:
                self._kept.popleft()

    def _collision(self, text: str, at_s: float) -> tuple[str, str, str]:
        """Robot, floor and text of collisions: with the names of those that have begun to touch, if they are known."""
        contacts = self._contacts(at_s)
        if not contacts:
            return "", "", text
        pairs = [f"{_shown(contact.robot)} and {_shown(contact.other)}" for contact in contacts[:MAX_CONTACTS]]
        more = " and others" if len(contacts) > MAX_CONTACTS else ""
        return contacts[0].robot, contacts[0].floor, f"{text}: {', '.join(pairs)}{more}"

    def after(self, number: int) -> list[Happening]:
        """Happenings with a higher number, the oldest first."""
        with self._lock:
            return [happening for happening in self._kept if happening.number > number]

    @property
    def last(self) -> int:
        """Number of the last happening; 0 before the first."""
        return self._count


#: Kind, robot, floor, text.
Difference = tuple[str, str, str, str]


def _differences(before: Rows, now: Rows) -> Iterator[Difference]:
    yield from _of_server(before["server"], now["server"])
    for name, row in now["robots"].items():
        old = before["robots"].get(name)
        if old is None:
            yield "robot", name, _floor(row), f"{_shown(name)} has started"
        else:
            yield from _of_robot(name, old, row)
    for name, row in now["channels"].items():
        if name in before["channels"]:
            yield from _of_channel(name, before["channels"][name], row)
        else:
            yield "channel", "", "", f"channel {_shown(name)} has started"


def _of_server(before: Rows, now: Rows) -> Iterator[Difference]:
    if bool(before["problem"]) != bool(now["problem"]):
        problem = now["problem"]
        text = f"the simulation server: {problem}" if problem else "the simulation server answers again"
        yield "server", "", "", text
    if not before["state"] or not now["state"]:
        return
    old, new = before["state"]["state"], now["state"]["state"]
    if new["collisions"] > old["collisions"]:
        count = new["collisions"] - old["collisions"]
        yield "collision", "", "", "a collision" if count == 1 else f"{count} collisions"
    if new["paused"] != old["paused"]:
        yield "server", "", "", "the simulation is paused" if new["paused"] else "the simulation continues"
    came = {client["name"]: client for client in now["state"]["clients"]}
    went = {client["name"]: client for client in before["state"]["clients"]}
    for name in came.keys() - went.keys():
        yield "robot", name, came[name]["at"]["floor"], f"{_shown(name)} has logged on"
    for name in went.keys() - came.keys():
        yield "robot", name, went[name]["at"]["floor"], f"{_shown(name)} has logged off"


def _of_robot(name: str, before: Rows, now: Rows) -> Iterator[Difference]:
    floor = _floor(now)
    if _is_silent(before) != _is_silent(now):
        words = ("does not answer" if now["bound"] else "has ended") if _is_silent(now) else "answers again"
        yield "robot", name, floor, f"{_shown(name)} {words}"
    old, new = before["state"], now["state"]
    if not old or not new:
        return
    if old["condition"] != new["condition"]:
        if new["condition"] == "STOPPED":
            yield "stop", name, floor, f"{_shown(name)} is stopped" + (f": {new['reason']}" if new["reason"] else "")
        elif old["condition"] == "STOPPED":
            yield "stop", name, floor, f"{_shown(name)} may move again"
        elif new["condition"] == "PAUSED":
            yield "program", name, floor, f"{_shown(name)} pauses its program"
    yield from _of_program(name, floor, old, new)
    for word, one, other in (("leaves", old, new), ("takes part in", new, old)):
        mission = one.get("mission", "")
        if mission and mission != other.get("mission", ""):
            yield "mission", name, floor, f"{_shown(name)} {word} mission {_shown(mission)}"


def _of_program(name: str, floor: str, old: Rows, new: Rows) -> Iterator[Difference]:
    program = new["program"]
    was_running, is_running = (each["condition"] in ("RUNNING", "PAUSED") for each in (old, new))
    if is_running and (not was_running or program["name"] != old["program"]["name"]):
        yield "program", name, floor, f"{_shown(name)} runs {_shown(program['name'])}"
    elif was_running and not is_running and program["result"] != "NO_RESULT":
        reason = f": {program['reason']}" if program["reason"] else ""
        result = f"{program['result'].lower()}{reason}"
        yield "program", name, floor, f"{_shown(name)} has ended {_shown(program['name'])}, {result}"


def _of_channel(name: str, before: Rows, now: Rows) -> Iterator[Difference]:
    if bool(before["problem"]) != bool(now["problem"]):
        problem = now["problem"]
        yield "channel", "", "", f"channel {_shown(name)}" + (f": {problem}" if problem else " answers again")
    old = _links(before)
    for peer, is_up in _links(now).items():
        if peer in old and old[peer] != is_up:
            yield "channel", "", "", f"the gateway from {_shown(peer)} to {_shown(name)} is {'up' if is_up else 'down'}"


def _links(row: Rows) -> dict[str, bool]:
    """Whether the gateway from each peer is up."""
    links = row["state"]["links"] if row["state"] else []
    return {link["peer"]: link["condition"] == "UP" for link in links if link["direction"] == "INCOMING"}


def _shown(name: str) -> str:
    """A name within a sentence: marks of writing direction in it end with it."""
    return name if name.isascii() else f"\u2068{name}\u2069"


def _is_silent(row: Rows) -> bool:
    """Whether a robot has not answered for 3 s; one that was found just now has not been asked yet."""
    return bool(row["problem"]) if row["age"] is None else bool(row["age"] > 3.0)


def _floor(row: Rows) -> str:
    return str(row["state"]["at"]["floor"]) if row["state"] else ""
