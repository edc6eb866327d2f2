"""The exit code of a bench says whether its marks were reached, missed or not measured."""

from __future__ import annotations

import sys

import pytest

from bench.common.harness import NOT_MEASURED, NotMeasured, run


def _reaches() -> bool:
    return True


def _misses() -> bool:
    return False


def _cannot_measure() -> bool:
    raise NotMeasured("needs root")


@pytest.mark.parametrize(("bench", "code"), [(_reaches, 0), (_misses, 1), (_cannot_measure, NOT_MEASURED)])
def test_the_exit_code(bench: object, code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["bench"])
    with pytest.raises(SystemExit) as ended:
        run(bench)  # type: ignore[arg-type]
    assert ended.value.code == code
