"""SmartPal's dynamics in MuJoCo, with servos that lag and encoders that have noise.

Servo and wheel lag, servo bandwidth and encoder noise are assumed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.robot.kinematics.mujoco_headless import mujoco, specification
from robocorba.robot.kinematics.smartpal import ARM, JOINTS, MASS_KG, Side

#: Time step of the simulation [s].
STEP_S = 0.002
#: Axes of the base in the start frame (the pose of the base at the start): x, y [m], heading [rad].
BASE_AXES = ("base_x", "base_y", "base_turn")
#: Time constant with which joints follow their setpoints [s].
SERVO_LAG_S = 0.02
#: Standard deviation of the joints' encoders [rad].
JOINT_NOISE_RAD = math.radians(0.003)
#: Standard deviation of all encoders: position [m] and heading [rad] of the base, joints [rad].
_NOISE = np.array([0.0002, 0.0002, math.radians(0.01), *[JOINT_NOISE_RAD] * len(JOINTS)])


@dataclass(frozen=True)
class DynamicsState:
    """The state of the robot after a step.

    time: since the start [s]. base (3,), joints (18,): with encoder noise; the base as x, y [m] and heading [rad] in
    the start frame, joints [rad]. base_velocity, joint_velocities, true_base, true_joints: without noise."""

    time: float
    base: Floats
    base_velocity: Floats
    joints: Floats
    joint_velocities: Floats
    true_base: Floats
    true_joints: Floats


class Dynamics:
    """One thread writes the setpoints and calls `step`; any thread may read `state`.

    Setpoints: base_velocity (3,) in the start frame [m/s, rad/s]; joints, joint_velocities (18,) [rad, rad/s]."""

    def __init__(self, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._model = _compile()
        self._data = mujoco.MjData(self._model)
        axes = [self._model.joint(name) for name in (*BASE_AXES, *JOINTS)]
        self._positions = np.array([int(axis.qposadr[0]) for axis in axes])
        self._velocities = np.array([int(axis.dofadr[0]) for axis in axes])
        self._servos = np.array([self._model.actuator(name).id for name in JOINTS])
        self._wheels = np.array([self._model.actuator(name).id for name in BASE_AXES])
        # Force of a servo: stiffness x (setpoint - position) + damping x (velocity setpoint - velocity).
        self._lead_s = -self._model.actuator_biasprm[self._servos, 2] / self._model.actuator_gainprm[self._servos, 0]
        self._normal_damping = self._model.dof_damping[self._velocities]
        self.base_velocity = np.zeros(len(BASE_AXES))
        #: The velocity of the base that what it touches allows.
        self.allowed: Callable[[DynamicsState, Floats], Floats] = lambda state, velocity: velocity
        self.joints, self.joint_velocities = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
        self._filtered = np.zeros(len(JOINTS))
        mujoco.mj_forward(self._model, self._data)
        self.state = self._measure()

    @property
    def mass_kg(self) -> float:
        return float(self._model.body_mass.sum())

    def jam(self, axes: slice, on: bool) -> None:
        """Block axes (a slice of 21, those of the base first) by their damping [N s/m, N m s/rad], or release them."""
        self._model.dof_damping[self._velocities[axes]] = 1e6 if on else self._normal_damping[axes]

    def step(self) -> None:
        """Advance by STEP_S and update `state`."""
        setpoints = self.joints + self._lead_s * self.joint_velocities
        self._filtered += STEP_S / (SERVO_LAG_S + STEP_S) * (setpoints - self._filtered)
        self._data.ctrl[self._servos] = self._filtered
        self._data.ctrl[self._wheels] = self.allowed(self.state, self.base_velocity)
        mujoco.mj_step(self._model, self._data)
        self.state = self._measure()

    def _measure(self) -> DynamicsState:
        data = self._data
        positions, velocities = data.qpos[self._positions], data.qvel[self._velocities]
        measured = positions + _NOISE * self._random.standard_normal(len(_NOISE))
        base, joints = slice(0, len(BASE_AXES)), slice(len(BASE_AXES), None)
        return DynamicsState(
            float(data.time),
            measured[base],
            velocities[base],
            measured[joints],
            velocities[joints],
            positions[base],
            positions[joints],
        )


def _compile() -> mujoco.MjModel:
    """SmartPal with an omnidirectional base and one servo per joint."""
    spec = specification()
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    base = spec.body("base")
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for name, kind, axis in zip(BASE_AXES, (slide, slide, hinge), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), strict=True):
        # The defaults for links set damping and armature; the base has neither.
        base.add_joint(name=name, type=kind, axis=axis, armature=0.0, damping=[0.0, 0, 0])
    for body in spec.bodies:
        if body.name not in ("world", "base"):
            body.gravcomp = 1.0  # servos compensate the weight of the robot; a payload pulls them down
    inertias = _inertias(spec)
    base_inertia_kg_m2 = inertias.pop("base_turn")
    for name, load in zip(BASE_AXES, (MASS_KG, MASS_KG, base_inertia_kg_m2), strict=True):  # which lags by 2 ms
        spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_velocity(load / 0.002)
    bandwidth_rad_s = 60.0  # natural frequency of a joint's critically damped servo with its load
    for name in JOINTS:
        load = inertias[name]
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(load * bandwidth_rad_s**2, kv=2 * load * bandwidth_rad_s)
    return spec.compile()


def _inertias(spec: mujoco.MjSpec) -> dict[str, float]:
    """The inertia that each joint moves [kg m^2]: the maximum over arms that hang and arms bent at the elbow."""
    model = spec.compile()
    data, column = mujoco.MjData(model), np.zeros(model.nv)
    inertias = np.zeros(model.nv)
    for bend in (0.0, math.radians(90)):
        for side in Side:
            data.qpos[model.joint(JOINTS[ARM[side]][3]).qposadr[0]] = bend
        mujoco.mj_forward(model, data)
        for axis, unit_vector in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, column, unit_vector)
            inertias[axis] = max(inertias[axis], column[axis])
    return {name: float(inertias[model.joint(name).dofadr[0]]) for name in (*JOINTS, "base_turn")}
