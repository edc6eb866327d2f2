"""The supplying end of a link, with a gateway whose answers each test chooses."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from robocorba.errors.events import NotDelivered, SessionOver
from robocorba.events.account import Account, LinkEnd
from robocorba.events.event import EventBatch, EventHeader
from robocorba.events.feed import Feed
from robocorba.events.policies import LinkPolicy
from testkit.processes import eventually
from tests.events.samples import is_balanced
from tests.waits import outlast, stays

#: Without probes, which would get positions between those of events.
DEFAULTS = LinkPolicy(probe_interval_s=math.inf)

#: When the monotonic clock was 0 [s since 1970].
EPOCH = time.time() - time.monotonic()
DEAD = NotDelivered("it is dead")


class Gateway:
    """Keeps what was forwarded to it. The first packet of a session, which is empty, is acknowledged at once, and not
    counted: positions are those of packets with events."""

    def __init__(self) -> None:
        self.acknowledge: Callable[[str, int], None] = lambda session, position: None
        self.got: list[tuple[str, int, list[EventBatch]]] = []
        self.problem: Exception | None = None
        #: Whether it acknowledges a packet before the call returns.
        self.is_quick = False
        #: Time that a call needs [s].
        self.shortest_s = 0.0
        self.refused: set[bytes] = set()
        self.may_take = threading.Event()
        self.may_take.set()

    def forward(self, session: str, position: int, batches: list[EventBatch], limit_s: float) -> list[EventBatch]:
        assert self.may_take.wait(60.0)
        if self.problem:
            raise self.problem
        if limit_s < self.shortest_s:
            raise NotDelivered("too late")
        if not batches:
            self.acknowledge(session, position + 1)
            return []
        unsendable = [batch for batch in batches if self.refused.intersection(batch.payloads)]
        self.got.append((session, position - 1, [batch for batch in batches if batch not in unsendable]))
        if self.is_quick:
            self.acknowledge(session, position + 1)
        return unsendable

    def payloads(self, session: str = "") -> list[int]:
        found = [batch for name, _, batches in self.got if name == (session or name) for batch in batches]
        return [int(payload[-6:]) for batch in found for payload in batch.payloads]


class Setting:
    """A feed and its lock; what is offered has rising numbers."""

    def __init__(self, policy: LinkPolicy = DEFAULTS) -> None:
        self.lock = threading.Lock()
        self.feed = Feed(self.lock, "hall", policy)
        self.gateway = Gateway()
        self.gateway.acknowledge = self._acknowledge
        self.session = ""
        self._next = 1

    def batch(self, count: int = 1, expiry: float = 0.0, bytes: int = 0, type: str = "t") -> EventBatch:
        first, self._next = self._next, self._next + count
        payloads = [b"%0*d" % (bytes, number) for number in range(first, first + count)]
        header = EventHeader(type, "s", "lab", expiry=expiry)
        return EventBatch(header, [time.time()] * count, payloads, first, epoch=EPOCH)

    def accept(self, batch: EventBatch) -> bool:
        with self.lock:
            return self.feed.accept(batch)

    def publish(self, count: int = 1, *, expiry: float = 0.0, bytes: int = 0, type: str = "t", **before: int) -> None:
        """before: by channels beyond the peer."""
        batch = self.batch(count, expiry=expiry, bytes=bytes, type=type)
        batch.targets = before or None
        if self.accept(batch):
            self.feed.deliver(batch)

    def join(self) -> str:
        with self.lock:
            self.session, position = self.feed.join(self.gateway.forward)
        assert position == 1
        return self.session

    def connect(self) -> None:
        """Join, and renew for the first time."""
        self.join()
        self.renew(0)
        eventually(lambda: self.problem() == "", what="the acknowledgement of the first packet")

    def renew(self, position: int, refused: int = 0) -> None:
        with self.lock:
            self.feed.renew(self.session, position + 1, refused)

    def acknowledge(self, position: int) -> None:
        self._acknowledge(self.session, position + 1)

    def _acknowledge(self, session: str, position: int) -> None:
        with self.lock:
            self.feed.acknowledge(session, position)

    def snapshot(self) -> LinkEnd:
        with self.lock:
            return self.feed.snapshot()

    def problem(self) -> str:
        return self.snapshot().problem

    def check_account(self) -> Account:
        totals = self.snapshot().totals
        assert is_balanced(totals)
        return totals


@pytest.fixture
def at(request: pytest.FixtureRequest) -> Iterator[Setting]:
    """`request.param`: its policy, if not the default."""
    setting = Setting(getattr(request, "param", DEFAULTS))
    yield setting
    setting.gateway.may_take.set()
    with setting.lock:
        setting.feed.end()


def test_packets_grow_under_load(at: Setting) -> None:
    at.connect()
    at.gateway.may_take.clear()
    sender = threading.Thread(target=at.publish)
    sender.start()
    eventually(lambda: at.feed._busy, what="a send that takes long")
    for _ in range(500):
        at.publish()
    at.gateway.may_take.set()
    sender.join(60.0)
    eventually(lambda: len(at.gateway.payloads()) == 501, what="all events")
    assert at.gateway.payloads() == list(range(1, 502))
    assert len(at.gateway.got) == 2
    assert len(at.gateway.got[1][2]) == 1  # merged into one batch


def test_at_most_a_window_of_packets_is_in_flight(at: Setting) -> None:
    at.connect()
    for number in range(3 * DEFAULTS.window):
        at.publish(1, type=f"t{number % 2}")
    eventually(lambda: len(at.gateway.got) >= DEFAULTS.inline_window + 1, what="a full window")
    stays(lambda: max(position for _, position, _ in at.gateway.got) <= DEFAULTS.window)
    at.acknowledge(at.gateway.got[-1][1] + 1)
    eventually(lambda: len(at.gateway.payloads()) == 3 * DEFAULTS.window, what="the rest")
    assert at.gateway.payloads() == sorted(at.gateway.payloads())


@pytest.mark.parametrize("joins", [True, False])
def test_an_event_that_is_claimed_keeps_its_place(at: Setting, joins: bool) -> None:
    """1 is in flight, 2 claimed, 3 waits, when a session begins, or 2 is handed over to the feed's thread."""
    at.connect()
    at.publish()
    claimed, session = at.batch(), at.session
    assert at.accept(claimed)
    at.publish()
    if joins:
        session = at.join()
        assert not at.gateway.payloads(session)
        at.feed.deliver(claimed)
        at.renew(1)
    else:
        for _ in range(2):  # the second time it has no effect any more
            at.feed.defer(claimed)
    eventually(lambda: at.gateway.payloads(session) == [1, 2, 3], what="all in order")
    assert at.check_account() == Account(3, queued=3)


@pytest.mark.parametrize(("problem", "shown"), [(DEAD, "it is dead"), (ValueError("a fault"), "internal fault")])
def test_what_failed_is_sent_again_by_a_renewal_that_hides_nothing(at: Setting, problem: Exception, shown: str) -> None:
    """The gateway can call, and can't be called: the link is down until it has acknowledged a packet."""
    at.connect()
    at.gateway.problem = problem
    at.publish()
    eventually(lambda: shown in at.problem(), what="the link to be down")
    at.publish()
    for _ in range(5):
        at.renew(1)
        assert shown in at.problem()
    at.gateway.problem = None
    at.renew(1)
    eventually(lambda: at.gateway.payloads() == [1, 2], what="both, in order")
    assert shown in at.problem()
    at.acknowledge(2)
    assert at.problem() == ""


@pytest.mark.parametrize("at", [replace(DEFAULTS, silence_s=0.05)], indirect=True)
def test_a_link_is_down_while_nothing_is_acknowledged(at: Setting) -> None:
    at.connect()
    at.publish()
    for _ in range(2):
        eventually(lambda: "has acknowledged nothing" in at.problem(), what="the link to be down")
        at.renew(1)
    at.acknowledge(2)
    assert at.problem() == ""


@pytest.mark.parametrize("at", [replace(DEFAULTS, probe_interval_s=0.01, recheck_s=0.01)], indirect=True)
def test_without_events_the_feed_notices_that_the_gateway_is_out_of_reach(at: Setting) -> None:
    at.connect()
    at.gateway.problem = DEAD
    eventually(lambda: at.problem() == "it is dead", what="the link to be down")
    at.gateway.problem = None
    at.renew(1)
    eventually(lambda: at.problem() == "", what="the link")
    assert at.snapshot().packets == 0, "those with events count"


def test_a_packet_that_a_supplier_had_no_time_for_is_sent_again_at_once(at: Setting) -> None:
    """Without a renewal: the link is not down because a thread waited for a processor."""
    at.connect()
    at.gateway.shortest_s = 2 * DEFAULTS.inline_timeout_s
    at.publish()
    at.publish()
    eventually(lambda: at.gateway.payloads() == [1, 2], what="both, in order")
    assert at.problem() == ""
    at.acknowledge(3)
    assert at.check_account() == Account(2, 2)


def sent(gateway: Gateway) -> list[tuple[int, int, dict[str, int] | None]]:
    """First and last number and the targets of what was sent."""
    return [(batch.first, batch.last, batch.targets) for _, _, batches in gateway.got for batch in batches]


def test_nobody_waits_for_expired_events(at: Setting) -> None:
    at.publish(hall=0)
    at.publish(3, expiry=0.05, hall=1)
    at.publish(hall=4)
    at.publish(expiry=0.05, hall=5)
    outlast(0.05)
    at.connect()
    eventually(lambda: sent(at.gateway) == [(1, 1, {"hall": 0}), (5, 5, {"hall": 1})], what="what lives")
    at.publish(hall=6)
    eventually(lambda: sent(at.gateway)[2:] == [(7, 7, {"hall": 5})], what="what comes next")
    assert at.check_account() == Account(7, expired=4, queued=3)


def test_what_is_in_flight_at_a_link_that_is_down_goes_by_both_ways(at: Setting) -> None:
    """It may have arrived: then the account of the peer has it, too."""
    at.connect()
    at.gateway.problem = DEAD
    at.publish(yard=0, hall=0)
    eventually(lambda: at.problem() == "it is dead", what="the link to be down")
    at.publish(yard=1)
    ways = {"hall": "hall", "yard": "attic"}
    with at.lock:
        moved = [(batch.first, batch.targets) for batch in at.feed.withdraw(ways)]
        assert (moved, at.feed.withdraw(ways)) == ([(1, {"yard": 0}), (2, {"yard": 1})], [])
    assert at.check_account().queued == 1
    at.gateway.problem = None
    at.renew(1)
    eventually(lambda: sent(at.gateway) == [(1, 1, {"hall": 0})], what="the rest")


def test_a_large_batch_is_sent_in_several_packets(at: Setting) -> None:
    at.connect()
    at.publish(20, bytes=300_000)
    eventually(lambda: len(at.gateway.payloads()) == 20, what="all of it")
    assert at.gateway.payloads() == list(range(1, 21))
    assert max(sum(batch.size for batch in batches) for _, _, batches in at.gateway.got) < 2 * DEFAULTS.packet_bytes
    at.publish(2 * DEFAULTS.packet_events + 1)
    eventually(lambda: len(at.gateway.payloads()) == 21 + 2 * DEFAULTS.packet_events, what="a long batch")
    assert max(len(batch) for _, _, batches in at.gateway.got for batch in batches) <= DEFAULTS.packet_events


@pytest.mark.parametrize("is_quick", [False, True])
@pytest.mark.parametrize("refused", [{b"2"}, {b"1", b"2", b"3"}])
def test_unsendable_events_are_discarded_and_delay_no_others(at: Setting, refused: set[bytes], is_quick: bool) -> None:
    at.gateway.refused, at.gateway.is_quick = refused, is_quick
    for number in range(3):
        at.publish(1, type=f"t{number}")
    at.connect()
    left = 3 - len(refused)
    eventually(lambda: at.check_account().discarded == len(refused), what="the account")
    assert len(at.gateway.payloads()) == left
    at.acknowledge(2)
    assert at.check_account() == Account(3, left, discarded=len(refused))
    assert at.snapshot().lag_s == 0.0


def test_the_end_discards_all_that_waits_and_ends_the_thread(at: Setting) -> None:
    at.connect()
    at.publish()
    claimed = at.batch()
    assert at.accept(claimed)
    at.publish()
    thread = at.feed._thread
    with at.lock:
        at.feed.end()
    at.feed.deliver(claimed)
    assert at.check_account() == Account(3, discarded=3)
    assert thread is not None
    thread.join(60.0)
    assert not thread.is_alive()


def test_a_thread_that_ends_by_a_defect_ends_the_session(at: Setting) -> None:
    class Broken(EventHeader):
        def __eq__(self, other: object) -> bool:
            raise ValueError("a fault")

        __hash__ = EventHeader.__hash__

    for number in (1, 2):  # merging them compares their headers
        at.accept(EventBatch(Broken("t", "s", "lab"), [time.time()], [b"1"], number, epoch=EPOCH))
    session = at.join()
    at.renew(1)
    eventually(lambda: "ValueError: a fault" in at.problem(), what="the problem")
    with pytest.raises(SessionOver):
        at._acknowledge(session, 2)
    at.connect()
    at.publish()
    eventually(lambda: at.gateway.payloads() == [1], what="a later event")
