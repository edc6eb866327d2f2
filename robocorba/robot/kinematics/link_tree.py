"""SmartPal's links and joints as plain data, taken from its model: for viewers that move the links themselves."""

from __future__ import annotations

from typing import Any, NamedTuple

from robocorba.robot.kinematics.appearance import PAINTS, parts
from robocorba.robot.kinematics.model import specification
from robocorba.robot.kinematics.smartpal import JOINTS


class LinkJoint(NamedTuple):
    """A revolute joint. number: its index in `smartpal.JOINTS`. axis: unit vector. at: a point of the axis [m].
    lower, upper: limits [rad]. All in the link's frame."""

    number: int
    name: str
    axis: tuple[float, float, float]
    at: tuple[float, float, float]
    lower: float
    upper: float


class Link(NamedTuple):
    """A link. parent: empty for the base. at: origin of its frame in its parent's at zero angles [m]; frames are
    parallel then. joints: between parent and link, that of the parent's side first."""

    name: str
    parent: str
    at: tuple[float, float, float]
    joints: tuple[LinkJoint, ...]


def links() -> list[Link]:
    """All links, each after its parent."""
    found: list[Link] = []

    def add(body: Any, parent: str) -> None:
        joints = tuple(
            LinkJoint(
                JOINTS.index(joint.name), joint.name, _vector(joint.axis), _vector(joint.pos), *map(float, joint.range)
            )
            for joint in body.joints
        )
        found.append(Link(body.name, parent, _vector(body.pos), joints))
        for child in body.bodies:
            add(child, body.name)

    for body in specification().worldbody.bodies:
        add(body, "")
    return found


def mounts() -> list[dict[str, Any]]:
    """Places on links with axes of their own: left_hand, right_hand, the hands' control points, laser, proximity_1 to
    _8. Each with its name and link, `at` [m], and attitude as a quaternion w, x, y, z in the link's frame; x out of
    hand or sensor."""
    model = specification().compile()
    sites = [model.site(number) for number in range(model.nsite)]
    return [
        {
            "name": site.name,
            "link": model.body(int(site.bodyid[0])).name,
            "at": _vector(site.pos),
            "attitude": tuple(map(float, site.quat)),
        }
        for site in sites
    ]


def as_json() -> dict[str, Any]:
    """Links, mounts, joints, parts and paints for a viewer; lengths in m, angles in rad."""
    return {
        "links": [
            {
                "name": link.name,
                "parent": link.parent,
                "at": link.at,
                "joints": [{"number": joint.number, "axis": joint.axis, "at": joint.at} for joint in link.joints],
            }
            for link in links()
        ],
        "mounts": mounts(),
        "joints": JOINTS,
        "parts": [part._asdict() | {"shape": part.shape.value} for part in parts()],
        "paints": PAINTS,
    }


def _vector(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
