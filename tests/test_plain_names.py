"""Names of ROS for names that ROS does not allow."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from robocorba.plain_names import PlainNames, names_in, plain_name


def test_what_is_allowed_stays() -> None:
    assert [plain_name(name) for name in ("A", "robot_7", "2nd floor", "l'été", "a--b")] == [
        *("A", "robot_7", "_2nd_floor", "l_t_", "a_b")
    ]


@given(st.lists(st.text(min_size=1), unique=True))
def test_names_are_allowed_unique_and_stay(names: list[str]) -> None:
    ros = PlainNames()
    found = [ros[name] for name in names]
    assert all(re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) and "__" not in name for name in found)
    assert len(set(found)) == len(names)
    assert [ros[name] for name in names] == found


def test_lists() -> None:
    assert names_in("A, B,") == {"A", "B"}
    assert names_in("") is None
