"""A channel's server that disconnects silent clients after seconds."""

from __future__ import annotations

from robocorba.events.policies import DeliveryPolicy, ProxyPolicy
from robocorba.servers import event_channel
from robocorba.system.backoff import Backoff

BACKOFF = Backoff(0.05, 0.2)
POLICY = ProxyPolicy(
    delivery=DeliveryPolicy(
        call_timeout_s=1.0, probe_timeout_s=0.3, backoff=BACKOFF, max_failures=6, poll_timeout_s=0.3
    )
)

if __name__ == "__main__":
    event_channel.main(policy=POLICY)
