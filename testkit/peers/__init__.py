"""The brokers that are compared, behind a common interface."""

from __future__ import annotations

import omniORB  # noqa: F401  makes the OMG stubs importable

from testkit.peers import brokers, corba
from testkit.peers.base import Peer

PEERS: dict[str, Peer] = {
    peer.name: peer
    for peer in (
        *(corba.PLAIN, corba.PLAIN_TO_BATCHES, corba.HEADER, corba.CLIENT, corba.ON_ONE_CORE),
        *(corba.OMNIEVENTS, brokers.REDIS, brokers.MQTT),
    )
}


def installed() -> list[str]:
    """Names of the peers that can run here."""
    return [name for name, peer in PEERS.items() if not peer.missing()]
