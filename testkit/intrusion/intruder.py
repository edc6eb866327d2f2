"""Somebody with one role in a guarded system who tries everything else.

They call every operation of every object that they find by its open key, by its name in their naming context, by an
answer of another object, or by guessing its key; and look for secrets in all answers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from urllib.parse import quote

import CosEventChannelAdmin
import CosNaming
from omniORB import CORBA
from omniORB import tcInternal as tc

from robocorba.orb.calls import set_call_timeout
from robocorba.orb.guard import Guard
from robocorba.orb.orb import CONTEXT, Orb
from robocorba.stubs import RoboCorba
from robocorba.system.names import CHANNELS, ROBOTS, SENSORS
from robocorba.system.roles import EVERYBODY, NAMED, PUBLISHERS, SERVERS, Role, Roles, may_call
from robocorba.system.roles import ROBOTS as ROBOT_ROLES
from testkit.fuzzing.operations import Operation, interfaces, operations
from testkit.fuzzing.values import kind_of, resolved
from testkit.heartbeats import heartbeats
from testkit.simulation import about

#: Objects with a name in the system that is attacked, and their interfaces.
OBJECTS = {
    **{name: name for name in ("MapEditor", "PathPlanner", "SimulationServer", "OmniDatabase", "MissionControl")},
    **{f"{SENSORS}/s1": "VirtualSensor", f"{CHANNELS}/a": "EventChannel", f"{ROBOTS}/A": "RobotAgent"},
}
#: Operations of a naming context that change it: nobody may call them.
WRITES = frozenset(
    ("bind", "rebind", "bind_context", "rebind_context", "unbind", "new_context", "bind_new_context", "destroy")
)
#: What the attackers call themselves, and a robot and a channel of others.
OURS, THEIRS, THEIR_CHANNEL = "intruder", "A", f"{CHANNELS}/a"
#: Time limits of a call and of a pull, which waits for an event that never arrives [s].
CALL_LIMIT_S, PULL_LIMIT_S = 30.0, 3.0
NOBODY: Roles = SERVERS


@dataclass
class Findings:
    """What came of the calls of one role. calls: pairs of an operation and the role, by interface and whether it was
    refused. reached: objects that the role got hold of. more: got through although the table refuses; less: refused
    although the table allows; unanswered: calls that timed out or did not reach the object, so that neither is known;
    secrets: what answers gave away."""

    calls: dict[str, list[int]] = field(default_factory=dict)
    reached: dict[str, bool] = field(default_factory=dict)
    guesses: int = 0
    strange_calls: int = 0
    more: list[str] = field(default_factory=list)
    less: list[str] = field(default_factory=list)
    unanswered: list[str] = field(default_factory=list)
    secrets: list[str] = field(default_factory=list)

    def count(self, interface: str, was_refused: bool) -> None:
        self.calls.setdefault(interface, [0, 0])[was_refused] += 1

    @property
    def pairs(self) -> int:
        return sum(sum(counts) for counts in self.calls.values())

    @property
    def out_of_reach(self) -> int:
        """The number of operations of objects that the role got hold of nowhere."""
        kinds = [way.interface for way in WAYS if not self.reached[way.title]]
        return sum(len(operations(each)) for each in (*kinds, *(getattr(RoboCorba, name) for name in HIDDEN)))


@dataclass(frozen=True)
class Way:
    """An object without a name, and the operation that returns it. title: begins with the name of its interface. may:
    the roles that may have it. refused: operations that its holder may not call."""

    title: str
    may: Roles
    get: Callable[[Mapping[str, Any], Any], Any]
    refused: frozenset[str] = frozenset()

    @property
    def interface(self) -> Any:
        name = self.title.split()[0]
        modules = (RoboCorba, CosEventChannelAdmin, CosNaming)
        return next(getattr(module, name) for module in modules if hasattr(module, name))


_QUEUE = RoboCorba.QueuePolicy(10, RoboCorba.DISCARD_OLDEST, 0.0)
_AUTHORS = PUBLISHERS - ROBOT_ROLES
_CONTEXT = "NamingContextExt"
WAYS: tuple[Way, ...] = (
    Way("DataPool", EVERYBODY, lambda of, me: of["RobotAgent"]._get_pool()),
    Way("RobotSensors", EVERYBODY, lambda of, me: of["RobotAgent"]._get_sensors()),
    Way("EditSession", _AUTHORS, lambda of, me: of["MapEditor"].openSession("i")),
    Way("Transaction", _AUTHORS, lambda of, me: of["MapEditor"].begin()),
    Way("ConsumerAdmin", EVERYBODY, lambda of, me: of["EventChannel"].for_consumers()),
    Way("SupplierAdmin", PUBLISHERS, lambda of, me: of["EventChannel"].for_suppliers()),
    Way("EventProxyPushSupplier", EVERYBODY, lambda of, me: of["EventChannel"].subscribe("", me, [], _QUEUE)),
    Way("EventProxyPullSupplier", EVERYBODY, lambda of, me: of["ConsumerAdmin"].obtain_pull_supplier()),
    Way("EventProxyPushConsumer", PUBLISHERS, lambda of, me: of["EventChannel"].supply(OURS)),
    Way("ProxyPullConsumer", PUBLISHERS, lambda of, me: of["SupplierAdmin"].obtain_pull_consumer()),
    Way("CallbackRoute", EVERYBODY, lambda of, me: of["EventChannel"].routeBack()),
    Way("PeerFeed", NOBODY, lambda of, me: of["EventChannel"].joinPeer("c", of["EventChannel"], me)[0].feed),
    Way(
        "SensorRegistration",
        NOBODY,
        lambda of, me: of["SimulationServer"].registerSensor("s1", of["VirtualSensor"], "0" * 64),
    ),
    Way("VirtualSensor of another robot", NOBODY, lambda of, me: of["VirtualSensor"].forRobot(THEIRS)),
    Way("RobotSession", ROBOT_ROLES, lambda of, me: of["SimulationServer"].registerRobot(about(OURS, 8.0, 8.0))),
    Way(
        "VirtualSensor of its session",
        ROBOT_ROLES,
        lambda of, me: of["RobotSession"]._get_sensor(),
        frozenset({"forRobot", "dismiss"}),
    ),
    Way("NameRegistry", ROBOT_ROLES, lambda of, me: of[_CONTEXT].resolve_str("NameRegistry")),
    Way(f"{_CONTEXT} RoboCorba", EVERYBODY, lambda of, me: of[_CONTEXT].resolve_str(CONTEXT), WRITES),
    Way(f"{_CONTEXT} Robots", EVERYBODY, lambda of, me: of[_CONTEXT].resolve_str(f"{CONTEXT}/{ROBOTS}"), WRITES),
    Way("BindingIterator", EVERYBODY, lambda of, me: of[f"{_CONTEXT} RoboCorba"].list(1)[1]),
)
#: What a robot with a file of its own may not do, by interface: publish, log on and store missions as others, as the
#: examples do; and what it does not get hold of.
REFUSED_TO_ONE = {
    "EventChannel": {"supply", "for_suppliers"},
    "SimulationServer": {"registerRobot"},
    "OmniDatabase": {"putMission"},
}
UNREACHED_BY_ONE = ("SupplierAdmin", "ProxyPullConsumer")
#: Objects of the process that attacks: they answer calls of other interfaces otherwise.
OF_THIS_PROCESS = ("RobotAdaptor",)
#: Interfaces of objects that no operation returns to anybody: only who guesses their keys could call them.
HIDDEN = ("SimulationAdministrator", "Supervisor", "StopTarget", "PeerGateway")
#: Called last, since they end the object.
_ENDS = ("disconnect_", "deregister", "close", "commit", "rollBack", "destroy")


class Intruder:
    """Someone with a role. root: the naming context of the role. consumer: an event consumer of theirs. examples:
    arguments of plausible calls, by interface and operation. secrets: what no answer may contain. is_one: a robot with
    a file of its own."""

    def __init__(
        self,
        orb: Orb,
        role: Role,
        root: Any,
        consumer: Any,
        examples: Mapping[str, Mapping[str, Sequence[Callable[[], tuple[Any, ...]]]]],
        secrets: Mapping[str, str],
        is_one: bool = False,
    ) -> None:
        self._orb, self._role, self._root, self._consumer = orb, role, root, consumer
        self._examples, self._secrets, self._is_one = examples, secrets, is_one
        self.findings = Findings()

    @cached_property
    def by_name(self) -> dict[str, Any]:
        """The objects with a name, by interface, as the role finds them."""
        return {
            interface: self._cast(self._root.resolve_str(f"{CONTEXT}/{name}"), getattr(RoboCorba, interface))
            for name, interface in OBJECTS.items()
        }

    def by_open_key(self, endpoints: Mapping[str, str]) -> dict[str, Any]:
        """The same by their open keys. endpoints: HOST:PORT of the server of each name."""
        return {
            interface: self._cast(
                self._orb.reference(f"corbaloc:iiop:1.2@{endpoints[name]}/{name}", CORBA.Object),
                getattr(RoboCorba, interface),
            )
            for name, interface in OBJECTS.items()
        }

    def attack(self, named: Mapping[str, Any]) -> None:
        """Call everything that there is to call. named: the objects with a name, by interface."""
        self.by_name.update(named)
        found = {**named, _CONTEXT: self._root}
        for interface, reference in named.items():
            allowed = {each.name for each in operations(getattr(RoboCorba, interface))}
            allowed = {each for each in allowed if may_call(self._role, interface, each)}
            allowed -= REFUSED_TO_ONE.get(interface, set()) if self._is_one else set()
            self._call_all(interface, reference, getattr(RoboCorba, interface), allowed)
        assert NAMED.keys() == {("EventChannel", "subscribe")}
        if self._role not in NAMED["EventChannel", "subscribe"]:
            self._check("EventChannel.subscribe with a name", False, lambda: self._subscribe("theirs"))
        for way in WAYS:
            reference = self._get(way, found)
            self.findings.reached[way.title] = reference is not None
            may = self._role in way.may and not (self._is_one and way.title in UNREACHED_BY_ONE)
            if reference is None:
                if may:
                    self.findings.less.append(f"no {way.title}")
                continue
            if not may:
                self.findings.more.append(f"got hold of a {way.title}")
            found[way.title] = self._cast(reference, way.interface)
        own = [found["RobotSession"]] if "RobotSession" in found else []
        with contextlib.closing(heartbeats(lambda: own)):  # the attack may take longer than the lease
            self._attack_found(found)

    def _attack_found(self, found: Mapping[str, Any]) -> None:
        contexts = [each for each in found if each.startswith(_CONTEXT)]
        for title in contexts:
            names = {each.name for each in operations(CosNaming.NamingContextExt)}
            self._call_all(title, found[title], CosNaming.NamingContextExt, names - WRITES)
        for way in reversed(WAYS):
            if way.title in found and way.title not in contexts:
                names = {each.name for each in operations(way.interface)}
                self._call_all(way.title, found[way.title], way.interface, names - way.refused)

    def guess(self, endpoints: Iterable[str], open_keys: Iterable[str], own_key: str = "") -> None:
        """Try keys at each endpoint. open_keys: those at which objects may be. own_key: that of the role's context."""
        known = {quote(key, safe="/~") for key in open_keys}
        for endpoint in endpoints:
            for key in sorted({*guesses(own_key), *known}):
                reference = self._orb.reference(f"corbaloc:iiop:1.2@{endpoint}/{key}", CORBA.Object)
                set_call_timeout(reference, CALL_LIMIT_S)
                self.findings.guesses += 1
                try:
                    exists = not reference._non_existent()
                except CORBA.SystemException:
                    exists = False
                if exists and key not in known:
                    self.findings.more.append(f"an object at {endpoint}/{key[:80]}")

    # ---- calls ----

    def _get(self, way: Way, found: Mapping[str, Any]) -> Any:
        try:
            return way.get(found, self._consumer)
        except (CORBA.Exception, KeyError):
            return None

    def _subscribe(self, name: str) -> Any:
        return self.by_name["EventChannel"].subscribe(name, self._consumer, [], _QUEUE)

    def _call_all(self, title: str, reference: Any, interface: Any, allowed: set[str]) -> None:
        own = operations(interface)
        for operation in sorted(own, key=lambda each: each.name.startswith(_ENDS)):
            is_end = operation.name.startswith(_ENDS) and operation.name in allowed
            if is_end and not title.startswith(_CONTEXT):
                self._call_strange(title, reference, own)
            self._call(title, reference, operation, operation.name in allowed)
            if is_end:
                return
        self._call_strange(title, reference, own)

    def _call(self, title: str, reference: Any, operation: Operation, is_allowed: bool) -> None:
        examples = self._examples.get(title.split(" ")[0], {}).get(operation.name, ())
        arguments = tuple(examples[0]()) if examples else tuple(map(simple_value, operation.wanted))
        if title == "VirtualSensor of its session" and not is_allowed:
            arguments = (THEIRS,)

        def call() -> Any:
            return reference._obj.invoke(operation.name, operation.descriptor, arguments)

        if operation.name == "pull":
            set_call_timeout(reference, PULL_LIMIT_S)
        was_refused = self._check(f"{title}.{operation.name}", is_allowed, call, operation.name == "pull")
        if operation.name == "pull":
            set_call_timeout(reference, CALL_LIMIT_S)
        self.findings.count(title, was_refused)

    def _call_strange(self, title: str, reference: Any, own: Sequence[Operation]) -> None:
        """Call the operations of all other interfaces; the object must not know them."""
        if title in OF_THIS_PROCESS:
            return
        names = {each.name for each in own}
        tried: set[str] = set()
        for interface in interfaces():
            for operation in operations(interface):
                if operation.name in names or operation.name in tried:
                    continue
                tried.add(operation.name)
                self.findings.strange_calls += 1
                with contextlib.suppress(CORBA.SystemException):
                    reference._obj.invoke(operation.name, ((), (), {}), ())
                    self.findings.more.append(f"{title} answers {interface.__name__}.{operation.name}")

    def _check(self, what: str, is_allowed: bool, call: Callable[[], Any], waits: bool = False) -> bool:
        """Whether a call is refused, noted where that is not as it should be. waits: it times out if it is allowed."""
        try:
            result = call()
        except CORBA.NO_PERMISSION:
            if is_allowed:
                self.findings.less.append(what)
            return True
        except CORBA.Exception as error:
            if isinstance(error, CORBA.TIMEOUT | CORBA.TRANSIENT) and not waits:
                self.findings.unanswered.append(f"{what}: {type(error).__name__}")
                return False
            result = error
            with contextlib.suppress(AttributeError):
                result = (type(error).__name__, vars(error))
        if not is_allowed:
            self.findings.more.append(f"{what}: {str(result)[:100]}")
        self._look_for_secrets(what, result)
        self._undo(result)
        return False

    def _look_for_secrets(self, what: str, result: Any) -> None:
        text = repr(result)
        for name, secret in self._secrets.items():
            if secret in text:
                self.findings.secrets.append(f"{what}: {name}")

    def _undo(self, result: Any) -> None:
        """End what a call has begun."""
        for one in result if isinstance(result, tuple) else (result,):
            for end in ("deregister", "rollBack", "close", "disconnect_push_supplier"):
                if hasattr(one, end) and not isinstance(one, dict):
                    with contextlib.suppress(CORBA.Exception):
                        getattr(one, end)()

    @staticmethod
    def _cast(reference: Any, interface: Any) -> Any:
        found = reference._unchecked_narrow(interface)
        set_call_timeout(found, CALL_LIMIT_S)
        return found


def guesses(own_key: str = "") -> Iterator[str]:
    """Keys, quoted for a URI, that somebody might try who knows these sources. own_key: of the role's context."""
    channel, robot = THEIR_CHANNEL, f"{ROBOTS}/{THEIRS}"
    plain = [f"{channel}/{part}" for part in ("consumers", "suppliers", "feed", "gateway")]
    plain += [f"{channel}/proxies/{number}" for number in range(20)]
    plain += [f"{robot}/pool", f"{SENSORS}/s1/robots/{THEIRS}/1", f"{SENSORS}/s1/robots/{THEIRS}/2"]
    plain += ["Supervisor", "supervisor", "NameRegistry", "registry", "INIT", "RootPOA", "omniINSPOA", "objects"]
    plain += ["sessions/", "administrator/", "registrations/", "sensors/", "stop/", "iterators/", "finders", ""]
    for role in Role:
        name = role.name.lower()
        for key in ("", "0" * 64, "f" * 64):
            plain += [f"access/{name}/{key}", f"access/{name}/{key}/registry", f"access/{name}/{key}/{CONTEXT}"]
    for secret in (b"NameService", own_key.encode(), b"0" * 64):
        guard = Guard(secret) if secret else Guard()
        for each in [*OBJECTS, *plain[:27]]:
            plain += [key for key in guard.keys(each) if key != each]
    plain += [f"{each}~" for each in OBJECTS] + [f"{each}~{'0' * 64}" for each in OBJECTS]
    if own_key:  # what is next to the own context
        for role in Role:
            plain.append(own_key.replace("/robot/", f"/{role.name.lower()}/"))
        plain.remove(own_key)
    yield from (quote(key, safe="/~") for key in plain)
    for adapter in ("secrets", "objects", "finders", "omniINSPOA"):
        for head in ("%FF", "%FF%FF", "%FE"):
            yield f"{head}{adapter}%FE"
            yield f"{head}{adapter}%FE" + quote(f"sessions/{THEIRS}", safe="/")
            yield f"{head}{adapter}%FE" + "%00" * 8


def simple_value(descriptor: Any) -> Any:
    """The simplest value of a type that the stubs describe."""
    descriptor = resolved(descriptor)
    kind = kind_of(descriptor)
    if kind == tc.tv_struct:
        return descriptor[1](*map(simple_value, descriptor[5::2]))
    if kind == tc.tv_union:
        label, _, member = descriptor[6][0]
        return descriptor[1](label, simple_value(member))
    if kind == tc.tv_enum:
        return descriptor[3][0]
    if kind == tc.tv_sequence:
        return b"" if kind_of(resolved(descriptor[1])) == tc.tv_octet else []
    if kind == tc.tv_any:
        return CORBA.Any(CORBA.TC_null, None)
    simple = {tc.tv_string: "", tc.tv_objref: None, tc.tv_boolean: False}
    return simple.get(kind, 0.0 if kind in (tc.tv_float, tc.tv_double) else 0)
