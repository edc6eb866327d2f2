"""Complete scans to the IDL and back; those of foreign sensor processes are checked."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from omniORB import CORBA

from robocorba.corba.conversion import scans
from tests.simulation.places import scan

SEEN = scan(distances=np.array([1.0, 8.0]), hits=np.array([True, False]), rim_m=0.3, noise=(0.1, 0.2, 0.3, 7))


def test_a_scan_survives_the_way_to_the_idl_and_back() -> None:
    back = scans.robot_scan_of(scans.robot_scan(SEEN))
    assert back[:-2] == SEEN[:-2]
    assert (back.distances.tolist(), back.hits.tolist()) == ([1.0, 8.0], [True, False])


@pytest.mark.parametrize(
    ("member", "value"),
    [
        ("hits", b"\x01"),
        ("seen", scans.robot_scan(SEEN).seen._replace(distances=[1.0, math.nan])),
        ("seen", scans.robot_scan(SEEN).seen._replace(distances=[1.0, 2.0, 3.0])),
        ("seen", scans.robot_scan(SEEN).seen._replace(time=math.inf)),
        ("spec", scans.robot_scan(SEEN).spec._replace(rays=3)),
        ("spec", scans.robot_scan(SEEN).spec._replace(range=math.nan)),
        ("at", SEEN.at._replace(x=math.nan)),
    ],
)
def test_an_inconsistent_scan_is_refused(member: str, value: Any) -> None:
    with pytest.raises(CORBA.BAD_PARAM):
        scans.robot_scan_of(scans.robot_scan(SEEN)._replace(**{member: value}))


def test_a_scan_of_too_many_rays_is_refused() -> None:
    rays = 10_000
    with pytest.raises(CORBA.BAD_PARAM):
        scans.robot_scan_of(scans.robot_scan(scan(distances=np.ones(rays), hits=np.ones(rays, bool))))
