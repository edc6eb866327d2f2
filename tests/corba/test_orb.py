"""The ORB of one process, without a naming service; what needs several processes is in tests/system."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest
from omniORB import CORBA

from robocorba.claimed_ports import claimed_ports
from robocorba.corba.naming import corbaname
from robocorba.corba.orb import OFFER_CALLBACKS, Orb
from robocorba.errors.services import NotReachable, PortInUse, ServiceError
from robocorba.settings import Address
from robocorba.stubs import RoboCorba, RoboCorba__POA


@pytest.fixture
def nowhere() -> Iterator[Address]:
    """An address at which no process listens during the test."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield Address(*held.getsockname())


@pytest.fixture
def endpoint() -> Iterator[Address]:
    """A free address."""
    with claimed_ports() as port:
        yield Address("127.0.0.1", port)


class Planner(RoboCorba__POA.PathPlanner):
    def __init__(self, version: int = 7) -> None:
        self.version = version

    def _get_mapVersion(self) -> int:
        return self.version


@pytest.mark.parametrize(
    ("name", "uri"),
    [
        ("", "corbaname::10.0.0.1:2809"),
        ("RoboCorba/PathPlanner", "corbaname::10.0.0.1:2809#RoboCorba/PathPlanner"),
        ("RoboCorba/Robots/r 1.b", "corbaname::10.0.0.1:2809#RoboCorba/Robots/r%201%5C.b"),
        ("Küche%", "corbaname::10.0.0.1:2809#K%C3%BCche%25"),
    ],
)
def test_corbaname(name: str, uri: str) -> None:
    assert corbaname(Address("10.0.0.1", 2809), name) == uri


def test_corbaname_of_an_ipv6_address() -> None:
    assert corbaname(Address("::1", 2809), "a") == "corbaname::[::1]:2809#a"


def test_a_port_in_use_is_reported_immediately(nowhere: Address) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = Address(*taken.getsockname())
        with pytest.raises(PortInUse) as refused, Orb(nowhere, endpoint):
            pass
    assert (refused.value.host, refused.value.port) == (endpoint.host, endpoint.port)


def test_an_endpoint_of_another_machine_is_not_said_to_be_in_use(nowhere: Address) -> None:
    refused = pytest.raises(ServiceError, match=r"192\.0\.2\.1 is not an address of this machine")
    with refused, Orb(nowhere, Address("192.0.2.1", 2830)):
        pass


def test_a_process_can_have_one_orb_after_another_but_not_two(nowhere: Address, endpoint: Address) -> None:
    for _ in range(3):
        with Orb(nowhere, endpoint), pytest.raises(ServiceError, match="has an ORB already"), Orb(nowhere):
            pass


def test_a_server_listens_from_the_start_to_the_end(nowhere: Address, endpoint: Address) -> None:
    with Orb(nowhere, endpoint):
        socket.create_connection((endpoint.host, endpoint.port), timeout=5).close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((endpoint.host, endpoint.port), timeout=5)


def test_serving_does_not_wait_for_the_naming_service(nowhere: Address, endpoint: Address) -> None:
    with Orb(nowhere, endpoint) as orb:
        orb.serve({"PathPlanner": Planner()})
        orb.stop()
        orb.run()


def test_a_signal_between_serving_and_running_ends_the_run(nowhere: Address, endpoint: Address) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with Orb(nowhere, endpoint) as orb:
        orb.serve({"PathPlanner": Planner()})
        os.kill(os.getpid(), signal.SIGTERM)
        orb.run()
        assert signal.getsignal(signal.SIGTERM) is before
    with Orb(nowhere, endpoint) as orb:
        orb.serve({"PathPlanner": Planner()})
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_hanging_shutdown_prints_its_stacks_and_exits(nowhere: Address) -> None:
    hangs = (
        "import threading; from robocorba.corba import orb as o; from robocorba.settings import Address;"
        "Orb, o.SHUTDOWN_LIMIT_S = o.Orb, 0.5\n"
        f"with Orb(Address.parse('{nowhere}')) as orb:\n    orb.stop()\n    orb.run()\n    threading.Event().wait()"
    )
    ended = subprocess.run((sys.executable, "-c", hangs), capture_output=True, text=True, timeout=60.0)
    assert ended.returncode == 1
    assert 'File "<string>", line 5 in <module>' in ended.stderr


def test_an_activated_object_lives_until_it_is_deactivated(nowhere: Address) -> None:
    with Orb(nowhere) as orb:
        first, second = Planner(1), Planner(2)
        references = orb.activate(first), orb.activate(second)
        assert [reference._get_mapVersion() for reference in references] == [1, 2]
        orb.deactivate(first)
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            references[0]._get_mapVersion()
        assert references[1]._get_mapVersion() == 2


def test_two_threads_that_create_an_adapter_use_the_same(nowhere: Address) -> None:
    with Orb(nowhere, options=OFFER_CALLBACKS) as orb:
        of_one = orb._object_adapter
        # The other, as it does where Python's cached_property has no lock (from 3.12 on).
        of_other = Orb.__dict__["_object_adapter"].func(orb)
        assert of_other._is_equivalent(of_one)


def test_a_key_is_valid_again_after_its_end(nowhere: Address, endpoint: Address) -> None:
    with Orb(nowhere, endpoint) as orb:
        first = orb.activate(Planner(1), "again")
        orb.accept_calls()
        assert first._get_mapVersion() == 1
        orb.deactivate_key("again")
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            first._get_mapVersion()
        orb.activate(Planner(2), "again")
        assert first._get_mapVersion() == 2


def test_an_unreachable_object_is_reported_with_its_naming_service(nowhere: Address) -> None:
    with Orb(nowhere) as orb:
        with pytest.raises(NotReachable) as missing:
            orb.resolve("PathPlanner", RoboCorba.PathPlanner, timeout_s=0.2)
        assert str(missing.value) == (
            f"RoboCorba/PathPlanner is not reachable: "
            f"the naming service at {nowhere} does not answer (TRANSIENT_ConnectFailed)"
        )
        with pytest.raises(NotReachable, match=str(nowhere)):
            orb.check_naming()


def test_a_naming_service_that_only_listens_is_not_ready(endpoint: Address) -> None:
    with Orb(endpoint, endpoint) as orb:
        orb.accept_calls()
        with pytest.raises(NotReachable, match=f"the naming service at {endpoint} has no root context"):
            orb.check_naming()


@pytest.mark.parametrize("name", ["", "/", "a//b", "a/"])
def test_names_without_a_part_are_refused(nowhere: Address, name: str) -> None:
    with Orb(nowhere) as orb, pytest.raises(NotReachable, match="can't be a name"):
        orb.resolve(name, RoboCorba.PathPlanner, timeout_s=60.0)


def test_an_object_is_found_by_its_secret_key(nowhere: Address, endpoint: Address) -> None:
    """Also by a process that does not know the key when it starts."""
    asked, uris = [], []

    def find(key: str) -> Planner | None:
        asked.append(key)
        return Planner(8) if key == "known" else None

    with Orb(nowhere, endpoint) as orb:
        orb.serve_secrets(find)
        orb.accept_calls()
        uris = [orb.uri(orb.activate_secret(Planner(7), key)) for key in ("known", "unknown")]
        planner = orb.reference(uris[1], RoboCorba.PathPlanner)
        assert planner._get_mapVersion() == 7 and asked == []
        orb.deactivate_secret("unknown")
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            planner._get_mapVersion()
    asked.clear()
    with Orb(nowhere, endpoint) as orb:
        orb.serve_secrets(find)
        orb.accept_calls()
        planner, gone = (orb.reference(uri, RoboCorba.PathPlanner) for uri in uris)
        assert [planner._get_mapVersion() for _ in range(2)] == [8, 8]
        with pytest.raises(CORBA.OBJECT_NOT_EXIST):
            gone._get_mapVersion()
        assert asked == ["known", "unknown"]
        orb.deactivate_secret("known")
        orb.deactivate_secret("unknown")
        assert planner._get_mapVersion() == 8 and asked == ["known", "unknown", "known"]
