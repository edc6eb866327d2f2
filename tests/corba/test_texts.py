"""Texts that nobody can read are refused before a servant sees them."""

from __future__ import annotations

from typing import Any

import pytest
from omniORB import CORBA

from robocorba.corba.texts import check_of, refuse_unreadable_texts
from robocorba.stubs import RoboCorba, RoboCorba__POA

NUL, LOST = "a\0b", "a\N{REPLACEMENT CHARACTER}b"
REASONS = [(NUL, CORBA.BAD_PARAM), (LOST, CORBA.DATA_CONVERSION)]


class Supervisor(RoboCorba__POA.Supervisor):
    """Notes what it is asked."""

    def __init__(self) -> None:
        self.asked: list[Any] = []

    def endRobot(self, name: str) -> None:
        self.asked.append(name)

    def startRobot(self, order: Any) -> None:
        self.asked.append(order.name)

    def processes(self) -> list[Any]:
        return []


def checked(**members: Any) -> Any:
    """A servant of a class that checks its texts. members: of the class."""
    servant = type("Checked", (Supervisor,), members)
    refuse_unreadable_texts(servant)
    return servant()


def order(name: str = "A", arguments: tuple[str, ...] = ()) -> Any:
    return RoboCorba.RobotOrder(name, "simulated", list(arguments), "L1", False, 0.0, 0.0, 0.0, "")


@pytest.mark.parametrize(("text", "refusal"), REASONS)
def test_unreadable_texts_do_not_reach_a_servant(text: str, refusal: type[Exception]) -> None:
    servant = checked()
    for call in (
        lambda: servant.endRobot(text),
        lambda: servant.startRobot(order(text)),
        lambda: servant.startRobot(order("A", ("--x", text))),
    ):
        with pytest.raises(refusal):
            call()
    assert not servant.asked
    servant.endRobot("ナビ")
    servant.startRobot(order("two\nlines"))
    assert servant.asked == ["ナビ", "two\nlines"]


def test_operations_without_texts_stay_as_they_are() -> None:
    servant = type(checked())
    assert servant.processes is Supervisor.processes
    assert servant.endRobot is not Supervisor.endRobot


def test_a_servant_may_check_an_operation_itself() -> None:
    servant = checked(checks_texts_itself=frozenset({"endRobot"}))
    servant.endRobot(NUL)
    assert servant.asked == [NUL]
    with pytest.raises(CORBA.BAD_PARAM):
        servant.startRobot(order(NUL))


@pytest.mark.parametrize(("text", "refusal"), REASONS)
def test_texts_are_found_in_unions_and_sequences(text: str, refusal: type[Exception]) -> None:
    check = check_of(RoboCorba._d_Element)
    assert check
    node = RoboCorba.PathNode("n", RoboCorba.XY(0.0, 0.0), text)
    with pytest.raises(refusal):
        check(RoboCorba.Element(RoboCorba.NODE_ELEMENT, node))
    check(RoboCorba.Element(RoboCorba.NODE_ELEMENT, RoboCorba.PathNode("n", RoboCorba.XY(0.0, 0.0), "")))
    edge = RoboCorba.PathEdge("e", "a", "b", False, 0.0, 0.0, ["g", text])
    with pytest.raises(refusal):
        check(RoboCorba.Element(RoboCorba.EDGE_ELEMENT, edge))


def test_types_without_texts_need_no_check() -> None:
    assert check_of(RoboCorba._d_Velocity) is None
    assert check_of(RoboCorba._d_DoubleSeq) is None
