"""Pauses between attempts, and how long an operation is repeated."""

from __future__ import annotations

import time

import pytest

from robocorba.backoff import Backoff

QUICK = Backoff(0.001, 0.002)


def test_pauses_grow_up_to_a_limit() -> None:
    backoff = Backoff(0.1, 1.0, factor=3.0)
    assert [round(backoff.pause_s(failures), 6) for failures in range(6)] == [0.0, 0.1, 0.3, 0.9, 1.0, 1.0]
    assert backoff.pause_s(10**9) == 1.0


def test_jitter_shortens_pauses() -> None:
    pauses = {Backoff(1.0, 1.0, jitter=0.5).pause_s(1) for _ in range(50)}
    assert len(pauses) > 1
    assert all(0.5 <= pause_s <= 1.0 for pause_s in pauses)


def test_an_operation_is_repeated_until_it_succeeds() -> None:
    answers = iter([OSError("first"), OSError("second"), 7])

    def operation() -> int:
        answer = next(answers)
        if isinstance(answer, OSError):
            raise answer
        return answer

    assert QUICK.call(operation, 10.0, OSError) == 7


@pytest.mark.parametrize(("timeout_s", "errors"), [(0.0, (OSError,)), (0.05, (OSError,)), (10.0, (ValueError,))])
def test_the_last_error_is_raised(timeout_s: float, errors: tuple[type[Exception], ...]) -> None:
    def operation() -> None:
        raise OSError("refused")

    began = time.monotonic()
    with pytest.raises(OSError, match="refused"):
        QUICK.call(operation, timeout_s, *errors)
    assert time.monotonic() - began < 5.0


def test_a_condition_is_polled() -> None:
    answers = iter([0, 0, 3])
    assert QUICK.poll(lambda: next(answers), 10.0) == 3
    assert QUICK.poll(lambda: 0, 0.0) == 0
