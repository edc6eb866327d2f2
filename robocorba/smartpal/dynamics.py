"""How the robot moves: MuJoCo's dynamics of SmartPal, pushed by servos that lag, felt by encoders that err.

Ours, because nobody tells them: how fast servos answer, what the wheels hold, how much encoders err.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from robocorba.kinematics.model import specification
from robocorba.kinematics.smartpal import ARM, JOINTS, MASS_KG, Side
from robocorba.spatial.grids import Floats

STEP_S = 0.002
#: Axes of the base, in the frame of where it was at the start: x, y in m, heading in rad.
BASE = ("base_x", "base_y", "base_turn")
#: Joints follow what they are told so much later, and the base's wheels, s.
SERVO_LAG_S, WHEEL_LAG_S = 0.02, 0.002
#: How stiff a joint's servo is: what it carries swings back at this rate, without overshoot, rad/s.
STIFFNESS = 60.0
#: Deviation of what encoders say: of joints, rad; of the base's place, m, and heading, rad.
JOINT_NOISE_RAD, PLACE_NOISE_M, HEADING_NOISE_RAD = math.radians(0.003), 0.0002, math.radians(0.01)
#: What holds an axis that is jammed, N s/m or N m s/rad.
JAM = 1e6
_NOISE = np.array([PLACE_NOISE_M, PLACE_NOISE_M, HEADING_NOISE_RAD, *[JOINT_NOISE_RAD] * len(JOINTS)])
_BENT = math.radians(90)
_ADDRESSES = ("qposadr", "dofadr")


@dataclass(frozen=True)
class Snapshot:
    """Where the robot is, as its encoders say, and as it is.

    time: s since the start. base (3,): x, y in m and heading in rad, in the frame of where it was at the start.
    base_velocity (3,): of the same. joints (18,), joint_velocities (18,): rad, rad/s. true_base, true_joints: without
    errors."""

    time: float
    base: Floats
    base_velocity: Floats
    joints: Floats
    joint_velocities: Floats
    true_base: Floats
    true_joints: Floats


class Dynamics:
    """Only one thread steps it and sets what it shall do; `seen` is for all.

    base_velocity (3,): wanted of the base, m/s and rad/s in the frame of the start. joints, joint_velocities (18,):
    where joints shall be, and move on at."""

    def __init__(self, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._model = _compile()
        self._data = mujoco.MjData(self._model)
        axes = [self._model.joint(name) for name in (*BASE, *JOINTS)]
        self._places, self._speeds = (np.array([int(getattr(axis, of)[0]) for axis in axes]) for of in _ADDRESSES)
        self._servos = np.array([self._model.actuator(name).id for name in JOINTS])
        self._wheels = np.array([self._model.actuator(name).id for name in BASE])
        # A servo pushes with stiffness x (wanted - place) + damping x (wanted velocity - velocity).
        self._lead_s = -self._model.actuator_biasprm[self._servos, 2] / self._model.actuator_gainprm[self._servos, 0]
        self._free = self._model.dof_damping[self._speeds]
        self.base_velocity = np.zeros(len(BASE))
        self.joints, self.joint_velocities = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
        self._followed = np.zeros(len(JOINTS))
        mujoco.mj_forward(self._model, self._data)
        self.seen = self._look()

    @property
    def mass_kg(self) -> float:
        return float(self._model.body_mass.sum())

    def jam(self, axes: slice, on: bool) -> None:
        """Axes (21,), those of the base first, that do not move, whatever they are told."""
        self._model.dof_damping[self._speeds[axes]] = JAM if on else self._free[axes]

    def step(self) -> None:
        """Let STEP_S pass, and look."""
        wanted = self.joints + self._lead_s * self.joint_velocities
        self._followed += STEP_S / (SERVO_LAG_S + STEP_S) * (wanted - self._followed)
        self._data.ctrl[self._servos] = self._followed
        self._data.ctrl[self._wheels] = self.base_velocity
        mujoco.mj_step(self._model, self._data)
        self.seen = self._look()

    def _look(self) -> Snapshot:
        data = self._data
        places, velocities = data.qpos[self._places], data.qvel[self._speeds]
        felt = places + _NOISE * self._random.standard_normal(len(_NOISE))
        base, joints = slice(0, len(BASE)), slice(len(BASE), None)
        return Snapshot(
            float(data.time),
            felt[base],
            velocities[base],
            felt[joints],
            velocities[joints],
            places[base],
            places[joints],
        )


def _compile() -> mujoco.MjModel:
    """SmartPal on wheels that go anywhere, with a servo a joint."""
    spec = specification()
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    base = spec.body("base")
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for name, kind, axis in zip(BASE, (slide, slide, hinge), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), strict=True):
        # Joints of a link have damping and armature by default, the base has neither.
        base.add_joint(name=name, type=kind, axis=axis, armature=0.0, damping=[0.0, 0, 0])
    for body in spec.bodies:
        if body.name not in ("world", "base"):
            body.gravcomp = 1.0  # servos carry the weight of what they move; that of a payload pulls them down
    inertias = _inertias(spec)
    turned_kg_m2 = inertias.pop("base_turn")
    for name, carried in zip(BASE, (MASS_KG, MASS_KG, turned_kg_m2), strict=True):
        spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_velocity(
            carried / WHEEL_LAG_S
        )
    for name in JOINTS:
        carried = inertias[name]
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(carried * STIFFNESS**2, kv=2 * carried * STIFFNESS)
    return spec.compile()


def _inertias(spec: mujoco.MjSpec) -> dict[str, float]:
    """What each joint carries, kg m^2: the most of two postures, hanging arms and arms bent at the elbow."""
    model = spec.compile()
    data, pushed = mujoco.MjData(model), np.zeros(model.nv)
    most = np.zeros(model.nv)
    for bend in (0.0, _BENT):
        for side in Side:
            data.qpos[model.joint(JOINTS[ARM[side]][3]).qposadr[0]] = bend
        mujoco.mj_forward(model, data)
        for axis, only in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, pushed, only)
            most[axis] = max(most[axis], pushed[axis])
    return {name: float(most[model.joint(name).dofadr[0]]) for name in (*JOINTS, "base_turn")}
