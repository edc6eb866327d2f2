"""Timeouts and limits of proxies and links, with their defaults."""

from __future__ import annotations

from dataclasses import dataclass, field

from robocorba.system.backoff import Backoff


@dataclass(frozen=True)
class DeliveryPolicy:
    """How a proxy calls its client: a consumer to which it delivers, or a supplier that it polls."""

    #: Timeout of a call from the proxy's own thread [s].
    call_timeout_s: float = 10.0
    #: Timeout of a call from a supplier's thread [s]. A consumer that hangs delays the others once by this time.
    inline_timeout_s: float = 0.05
    #: A consumer is fast while its mean call duration is below this [s].
    fast_call_s: float = 0.002
    #: Maximum size of a call to a consumer that takes batches [events, bytes].
    call_events: int = 1000
    call_bytes: int = 2**20
    #: The proxy's thread ends after this time without work [s].
    idle_s: float = 5.0
    #: A call to an idempotent consumer that gets no answer is repeated this many times: its events could be the cause.
    max_repeats: int = 3
    #: Timeout of a probe of a stalled consumer [s].
    probe_timeout_s: float = 1.0
    #: Pauses between the probes of a stalled consumer, and after failed polls.
    backoff: Backoff = field(default=Backoff(0.05, 1.0))
    #: A client is disconnected after this many failures in a row; with the backoff, a dead one after 17 s.
    max_failures: int = 20
    #: Pause after a stall of a consumer that is not idempotent [s]: in general the call that timed out ends in this
    #: time, so that the next event does not overtake it.
    settle_s: float = 0.1
    #: Events are a flood when they follow each other within this multiple of the mean call duration ...
    flood_gap: float = 1.5
    #: ... but at most within this time [s].
    max_flood_gap_s: float = 0.0005
    #: Coalescing pause [s]: more events are waiting for a consumer that takes batches, so the next call can be larger.
    coalesce_s: float = 0.001
    #: Intervals between polls while a supplier has no events, and timeout of a poll [s].
    poll_intervals: Backoff = field(default=Backoff(0.001, 0.01))
    poll_timeout_s: float = 2.0


@dataclass(frozen=True)
class ProxyPolicy:
    """Limits of the proxies of a channel, and how they call their clients."""

    max_proxies: int = 10_000
    #: At max_proxies, a proxy consumer without a known client makes room if it was unused for this time [s].
    unused_s: float = 3600.0
    #: At max_proxies, a proxy that was obtained but not connected, or by which nobody pulls, makes room after this time
    #: [s]: clients that forget theirs must not keep others out.
    forgotten_s: float = 10.0
    delivery: DeliveryPolicy = field(default=DeliveryPolicy())


@dataclass(frozen=True)
class ChannelPolicy:
    """Limits of what a channel passes on."""

    #: Maximum time for which one call of a supplier waits for room in queues [s]. Clients with a call timeout of
    #: 5 s get an answer within it; without one they would not know whether their event was received.
    max_blocked_s: float = 4.0
    #: Maximum time that an event waits for earlier ones [s]. These may be on their way by a link that has just been
    #: cut: the channel before it notices that after 5 s at most (LinkPolicy.silence_s), and sends them by another way.
    #: What a killed channel held never comes.
    max_held_s: float = 6.0
    #: Maximum number of events that wait for earlier ones. Beyond that the missing ones are not waited for.
    max_held: int = 10_000
    #: A copy of an event that has crossed this many links is discarded. For the milliseconds in which a change of the
    #: links spreads, two channels may send a copy to each other.
    max_hops: int = 1000


@dataclass(frozen=True)
class LinkPolicy:
    """How the two ends of a link behave: the feed, which supplies, and the gateway, which consumes."""

    #: Maximum number of events that wait in the feed; beyond that the oldest are discarded.
    max_queued: int = 100_000
    #: Maximum number of packets in flight. A supplier's thread sends only while fewer than inline_window are.
    window: int = 64
    inline_window: int = 16
    #: Maximum size of a packet [events, bytes]; a single larger event is a packet of its own.
    packet_events: int = 1000
    packet_bytes: int = 2**20
    #: Timeout of a send by the feed's thread, and by a supplier's thread [s].
    send_timeout_s: float = 2.0
    inline_timeout_s: float = 0.05
    #: After a send slower than this, a supplier's thread leaves its other calls to their own threads [s].
    fast_send_s: float = 0.005
    #: Maximum number of packets that the gateway keeps until an earlier, missing packet arrives.
    max_early: int = 64
    #: The gateway acknowledges after this many packets, or with the first packet after this time [s].
    acknowledge_packets: int = 4
    acknowledge_s: float = 0.02
    #: The feed regards the link as down when the gateway has not called for this time [s].
    lease_s: float = 3.0
    #: Interval at which the gateway renews its session [s]; several renewals may fail within a lease.
    renew_interval_s: float = 0.5
    #: Above this number of peers the interval grows with it, to max_renew_interval_s: in a full mesh of 30 channels
    #: idle links would take most of a core. Two renewals still fit into a lease.
    few_peers: int = 10
    max_renew_interval_s: float = 1.25
    #: A packet is lost when it is not acknowledged this long after it was sent and after the last progress [s].
    retransmit_s: float = 0.3
    #: Maximum interval at which the feed's thread checks for work [s].
    recheck_s: float = 2.0
    #: The feed sends an empty packet when it has sent nothing, and the peer has answered no renewal, for this time [s].
    probe_interval_s: float = 2.0
    #: The link is down when no packet arrived, or none was acknowledged, for this time [s]; several probes may be late.
    silence_s: float = 5.0
    #: Pauses between the gateway's attempts to join the feed.
    backoff: Backoff = field(default=Backoff(0.05, 0.5, jitter=0.5))
    #: The same while the peer answers, but refuses.
    refused_backoff: Backoff = field(default=Backoff(0.05, 5.0, jitter=0.5))
    #: Interval between checks that a foreign channel answers [s].
    check_interval_s: float = 1.0
    #: A foreign channel that returns nothing for this time after an event was pushed to it cannot call us [s].
    return_s: float = 10.0
    #: Pauses between attempts to connect with a foreign channel, and after a connection that lasted for less than
    #: check_interval_s.
    foreign_backoff: Backoff = field(default=Backoff(0.05, 1.0, jitter=0.5))

    def renewal_pause_s(self, peers: int) -> float:
        """Pause between the renewals of a session of a channel with this many peers [s]."""
        return max(
            self.renew_interval_s, min(self.renew_interval_s * peers / self.few_peers, self.max_renew_interval_s)
        )

    def news_pause_s(self, peers: int) -> float:
        """Shortest pause between two renewals that carry news [s]: none with few peers."""
        return self.renewal_pause_s(peers) / 2 if peers > self.few_peers else 0.0
