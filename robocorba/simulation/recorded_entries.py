"""What recordings have besides floors: postures and scans in msgpack, missions in JSON."""

from __future__ import annotations

import msgspec
import numpy as np

from robocorba.map_editor.spatial.pose import Pose
from robocorba.map_editor.spatial.posture import Posture
from robocorba.simulation.mission_record import MissionContent, MissionState
from robocorba.simulation.robot_scans import RobotScan
from robocorba.system.decoding import decode_json, decode_msgpack

POSTURE_SCHEMA = b"""// RoboCorba::Posture of omni_database.idl in msgpack: a struct is a map from the names of
// its members.

struct Posture {
  string robot;
  double time;
  sequence<double> joints;
};
"""

SCAN_SCHEMA = b"""// The content of RoboCorba::RobotScan of simulation_server.idl in msgpack: a struct is a map from
// the names of its members. Lengths are m, angles rad.

struct RobotScan {
  string robot;
  double time;
  string floorName;
  sequence<double> at;         // x, y, heading of the robot
  sequence<double> mount;      // of the sensor in the robot's frame: ahead, left, heading
  double firstAngle;
  double step;
  double range;
  double rim;                  // distance from the sensor at which rays begin
  sequence<octet> distances;   // float, little-endian, a ray each
  sequence<octet> hits;        // a bit for each ray, the highest of an octet first
  boolean isVirtual;           // not a sensor of an actual robot
  sequence<octet> unmapped;    // as hits, of the rays that hit what no map has; empty: unknown
};
"""


class _Mission(msgspec.Struct):
    name: str
    content: MissionContent


class _Scan(msgspec.Struct, rename="camel"):
    robot: str
    time: float
    floor_name: str
    at: tuple[float, float, float]
    mount: tuple[float, float, float]
    first_angle: float
    step: float
    range: float
    rim: float
    distances: bytes
    hits: bytes
    is_virtual: bool = True
    unmapped: bytes = b""


class _Posture(msgspec.Struct):
    robot: str
    time: float
    joints: tuple[float, ...]


def dump_posture(posture: Posture) -> bytes:
    return msgspec.msgpack.encode(_Posture(*posture))


def load_posture(data: bytes) -> Posture:
    """The inverse of `dump_posture`. Raises msgspec.MsgspecError."""
    found = decode_msgpack(data, _Posture)
    return Posture(found.robot, found.time, found.joints)


def dump_scan(scan: RobotScan) -> bytes:
    """Distances are rounded to single precision; the parameters of the noise are left out."""
    frame = scan.first_rad, scan.step_rad, scan.range_m, scan.rim_m
    rows = scan.distances.astype("<f4").tobytes(), np.packbits(scan.hits).tobytes()
    kind = scan.is_virtual, np.packbits(scan.unmapped).tobytes()
    whole = _Scan(scan.robot, scan.time, scan.at.floor, scan.at[1:], scan.mount, *frame, *rows, *kind)
    return msgspec.msgpack.encode(whole)


def load_scan(data: bytes) -> RobotScan:
    """The inverse of `dump_scan`. Raises msgspec.MsgspecError, ValueError."""
    found = decode_msgpack(data, _Scan)
    distances = np.frombuffer(found.distances, "<f4").astype(float)
    hits, unmapped = (
        np.unpackbits(np.frombuffer(bits, np.uint8))[: len(distances)].astype(bool)
        for bits in (found.hits, found.unmapped)
    )
    if len(hits) != len(distances) or len(unmapped) not in (0, len(distances)):
        raise ValueError(f"{len(hits)} hits, {len(unmapped)} marks of {len(distances)} rays")
    at, frame = Pose(found.floor_name, *found.at), (found.first_angle, found.step, found.range, found.rim)
    rows = distances, hits, found.is_virtual, unmapped
    return RobotScan(found.robot, found.time, at, found.mount, *frame, (0.0, 0.0, 0.0, 0), *rows)


def dump_mission(name: str, content: MissionContent) -> bytes:
    return msgspec.json.encode({"name": name, "content": content.state_json()})


def load_mission(data: bytes) -> MissionState:
    """The inverse of `dump_mission`; its version is 0. Raises msgspec.MsgspecError."""
    found = decode_json(data, _Mission)
    return MissionState(found.name, 0, found.content)
