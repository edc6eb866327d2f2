"""Whether a sheet of paper was handed over: by where two robots had their hands, and when these were shut."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from robocorba.clients.robot_film import in_building
from robocorba.kinematics.body import Body
from robocorba.kinematics.smartpal import GRIP, SHUT_RAD, Side
from robocorba.kinematics.tasks import GRIP_DEPTH_M, SHEET_M
from robocorba.motion.robot_state import RobotState
from robocorba.spatial.grids import Floats

#: The hands of giver and taker that have the sheet.
GIVING, TAKING = Side.RIGHT, Side.LEFT
#: From hand to hand along the sheet, m.
APART_M = SHEET_M - 2 * GRIP_DEPTH_M
#: What hands may be off, m and rad; and how far they are drawn back at least, m.
NEAR_M, STRAIGHT_RAD, MIN_DRAWN_BACK_M = 0.005, math.radians(2), 0.05
#: A gripper is shut within this, rad.
_SHUT_RAD = math.radians(3)


class Moment(NamedTuple):
    """How both robots were, so many seconds after they began; in the building's frame."""

    seconds: float
    giver: RobotState
    taker: RobotState


class Facts(NamedTuple):
    """Times in s: when the taker's gripper was shut, and when the giver's was not any more; infinite for never.

    The worst while both were shut, NaN where they never were: how far the way between the hands is from APART_M, m; how
    far one was over the other, m; how far one of them pointed past the other one, rad. In the end: the way between the
    hands, m; and whether the taker's was shut."""

    gripped_s: float
    let_go_s: float
    off_m: float
    uneven_m: float
    crooked_rad: float
    end_apart_m: float
    is_taken: bool


def facts(moments: Sequence[Moment]) -> Facts:
    """What is to be seen in them."""
    body = Body()
    gripped = _first(moments, 0, lambda moment: is_shut(moment.taker, TAKING))
    giving = _first(moments, 0, lambda moment: is_shut(moment.giver, GIVING))
    let_go = _first(moments, giving, lambda moment: not is_shut(moment.giver, GIVING))
    off_m = uneven_m = crooked_rad = -math.inf if gripped < let_go else math.nan
    for moment in moments[gripped:let_go]:
        (giver, ahead), (taker, back) = _hands(body, moment)
        way = taker - giver
        off_m = max(off_m, abs(math.hypot(*way) - APART_M))
        uneven_m = max(uneven_m, abs(way[2]))
        crooked_rad = max(crooked_rad, _between(ahead, way), _between(back, -way))
    (giver, _), (taker, _) = _hands(body, moments[-1])
    times = [*(moment.seconds for moment in moments), math.inf]
    end_apart_m, is_taken = math.dist(giver, taker), is_shut(moments[-1].taker, TAKING)
    return Facts(times[gripped], times[let_go], off_m, uneven_m, crooked_rad, end_apart_m, is_taken)


def faults(seen: Facts) -> list[str]:
    """Why the sheet was not handed over as it should be; nothing where it was."""
    found = {
        "the taker's gripper was not shut before the giver's opened": not seen.gripped_s < seen.let_go_s < math.inf,
        f"the hands were {1000 * seen.off_m:.1f} mm from where the sheet's ends are": not seen.off_m <= NEAR_M,
        f"one hand was {1000 * seen.uneven_m:.1f} mm over the other": not seen.uneven_m <= NEAR_M,
        f"the hands were {math.degrees(seen.crooked_rad):.1f} deg askew": not seen.crooked_rad <= STRAIGHT_RAD,
        "the hands were not drawn back": not seen.end_apart_m >= APART_M + MIN_DRAWN_BACK_M,
        "the taker does not hold the sheet in the end": not seen.is_taken,
    }
    return [fault for fault, is_met in found.items() if is_met]


def is_shut(state: RobotState, side: Side) -> bool:
    """Whether a gripper is."""
    return bool(state.joints[GRIP[side]] > SHUT_RAD - _SHUT_RAD)


def _first(moments: Sequence[Moment], start: int, is_met: Callable[[Moment], bool]) -> int:
    return next((number for number in range(start, len(moments)) if is_met(moments[number])), len(moments))


def _hands(body: Body, moment: Moment) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Of the giver's and the taker's hand: where its control point is (3,), m, and where it points (3,)."""
    return _hand(body, moment.giver, GIVING), _hand(body, moment.taker, TAKING)


def _hand(body: Body, state: RobotState, side: Side) -> tuple[Floats, Floats]:
    hand = body.hand(side, state.joints)
    at, tip = in_building(np.array([hand.position, hand.position + hand.rotation[:, 0]]), state)
    return at, tip - at


def _between(one: Floats, other: Floats) -> float:
    """The angle between two directions, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(one, other))), float(one @ other))
