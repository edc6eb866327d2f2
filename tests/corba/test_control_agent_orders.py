"""Orders to several robots at the same time."""

from __future__ import annotations

from typing import Any

from robocorba.corba.remote.control_agent import order_all
from robocorba.errors.services import NotReachable


class Orb:
    """Finds no robot, and fails for B by a defect."""

    def resolve(self, name: str, *arguments: Any) -> Any:
        raise ValueError("a fault") if name.endswith("B") else NotReachable("not there")


def test_a_robot_whose_order_failed_by_a_defect_has_not_confirmed_it() -> None:
    answers = dict(order_all(Orb(), ["A", "B"], lambda agent: None))  # type: ignore[arg-type]
    assert answers["A"] == "not there"
    assert "ValueError: a fault" in answers["B"]
