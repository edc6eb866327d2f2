"""What a channel must know again after it was killed: its proxies, its peers, the notices of the federation.

One SQLite file for each channel. Events are not in it: what waited in queues ends with the process.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

import msgspec

from robocorba.events.federation import Notice
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Subscription
from robocorba.record_file import RecordFile

#: "RoCe": tells our files from those of others.
APPLICATION_ID = 0x526F4365
SCHEMA_VERSION = 1
#: Numbers of events begin with the second of the start, counted from 2020 on, in their upper 32 bits.
FIRST_SECOND = 1_577_836_800
COUNT_BITS = 32
#: Those of proxies with the second in which the file was made, above so many bits.
ID_BITS = 10

_TABLES = ("CREATE TABLE starts (second INTEGER NOT NULL)", "CREATE TABLE ids (next INTEGER NOT NULL)")


class ProxyRecord(msgspec.Struct):
    """A proxy; `client` is the stringified reference of who is connected, empty for nil. policy: of outlets only."""

    id: str
    kind: str
    name: str = ""
    is_connected: bool = False
    is_suspended: bool = False
    client: str = ""
    subscription: Subscription = ()
    policy: QueuePolicy | None = None


class PeerRecord(msgspec.Struct):
    """A peer. address: empty for the naming service, else HOST:PORT or a URI. reference: where it was found last.
    removed: it was a peer, and must not link itself again."""

    name: str
    address: str = ""
    reference: str = ""
    foreign: bool = False
    removed: bool = False


class Store(RecordFile):
    """Opened by one process at a time. Raises AlreadyRunning, or ServiceError for whatever is wrong with the file."""

    def __init__(self, file: Path) -> None:
        # Where an older file was lost, its numbers must not come again: clients still hold them.
        first_id = (int(time.time()) - FIRST_SECOND) << ID_BITS
        super().__init__(file, APPLICATION_ID, SCHEMA_VERSION, (*_TABLES, f"INSERT INTO ids VALUES ({first_id})"))

    def first_number(self) -> int:
        """The number of the first event after this start: higher than any before, also where this file was lost."""
        with self._guarded():
            last = self._db.execute("SELECT max(second) FROM starts").fetchone()[0]
            second = max(int(time.time()) - FIRST_SECOND, (last or 0) + 1)
            self._db.execute("DELETE FROM starts")
            self._db.execute("INSERT INTO starts VALUES (?)", (second,))
        return (second << COUNT_BITS) + 1

    def next_id(self) -> int:
        """A number that no proxy of this channel had."""
        with self._guarded():
            ((id,),) = self._db.execute("UPDATE ids SET next = next + 1 RETURNING next - 1").fetchall()
            return int(id)

    def proxies(self) -> list[ProxyRecord]:
        return self.all("proxy", ProxyRecord)

    def save_proxy(self, record: ProxyRecord) -> None:
        self.save("proxy", record.id, record)

    def forget_proxy(self, id: str) -> None:
        self.forget("proxy", id)

    def peers(self) -> list[PeerRecord]:
        return self.all("peer", PeerRecord)

    def save_peer(self, record: PeerRecord) -> None:
        self.save("peer", record.name, record)

    def forget_peer(self, name: str) -> None:
        self.forget("peer", name)

    def notices(self) -> list[Notice]:
        return self.all("notice", Notice)

    def save_notices(self, notices: Iterable[Notice]) -> None:
        """Keep these, and no others."""
        self.replace("notice", ((notice.name, notice) for notice in notices))
