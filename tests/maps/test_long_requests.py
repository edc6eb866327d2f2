"""One long request at a time; what can't be served soon is refused."""

from __future__ import annotations

import pytest

from robocorba.errors.maps import ServerBusy
from robocorba.maps.long_requests import LongRequests


def test_requests_that_would_wait_too_long_are_refused() -> None:
    requests = LongRequests(wait_limit_s=0.0, max_waiting=1)
    with requests.admitted(), pytest.raises(ServerBusy, match="took more than 0 s"), requests.admitted():
        pass
    with requests.admitted():
        pass


def test_only_so_many_wait() -> None:
    requests = LongRequests(wait_limit_s=30.0, max_waiting=0)
    for _ in range(2):
        with requests.admitted(), pytest.raises(ServerBusy, match="too many"), requests.admitted():
            pass
