"""The example clients, where they are called wrongly."""

from __future__ import annotations

import runpy

import pytest


@pytest.mark.parametrize(
    ("client", "arguments"),
    [
        ("get_path", []),
        ("get_path", ["--help"]),
        ("events", ["publish"]),
        ("events", ["tell", "lab"]),
        ("plain_events", []),
    ],
)
def test_wrong_arguments_are_answered_by_the_usage(
    client: str, arguments: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", [client, *arguments])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module(f"robocorba.clients.{client}", run_name="__main__")
    assert f"python -m robocorba.clients.{client} " in str(ended.value)


def test_a_system_that_does_not_run_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["get_path", "L1", "3", "4", "L3", "10", "2", "127.0.0.1:1"])
    with pytest.raises(SystemExit, match="1"):
        runpy.run_module("robocorba.clients.get_path", run_name="__main__")
    assert capfd.readouterr().err == "nothing answers at 127.0.0.1:1: is `robocorba up` running there?\n"
