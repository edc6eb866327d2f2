"""A mission is started from the JSON of exactly one cooperative icon."""

from __future__ import annotations

import json

import pytest

from robocorba.errors.robots import InvalidProgram
from robocorba.programs.icons import HandOver
from robocorba.programs.program import MAX_BYTES, of_icon

HAND_OVER = json.dumps({"icon": "hand_over", "object": "cup", "taker": "B"})


def test_the_program_has_this_icon() -> None:
    assert of_icon(HAND_OVER).icons == (HandOver("cup", "B"),)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"{HAND_OVER}, {HAND_OVER}", "not JSON"),
        (f'{HAND_OVER}], "robot": "SmartPal", "icons": [{HAND_OVER}', "not JSON"),
        (f"[{HAND_OVER}]", "icons"),
        ("", "not JSON"),
        ("null", "icons"),
        ('{"icon": "wait", "seconds": 1}', "wait is not a cooperative icon; known are move_table, hand_over"),
        (json.dumps({"icon": "repeat", "times": 2, "icons": [json.loads(HAND_OVER)]}), "not a cooperative icon"),
        ('{"icon": "hand_over", "object": "cup"}', "taker"),
        (" " * (MAX_BYTES + 1), "bytes"),
        ("[" * 100_000, ""),
    ],
)
def test_anything_else_is_refused(text: str, reason: str) -> None:
    with pytest.raises(InvalidProgram) as refused:
        of_icon(text)
    assert reason in str(refused.value)
