"""The brokers that are compared, behind a common interface."""

from __future__ import annotations

import omniORB  # noqa: F401  makes the OMG stubs importable

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
    """Names of the peers that can run here."""
    return [name for name, peer in PEERS.items() if not peer.missing()]
