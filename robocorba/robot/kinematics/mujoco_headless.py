"""SmartPal as a MuJoCo model, for dynamics; without OpenGL, by which no process of ours draws.

MuJoCo looks for OpenGL when it is imported, with an interpreter of its own: 0.15 s of a core in each process. If
MUJOCO_GL is in the environment, it does as that says."""

from __future__ import annotations

import os

from robocorba.robot.kinematics.model import links

_is_set = "MUJOCO_GL" in os.environ
os.environ.setdefault("MUJOCO_GL", "disable")
import mujoco  # noqa: E402

if not _is_set:
    del os.environ["MUJOCO_GL"]  # it holds for this process only

__all__ = ["mujoco", "specification"]

#: armature, damping: inertia [kg m^2] and friction [N m s/rad] that motors and gears add to a joint. Assumed.
_EMPTY_MODEL = """
<mujoco model="smartpal">
  <compiler angle="radian"/>
  <default><joint armature="0.05" damping="0.5"/></default>
</mujoco>
"""


def specification() -> mujoco.MjSpec:
    """SmartPal without actuators and without a floor, to compile or to extend. Bodies are the links of `model.links`,
    sites its mounts, joints have the names of `smartpal.JOINTS`, in another order."""
    spec = mujoco.MjSpec.from_string(_EMPTY_MODEL)
    bodies = {"": spec.worldbody}
    for link in links():
        body = bodies[link.name] = bodies[link.parent].add_body(name=link.name, pos=link.at)
        for joint in link.joints:
            limits = joint.lower, joint.upper
            body.add_joint(name=joint.name, axis=joint.axis, pos=joint.at, range=limits, limited=True)
        for solid in link.solids:
            kind, size = mujoco.mjtGeom.mjGEOM_BOX, solid.half
            if solid.radius_m:
                is_long = solid.half[2] > 0.0
                kind = mujoco.mjtGeom.mjGEOM_CAPSULE if is_long else mujoco.mjtGeom.mjGEOM_SPHERE
                size = (solid.radius_m, solid.half[2], 0.0)
            body.add_geom(type=kind, pos=solid.at, size=size, mass=solid.mass_kg, rgba=solid.colour)
        for mount in link.mounts:
            body.add_site(name=mount.name, pos=mount.at, quat=mount.attitude, size=[0.01] * 3)
    # Neighbouring links touch. MuJoCo ignores contacts of parent and child, but not if the parent can't move.
    for one, other in (("base", "waist"), ("waist", "head")):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return spec
