"""robocorba robot hands its arguments on as they are."""

from __future__ import annotations

import os

import pytest
from typer.testing import CliRunner

from robocorba.commands import command
from robocorba.supervision.launch import module_command


@pytest.mark.parametrize(
    "arguments",
    [
        ["A", "--floor", "L1"],
        ["A", "--adaptor", "smartpal", "--naming", "h:1", "--", "--naming", "robot:2", "--pose=1,2,3"],
        ["--adaptor", "smartpal", "A", "--", "--naming", "robot:2"],
        ["A", "--help"],
        ["--help"],
    ],
)
def test_arguments_of_the_adaptor_stay_apart(monkeypatch: pytest.MonkeyPatch, arguments: list[str]) -> None:
    given: list[tuple[str, ...]] = []
    monkeypatch.setattr(os, "execv", lambda program, words: given.append(words))
    assert CliRunner().invoke(command(), ["robot", *arguments]).exit_code == 0
    assert given == [module_command("robocorba.clients.robot", *arguments)]
