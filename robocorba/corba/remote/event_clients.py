"""Consumers and suppliers of a channel, called by their references."""

from __future__ import annotations

import logging
import struct
from collections.abc import Sequence
from typing import Any

import CosEventComm
from omniORB import CORBA

from robocorba.corba.calls import describe, limit_calls
from robocorba.corba.conversion import events
from robocorba.corba.orb import Orb
from robocorba.errors.events import ClientGone, EventError, InvalidEvent, NotDelivered, Refused, Unconfirmed
from robocorba.events.event import Run, Together
from robocorba.events.proxies import Kind
from robocorba.events.queue import Item
from robocorba.stubs import RoboCorba

#: Longest call that tells a client that it is disconnected.
DISCONNECT_LIMIT_S = 1.0

_log = logging.getLogger(__name__)
#: What an object says that is not there, or is not what it was taken for.
_GONE = (CORBA.OBJECT_NOT_EXIST, CORBA.INV_OBJREF, CORBA.BAD_OPERATION, CORBA.NO_IMPLEMENT, CORBA.OBJ_ADAPTER)
#: What happens on the way, whatever is sent.
_ON_THE_WAY = (CORBA.COMM_FAILURE, CORBA.TRANSIENT, CORBA.TIMEOUT, CORBA.NO_RESOURCES, CORBA.NO_MEMORY)


def failure_of(wrong: CORBA.Exception) -> EventError:
    """What an exception of a call to a client means: NotDelivered, Unconfirmed, Refused or ClientGone."""
    if isinstance(wrong, CosEventComm.Disconnected):
        return ClientGone("it says that it is disconnected")
    if isinstance(wrong, _GONE):
        return ClientGone(describe(wrong))
    if isinstance(wrong, _ON_THE_WAY):
        return (NotDelivered if wrong.completed == CORBA.COMPLETED_NO else Unconfirmed)(describe(wrong))
    return Refused(describe(wrong))


class _Client:
    """Base of all: who it is, and how to tell it that it is disconnected. The reference is this object's own."""

    def __init__(self, orb: Orb, uri: str, interface: Any, farewell: str) -> None:
        self.reference = uri
        self.address = address_of(uri)
        self._remote = orb.reference(uri, interface)
        self._limit_s = 0.0
        self._farewell = farewell

    def _set_limit(self, limit_s: float) -> None:
        """How long calls may take. The reference is this object's own, and one thread at a time calls it."""
        if limit_s != self._limit_s:
            limit_calls(self._remote, limit_s)
            self._limit_s = limit_s

    def disconnect(self) -> None:
        try:
            self._set_limit(DISCONNECT_LIMIT_S)
            getattr(self._remote, self._farewell)()
        except CORBA.Exception as wrong:
            _log.info("%s did not take its disconnection (%s)", self.address, describe(wrong))


class PushConsumer(_Client):
    """A plain consumer: one `any` a call."""

    takes_batches = False

    def __init__(self, orb: Orb, uri: str, interface: Any = CosEventComm.PushConsumer) -> None:
        super().__init__(orb, uri, interface, "disconnect_push_consumer")

    def deliver(self, items: Sequence[Item], limit_s: float) -> None:
        self._set_limit(limit_s)
        run = items[0]
        assert isinstance(run, Run)
        value = events.any_of(run)
        try:
            self._remote.push(value)
        except CORBA.Exception as wrong:
            raise failure_of(wrong) from None

    def answers(self, limit_s: float) -> bool:
        self._set_limit(limit_s)
        try:
            if self._remote._non_existent():
                raise ClientGone("it does not exist")
        except _GONE as wrong:
            raise ClientGone(describe(wrong)) from None
        except CORBA.SystemException:
            return False
        return True


class EventConsumer(PushConsumer):
    """A consumer that takes batches."""

    takes_batches = True

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, RoboCorba.EventConsumer)

    def deliver(self, items: Sequence[Item], limit_s: float) -> None:
        self._set_limit(limit_s)
        try:
            if isinstance(items[0], Together):
                self._remote.pushTogether(items[0].which, events.together(items[0]))
            else:
                self._remote.pushRuns([events.event_run(run) for run in items if isinstance(run, Run)])
        except CORBA.Exception as wrong:
            raise failure_of(wrong) from None


class PullSupplier(_Client):
    """A plain supplier that is asked."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PullSupplier, "disconnect_pull_supplier")

    def try_pull(self, limit_s: float) -> Run | None:
        self._set_limit(limit_s)
        try:
            value, has_event = self._remote.try_pull()
        except CORBA.Exception as wrong:
            raise failure_of(wrong) from None
        try:
            return events.run_of_any(value) if has_event else None
        except InvalidEvent as wrong:
            _log.warning("%s supplied an event that can't be used (%s)", self.address, wrong)
            return None


class PushSupplier(_Client):
    """A supplier that pushes, known only to be told of its disconnection."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PushSupplier, "disconnect_push_supplier")


class PullConsumer(_Client):
    """A consumer that fetches, known only to be told of its disconnection."""

    def __init__(self, orb: Orb, uri: str) -> None:
        super().__init__(orb, uri, CosEventComm.PullConsumer, "disconnect_pull_consumer")


class EventClients:
    """Finds clients by reference."""

    def __init__(self, orb: Orb) -> None:
        self._orb = orb

    def of(self, kind: Kind, reference: Any) -> Any:
        """The client of a proxy of this kind; None for nil."""
        return None if reference is None else self.find(kind.value, self._orb.uri(reference))

    def find(self, kind: str, reference: str) -> Any:
        if kind == Kind.PUSH_SUPPLIER.value:
            is_ours = _type_id(reference) == RoboCorba.EventConsumer._NP_RepositoryId
            return (EventConsumer if is_ours else PushConsumer)(self._orb, reference)
        makers = {
            Kind.PUSH_CONSUMER.value: PushSupplier,
            Kind.PULL_CONSUMER.value: PullSupplier,
            Kind.PULL_SUPPLIER.value: PullConsumer,
        }
        return makers[kind](self._orb, reference)

    def event_consumer(self, reference: Any) -> EventConsumer:
        """A consumer that said that it takes batches."""
        return EventConsumer(self._orb, self._orb.uri(reference))


def _type_id(ior: str) -> str:
    """The repository id in an IOR: what its object said that it is, without asking it."""
    try:
        return _cdr_string(bytes.fromhex(ior.removeprefix("IOR:")), 4)[0]
    except (ValueError, struct.error):
        return ""


def address_of(ior: str) -> str:
    """HOST:PORT in the first IIOP profile of an IOR; empty where there is none."""
    try:
        data = bytes.fromhex(ior.removeprefix("IOR:"))
        order = "<" if data[0] else ">"
        _, at = _cdr_string(data, 4)
        at = (at + 3) & ~3
        count, tag, length = struct.unpack_from(f"{order}III", data, at)
        if not count or tag != 0:  # not TAG_INTERNET_IOP
            return ""
        profile = data[at + 12 : at + 12 + length]
        host, end = _cdr_string(profile, 4)
        (port,) = struct.unpack_from(("<" if profile[0] else ">") + "H", profile, (end + 1) & ~1)
    except (ValueError, struct.error, IndexError):
        return ""
    return f"{host}:{port}"


def _cdr_string(data: bytes, at: int) -> tuple[str, int]:
    """The string at an offset of a CDR encapsulation, and the offset after it."""
    (length,) = struct.unpack_from(("<" if data[0] else ">") + "I", data, at)
    return data[at + 4 : at + 3 + length].decode(errors="replace"), at + 4 + length
