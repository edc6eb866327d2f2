"""The persistent state of a channel: its proxies, its peers and the advertisements of the federation.

One SQLite file for each channel. Events are not stored: queued events end with the process.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from pathlib import Path

import msgspec

from robocorba.events.event_numbers import first_number_of, next_life
from robocorba.events.federation import Advertisement
from robocorba.events.queue import QueuePolicy
from robocorba.events.subscription import Subscription
from robocorba.system.record_file import RecordFile

#: "RoCe", the application id in the header of the SQLite file.
APPLICATION_ID = 0x526F4365
SCHEMA_VERSION = 1
_TABLES = ("CREATE TABLE starts (second INTEGER NOT NULL)", "CREATE TABLE ids (next INTEGER NOT NULL)")


class StoredProxy(msgspec.Struct):
    """A proxy as stored. client: stringified reference of the connected client, empty for nil. policy: queue of a proxy
    supplier."""

    id: str
    kind: str
    name: str = ""
    is_connected: bool = False
    is_suspended: bool = False
    client: str = ""
    subscription: Subscription = ()
    policy: QueuePolicy | None = None


class Peer(msgspec.Struct):
    """A channel to link with. address: HOST:PORT or a URI, empty to use the naming service. reference: the last valid
    stringified reference. foreign: it supports CosEventChannelAdmin only. removed: a former peer, whose attempts to
    link again are refused."""

    name: str
    address: str = ""
    reference: str = ""
    foreign: bool = False
    removed: bool = False


class ChannelStore(RecordFile):
    """Opened by one process at a time. Raises AlreadyRunning, or ServiceError if the file cannot be used."""

    def __init__(self, file: Path) -> None:
        # Ids of proxies count on from a random number, and skip a random one at each start: a channel that lost its
        # file, or was put back to an earlier one, uses no id again. Clients still hold its references.
        first_id = secrets.randbits(48)
        super().__init__(file, APPLICATION_ID, SCHEMA_VERSION, (*_TABLES, f"INSERT INTO ids VALUES ({first_id})"))
        with self._writing():
            self._db.execute("UPDATE ids SET next = next + ?", (secrets.randbits(32),))

    def first_number(self) -> int:
        """The number of the first event after this start; see `event_numbers`."""
        with self._writing():
            last = self._db.execute("SELECT max(second) FROM starts").fetchone()[0]
            life = next_life(int(last or 0))  # release 0.1.0 kept the time of the start
            self._db.execute("DELETE FROM starts")
            self._db.execute("INSERT INTO starts VALUES (?)", (life,))
        return first_number_of(life)

    def next_id(self) -> int:
        """An id that no proxy of this channel had before."""
        with self._writing():
            ((id,),) = self._db.execute("UPDATE ids SET next = next + 1 RETURNING next - 1").fetchall()
            return int(id)

    def proxies(self) -> list[StoredProxy]:
        return self.all("proxy", StoredProxy)

    def save_proxy(self, proxy: StoredProxy) -> None:
        self.save("proxy", proxy.id, proxy)

    def forget_proxy(self, id: str) -> None:
        self.delete("proxy", id)

    def peers(self) -> list[Peer]:
        return self.all("peer", Peer)

    def save_peer(self, peer: Peer) -> None:
        self.save("peer", peer.name, peer)

    def forget_peer(self, name: str) -> None:
        self.delete("peer", name)

    def advertisements(self) -> list[Advertisement]:
        return self.all("notice", Advertisement)

    def save_advertisements(self, advertisements: Iterable[Advertisement]) -> None:
        """Replace all stored advertisements."""
        self.replace("notice", ((entry.name, entry) for entry in advertisements))
