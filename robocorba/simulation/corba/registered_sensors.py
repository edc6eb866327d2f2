"""The virtual sensor servers that have registered at the simulation server."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from typing import Any

from robocorba.orb.orb import Orb
from robocorba.simulation.sensor_admission import SensorAdmission
from robocorba.stubs import RoboCorba
from robocorba.system.names import SENSORS


class RegisteredSensors:
    """make: makes the servant of a registration from the server's name and reference."""

    def __init__(self, orb: Orb, admission: SensorAdmission, make: Callable[[str, Any], Any]) -> None:
        self._orb, self._admission, self._make = orb, admission, make
        self._lock = threading.Lock()
        self._keys: dict[str, str] = {}

    def register(self, name: str, reference: Any, proof: str) -> Any:
        """A reference to the registration of a server; it replaces an earlier one. Raises SensorRefused."""
        self._admission.check(name, self._orb.uri(reference) if reference is not None else "", proof)
        with self._lock:
            if name in self._keys:
                self._orb.deactivate_key(self._keys[name])
            self._keys[name] = key = f"registrations/{secrets.token_urlsafe(24)}"
            return self._orb.activate(self._make(name, reference), key)

    def earlier_version(self, name: str) -> Any:
        """The registration of a server that has no token: at the endpoint that `robocorba up` gave to this name, since
        its own reference could be anybody's. Raises SensorRefused."""
        uri = self._orb.uri_for_servers(self._admission.endpoint_of(name), f"{SENSORS}/{name}")
        return self._make(name, self._orb.reference(uri, RoboCorba.VirtualSensor))
