"""Forward kinematics of SmartPal: poses of its links and hands at given joints, and which links collide."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.robot.kinematics.model import Link, links
from robocorba.robot.kinematics.pose import HandPose, rotation_of
from robocorba.robot.kinematics.smartpal import JOINTS, Side

#: Depth up to which overlapping links do not count as colliding [m].
_TOUCH_M = 1e-4


class SmartPalBody:
    """SmartPal's links, without dynamics. Joints are (18,) [rad], in the order of `smartpal.JOINTS`; positions
    are in the robot's frame. Thread-safe."""

    def __init__(self) -> None:
        self._crosses = np.zeros((len(JOINTS), 3, 3))
        for joint in (joint for link in links() for joint in link.joints):
            a, b, c = joint.axis
            self._crosses[joint.number] = (0, -c, b), (c, 0, -a), (-b, a, 0)
        solids = [(link, solid) for link in links() for solid in link.solids]
        self._owner = [link.name for link, _ in solids]
        self._at, self._half = (
            np.array([solid.at for _, solid in solids]),
            np.array([solid.half for _, solid in solids]),
        )
        self._radius = np.array([solid.radius_m for _, solid in solids])
        self._reach = np.linalg.norm(self._half, axis=1) + self._radius
        # Round ones first, so that one of two boxes is never paired with a capsule after it.
        order = sorted(range(len(solids)), key=lambda number: not self._radius[number])
        pairs = [
            pair for pair in combinations(order, 2) if not _are_neighbours(*(solids[number][0] for number in pair))
        ]
        self._pairs = np.array(pairs)

    def hand(self, side: Side, joints: Floats) -> HandPose:
        """Pose of a hand's control point."""
        name = f"{side.value}_hand"
        (mount,) = next(link.mounts for link in links() if link.name == name)
        position, rotation = self.frames(joints)[name]
        return HandPose.of(position + rotation @ mount.at, rotation @ rotation_of(mount.attitude))

    def frames(self, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """By the link's name: position (3,) of its first joint [m], and rotation matrix (3, 3)."""
        sines, versines = np.sin(joints)[:, None, None], (1.0 - np.cos(joints))[:, None, None]
        turns = np.eye(3) + sines * self._crosses + versines * (self._crosses @ self._crosses)  # Rodrigues' formula
        found = {"": (np.zeros(3), np.eye(3))}
        for link in links():
            position, rotation = found[link.parent]
            position = position + rotation @ link.at
            for joint in link.joints:
                turned = rotation @ turns[joint.number]
                position, rotation = position + (rotation - turned) @ joint.at, turned
            found[link.name] = position, rotation
        del found[""]
        return found

    def links(self, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """By the link's name: position (3,) of its first joint [m], and attitude (4,) as a quaternion w, x, y, z."""
        attitudes = {"": np.array([1.0, 0.0, 0.0, 0.0])}
        for link in links():
            w, x, y, z = attitudes[link.parent]
            for joint in link.joints:
                half = joints[joint.number] / 2
                c, (a, b, d) = math.cos(half), math.sin(half) * np.array(joint.axis)
                w, x, y, z = (
                    w * c - x * a - y * b - z * d,
                    w * a + x * c + y * d - z * b,
                    w * b - x * d + y * c + z * a,
                    w * d + x * b - y * a + z * c,
                )
            attitudes[link.name] = np.array([w, x, y, z])
        return {name: (position, attitudes[name]) for name, (position, _) in self.frames(joints).items()}

    def links_at(self, pose: Pose2D, joints: Floats) -> dict[str, tuple[Floats, Floats]]:
        """The same in the frame in which the base is at x, y [m], heading [rad]; z from its ground."""
        place, heading = np.array([*pose[:2], 0.0]), pose[2]
        cosine, sine = math.cos(heading), math.sin(heading)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        c, s = math.cos(heading / 2.0), math.sin(heading / 2.0)
        found = {}
        for name, (at, (w, x, y, z)) in self.links(joints).items():
            attitude = np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
            found[name] = (turn @ at + place, attitude)
        return found

    def collisions(self, joints: Floats) -> list[tuple[str, str]]:
        """Sorted pairs of links that collide; neighbouring links may overlap."""
        frames = self.frames(joints)
        positions, rotations = (
            np.array(values) for values in zip(*(frames[name] for name in self._owner), strict=True)
        )
        at = positions + (rotations @ self._at[:, :, None])[:, :, 0]
        one, other = self._pairs.T
        near = np.linalg.norm(at[one] - at[other], axis=1) < self._reach[one] + self._reach[other]
        one, other = one[near], other[near]
        is_round = self._radius[one] > 0.0
        depths = np.empty(len(one))
        for kind, depth in ((is_round, self._depths_of_capsules), (~is_round, self._depths_of_boxes)):
            depths[kind] = depth(one[kind], other[kind], at, rotations)
        deep = depths > _TOUCH_M
        pairs = zip(one[deep].tolist(), other[deep].tolist(), strict=True)
        return sorted({(self._owner[a], self._owner[b]) for a, b in pairs})

    def _depths_of_capsules(
        self, one: NDArray[np.intp], other: NDArray[np.intp], at: Floats, rotations: Floats
    ) -> Floats:
        """How deep capsules are in others or in boxes (n,) [m]: exact where their lines are outside."""
        along = 2.0 * self._half[one, 2:] * rotations[one, :, 2]
        start = at[one] - at[other] - along / 2
        start, along = (np.einsum("nji,nj->ni", rotations[other], vectors) for vectors in (start, along))
        half = self._half[other][:, None, :]
        # Half of the squared distance to the box has a derivative along the line that rises, linear between the places
        # where the line crosses the planes of the box's sides.
        steps = np.where(along == 0.0, 1.0, along)
        crossings = np.concatenate([(sign * self._half[other] - start) / steps for sign in (-1.0, 1.0)], axis=1)
        shares = np.sort(np.pad(np.clip(crossings, 0.0, 1.0), ((0, 0), (1, 1)), constant_values=(0.0, 1.0)), axis=1)
        points = start[:, None] + shares[:, :, None] * along[:, None]
        slopes = ((points - np.clip(points, -half, half)) * along[:, None]).sum(axis=2)
        rows = np.arange(len(one))
        last = np.clip((slopes <= 0.0).sum(axis=1) - 1, 0, shares.shape[1] - 2)
        low, high = slopes[rows, last], slopes[rows, last + 1]
        share = np.clip(-low / np.where(high > low, high - low, 1.0), 0.0, 1.0)
        nearest = start + (shares[rows, last] + share * (shares[rows, last + 1] - shares[rows, last]))[:, None] * along
        gaps = np.linalg.norm(nearest - np.clip(nearest, -half[:, 0], half[:, 0]), axis=1)
        return np.asarray(self._radius[one] + self._radius[other] - gaps)

    def _depths_of_boxes(self, one: NDArray[np.intp], other: NDArray[np.intp], at: Floats, rotations: Floats) -> Floats:
        """How deep boxes are in others (n,) [m], negative for apart: the least over the normals of their sides and of
        two of their edges (separating axes)."""
        sides = np.swapaxes(rotations[one], 1, 2), np.swapaxes(rotations[other], 1, 2)
        edges = np.cross(sides[0][:, :, None], sides[1][:, None]).reshape(-1, 9, 3)
        axes = np.concatenate([*sides, edges], axis=1)
        lengths = np.linalg.norm(axes, axis=2)
        axes = axes / np.maximum(lengths, 1e-9)[:, :, None]
        extents = [(np.abs(axes @ rotations[box]) * self._half[box][:, None]).sum(axis=2) for box in (one, other)]
        apart = np.abs((axes @ (at[other] - at[one])[:, :, None])[:, :, 0])
        overlaps = np.where(lengths > 1e-6, extents[0] + extents[1] - apart, np.inf)  # parallel edges have no normal
        return np.asarray(overlaps.min(axis=1, initial=np.inf))


def _are_neighbours(one: Link, other: Link) -> bool:
    """Whether links are one body, or a body and what a joint moves on it. A link without joints is part of its
    parent."""
    by_name = {link.name: link for link in links()}

    def body(link: Link) -> str:
        return link.name if link.joints or not link.parent else body(by_name[link.parent])

    def carrier(link: Link) -> str:
        parent = by_name[body(link)].parent
        return body(by_name[parent]) if parent else ""

    return body(one) in (body(other), carrier(other)) or body(other) == carrier(one)
