"""Forward kinematics of SmartPal: poses of its links and hands at given joints, and which links collide."""

from __future__ import annotations

import math

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.robot.kinematics.model import specification
from robocorba.robot.kinematics.mujoco_headless import mujoco
from robocorba.robot.kinematics.pose import HandPose
from robocorba.robot.kinematics.smartpal import JOINTS, Side

#: Depth up to which overlapping links do not count as colliding [m].
_TOUCH_M = 1e-4


class SmartPalBody:
    """SmartPal's links, without dynamics. Joints are (18,) [rad], in the order of `smartpal.JOINTS`; positions
    are in the robot's frame.

    Not thread-safe: each query moves the model. The constructor takes a millisecond."""

    def __init__(self) -> None:
        self.model = specification().compile()
        self._data = mujoco.MjData(self.model)
        self._row = np.array([self.model.joint(name).qposadr[0] for name in JOINTS])
        self._hand = {side: self._data.site(f"{side.value}_hand") for side in Side}
        names = [self.model.body(id).name for id in range(1, self.model.nbody)]
        self._links = {name: self._data.body(name) for name in names}
        self._owner = [self.model.body(id).name for id in self.model.geom_bodyid]

    def hand(self, side: Side, joints: Floats) -> HandPose:
        """Pose of a hand's control point."""
        self._move(joints)
        site = self._hand[side]
        return HandPose.of(site.xpos, site.xmat.reshape(3, 3))

    def links(self, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """By the link's name: position (3,) of its first joint [m], and attitude (4,) as a quaternion w, x, y, z."""
        self._move(joints)
        return {name: (link.xpos.copy(), link.xquat.copy()) for name, link in self._links.items()}

    def links_at(self, pose: Pose2D, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """The same in the frame in which the base is at x, y [m], heading [rad]; z from its ground."""
        x, y, heading = pose
        cosine, sine = math.cos(heading), math.sin(heading)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        half = np.array([math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0)])
        turned = np.zeros(4)
        found = {}
        for name, (at, attitude) in self.links(joints).items():
            mujoco.mju_mulQuat(turned, half, attitude)
            found[name] = (turn @ at + (x, y, 0.0), turned.copy())
        return found

    def collisions(self, joints: Floats) -> list[tuple[str, str]]:
        """Sorted pairs of links that collide; neighbouring links may overlap."""
        self._move(joints)
        mujoco.mj_collision(self.model, self._data)
        if not self._data.ncon:
            return []
        contact = self._data.contact
        colliding = contact.geom[contact.dist < -_TOUCH_M].tolist()
        return sorted({(self._owner[one], self._owner[other]) for one, other in colliding})

    def _move(self, joints: Floats) -> None:
        self._data.qpos[self._row] = joints
        mujoco.mj_kinematics(self.model, self._data)
