"""Cooperative plans: versions, bounds, what is refused."""

from __future__ import annotations

import contextlib
from concurrent.futures import ThreadPoolExecutor

import msgpack
import pytest

from robocorba.errors.robots import InvalidPlan, StalePlan, UnknownPlan
from robocorba.robot.data_pool import plans as limits
from robocorba.robot.data_pool.plans import MAX_CONTENT, MAX_PLANS, Plan, Plans

CONTENT = msgpack.packb({"table": "T1", "steps": [1, 2, 3]})


def blob(size: int) -> bytes:
    """Octets in msgpack, `size` bytes in all."""
    return bytes([0xC6, *(size - 5).to_bytes(4, "big")]) + bytes(size - 5)


def test_a_plan_is_kept_in_versions_and_a_stale_one_is_not_overwritten() -> None:
    plans = Plans()
    assert plans.all() == []
    assert plans.put("move table", CONTENT) == 1
    assert plans.put("move table", msgpack.packb([]), expected_version=1) == 2
    assert plans.put("fetch", CONTENT) == 1
    assert plans.get("move table") == Plan("move table", 2, msgpack.packb([]))
    assert [(plan.name, plan.version) for plan in plans.all()] == [("fetch", 1), ("move table", 2)]
    plans.remove("fetch")
    assert [plan.name for plan in plans.all()] == ["move table"]
    for call in (plans.get, plans.remove):
        with pytest.raises(UnknownPlan, match="'fetch'"):
            call("fetch")
    plans = Plans()
    plans.put("p", CONTENT)
    for expected in (0, 2, -1):
        with pytest.raises(StalePlan) as stale:
            plans.put("p", b"\x00", expected)
        assert (stale.value.name, stale.value.expected, stale.value.current) == ("p", expected, 1)
    with pytest.raises(StalePlan):
        plans.put("new", CONTENT, 1)
    assert plans.get("p").content == CONTENT
    assert len(plans.all()) == 1


@pytest.mark.parametrize(
    ("name", "content", "field"),
    [
        *((name, CONTENT, "name") for name in ("", "n" * 201, "a\0b", "\ud800", " A", "A ", "a\nb", "e\u0301")),
        ("p", blob(MAX_CONTENT + 1), "content"),
        ("p", b"", "content"),
        ("p", b"\xc1", "content"),
        ("p", CONTENT[:-1], "content"),
        ("p", CONTENT + b"\x00", "content"),
        ("p", b"\x91" * 100_000, "content"),
        ("p", b"\xdd\xff\xff\xff\xff", "content"),
    ],
)
def test_invalid_plans_name_the_field(name: str, content: bytes, field: str) -> None:
    plans = Plans()
    with pytest.raises(InvalidPlan) as invalid:
        plans.put(name, content)
    assert invalid.value.field == field
    assert plans.all() == []


def test_number_and_size_of_plans_are_limited() -> None:
    for count, content, refused, reason in (
        (MAX_PLANS, CONTENT, CONTENT, f"{MAX_PLANS} plans"),
        (limits.MAX_CONTENTS // MAX_CONTENT, blob(MAX_CONTENT), b"\x00", "together"),
    ):
        plans = Plans()
        for number in range(count):
            plans.put(f"p{number}", content)
        with pytest.raises(InvalidPlan, match=reason):
            plans.put("one more", refused)
        assert plans.put("p0", blob(MAX_CONTENT), 1) == 2
        plans.remove("p1")
        assert plans.put("one more", CONTENT) == 1


def test_one_of_several_concurrent_writers_wins() -> None:
    plans, won = Plans(), list[int]()

    def write(number: int) -> None:
        for version in range(50):
            with contextlib.suppress(StalePlan):
                plans.put("p", msgpack.packb(number), version)
                won.append(version)

    with ThreadPoolExecutor() as threads:
        list(threads.map(write, range(4)))
    assert sorted(won) == list(range(plans.get("p").version))
