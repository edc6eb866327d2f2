"""The brokers that are compared, each behind the same few calls."""

from __future__ import annotations

import omniORB  # noqa: F401  the standard's stubs can be imported from here on

from bench.events.channel.peers import mosquitto, nats, omnievents, ours, redis, relay, zenoh, zeromq
from bench.events.channel.peers.base import Peer

PEERS: dict[str, Peer] = {
    peer.name: peer
    for peer in (
        ours.PLAIN,
        ours.PLAIN_TO_BATCHES,
        ours.HEADER,
        ours.CLIENT,
        ours.BOUNDED,
        ours.ON_ONE_CORE,
        relay.PEER,
        omnievents.PEER,
        redis.PEER,
        mosquitto.PEER,
        nats.PEER,
        zeromq.PEER,
        zenoh.PEER,
    )
}


def installed() -> list[str]:
    """Names of those that can run here."""
    return [name for name, peer in PEERS.items() if not peer.missing()]
