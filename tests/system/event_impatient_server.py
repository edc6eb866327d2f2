"""A channel's server that gives silent clients up after seconds, and has few proxies: for tests of its limits."""

from __future__ import annotations

from robocorba.events import inlet, proxies, push_outlet
from robocorba.servers import event_channel

push_outlet.MAX_FAILURES = inlet.MAX_FAILURES = 6
push_outlet.MAX_PAUSE_S = inlet.MAX_PAUSE_S = 0.2
push_outlet.PING_LIMIT_S, push_outlet.CALL_LIMIT_S, inlet.CALL_LIMIT_S = 0.3, 1.0, 0.3
proxies.MAX_PROXIES = 100

if __name__ == "__main__":
    event_channel.main()
