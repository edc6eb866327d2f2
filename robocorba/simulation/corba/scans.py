"""Conversion of scans and scan requests from and to the IDL."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from omniORB import CORBA

from robocorba.errors.sensing import InvalidScan, SensorBehind
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import Pose
from robocorba.orb.exceptions import register
from robocorba.simulation.robot_scans import LastScan, RobotScan
from robocorba.simulation.sensing.fan import MAX_RAYS, Fan
from robocorba.simulation.sensing.scan import Mount, Noise, ScanResult, ScanSpec
from robocorba.stubs import RoboCorba


def spec_of(struct: Any) -> ScanSpec:
    """Raises InvalidScan. Cached, since requests repeat and a fan keeps its rays."""
    noise = struct.noise
    fan = _fan(struct.firstAngle, struct.step, struct.rays, struct.range)
    return _spec(fan, struct.rim, _noise(noise.sigma, noise.relative, noise.lost), noise.seed)


_fan, _noise, _spec = map(lru_cache(maxsize=256), (Fan, Noise, ScanSpec))


def spec(wanted: ScanSpec) -> Any:
    fan, noise = wanted.fan, wanted.noise
    return RoboCorba.ScanSpec(
        fan.first_rad,
        fan.step_rad,
        fan.count,
        fan.range_m,
        wanted.rim_m,
        RoboCorba.ScanNoise(noise.sigma_m, noise.relative, noise.lost, wanted.seed),
    )


def mount_of(struct: Any) -> Mount:
    return Mount(struct.ahead, struct.left, struct.heading)


def pose_rows_of(structs: Sequence[Any]) -> Floats:
    """Rows (n, 3) of x, y [m], heading [rad] of Pose structs."""
    return np.array([(pose.x, pose.y, pose.heading) for pose in structs], float).reshape(-1, 3)


def scan(result: ScanResult, spec: ScanSpec) -> Any:
    """The ScanData struct of a result that has one row of distances."""
    return RoboCorba.ScanData(result.time, spec.fan.first_rad, spec.fan.step_rad, result.distances[0].tolist())


def last_scan(value: LastScan) -> Any:
    seen = RoboCorba.ScanData(value.time, value.first_rad, value.step_rad, value.distances.tolist())
    return RoboCorba.SensorData(value.robot, value.at, seen)


def last_scan_of(struct: Any) -> LastScan:
    at, seen = struct.at, struct.seen
    pose = Pose(at.floor, at.x, at.y, at.heading)
    return LastScan(struct.robot, seen.time, pose, seen.firstAngle, seen.step, np.array(seen.distances, float))


def robot_scan(value: RobotScan) -> Any:
    distances = value.distances.tolist()
    frame = value.first_rad, value.step_rad
    noise = RoboCorba.ScanNoise(*value.noise)
    spec = RoboCorba.ScanSpec(*frame, len(distances), value.range_m, value.rim_m, noise)
    seen, hits = RoboCorba.ScanData(value.time, *frame, distances), value.hits.astype(np.uint8).tobytes()
    return RoboCorba.RobotScan(value.robot, value.at, RoboCorba.Mount(*value.mount), spec, seen, hits)


def robot_scan_of(struct: Any) -> RobotScan:
    """Raises CORBA.BAD_PARAM for a scan that is inconsistent or not finite."""
    at, where, spec, seen = struct.at, struct.where, struct.spec, struct.seen
    distances, hits = np.array(seen.distances, float), np.frombuffer(struct.hits, np.uint8) != 0
    mount = (where.ahead, where.left, where.heading)
    frame = (spec.firstAngle, spec.step, spec.range, spec.rim)
    noise = (spec.noise.sigma, spec.noise.relative, spec.noise.lost, spec.noise.seed)
    numbers = [seen.time, at.x, at.y, at.heading, *mount, *frame, *noise[:3], *distances]
    is_consistent = len(distances) == len(hits) == spec.rays <= MAX_RAYS
    if not is_consistent or not np.isfinite(numbers).all():
        raise CORBA.BAD_PARAM(0, CORBA.COMPLETED_NO)
    pose = Pose(at.floor, at.x, at.y, at.heading)
    return RobotScan(struct.robot, seen.time, pose, mount, *frame, noise, distances, hits)


register(InvalidScan, RoboCorba.InvalidScan, "field", "reason")
register(SensorBehind, RoboCorba.SensorBehind, "lag_s", "limit_s")
