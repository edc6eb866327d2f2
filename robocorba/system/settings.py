"""Settings of all processes: the only module that reads RoboCorba's variables from the environment.

Arguments override the environment, which overrides the defaults. Naming service and state folder come from the first of
these: --naming or --state, --instance, ROBOCORBA_NAMING or ROBOCORBA_STATE, ROBOCORBA_INSTANCE, robocorba.toml.

| variable | meaning | default |
|---|---|---|
| ROBOCORBA_NAMING | the naming service as HOST:PORT, or a role's file | that of the state folder, else 127.0.0.1:2809 |
| ROBOCORBA_STATE | the folder for stores, maps, logs and mission reports | ~/.local/state/robocorba |
| ROBOCORBA_INSTANCE | one of several systems of a user: it has the state folder ~/.local/state/robocorba-NAME | |
| ROBOCORBA_VALUETYPES | 1: values of valuetypes in events are accepted, at which ill-formed ones end a process | 0 |
"""

from __future__ import annotations

import argparse
import contextlib
import ipaddress
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from robocorba.errors.services import NotReachable, ServiceError
from robocorba.system.decoding import read_text
from robocorba.system.defaults_file import read_defaults, text_of
from robocorba.system.instances import instance_folder, json_member
from robocorba.system.names import ACCESS
from robocorba.system.roles import Role

DEFAULT_HOST = "127.0.0.1"


def accepts_valuetypes() -> bool:
    """Whether every client is trusted to send well-formed values of valuetypes."""
    return os.environ.get("ROBOCORBA_VALUETYPES", "0") not in ("", "0")


def omniorb_trace() -> dict[str, str]:
    """omniORB's option `traceLevel`, 0 unless the environment sets it: at its default omniORB writes a line for each
    connection that sends garbage; 27,000 within twenty seconds filled a log."""
    return {} if "ORBtraceLevel" in os.environ else {"traceLevel": "0"}


def choose_instance(name: str) -> None:
    """Let this process, and those that it starts, use an instance by default. It overrides the variables for naming
    service and state folder. Raises InvalidSetting."""
    os.environ["ROBOCORBA_INSTANCE"] = _checked_name("--instance", name)
    for variable in ("ROBOCORBA_NAMING", "ROBOCORBA_STATE"):
        os.environ.pop(variable, None)


def _checked_name(setting: str, name: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,60}", name):
        raise InvalidSetting(setting, name, "not 1 to 60 letters, digits or _ -")
    return name


def replace_environment(variables: Mapping[str, str]) -> None:
    """Let this process have these variables only, as one that was started with them."""
    os.environ.clear()
    os.environ.update(variables)


def typed_words() -> list[str]:
    """The words of the command line that a shell asks this process to complete; empty if none does."""
    words = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS", "")
    return words.split() if "_ROBOCORBA_COMPLETE" in os.environ else []


def limit_ros_discovery() -> None:
    """ROS looks for nodes on this machine only, unless the environment has chosen another range."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


class InvalidSetting(ServiceError):
    """`setting` (a variable or an option) has an unusable `value`."""

    def __init__(self, setting: str, value: str, reason: str) -> None:
        self.setting, self.value, self.reason = setting, value, reason
        super().__init__(f"{setting} is {value[:100]!r}: {reason}")


@dataclass(frozen=True)
class Address:
    """A host name or IP address and a TCP port, 1 to 65535."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"

    @classmethod
    def parse(cls, text: str, setting: str = "address") -> Address:
        """From HOST:PORT or [IPV6]:PORT. setting: its name in errors. Raises InvalidSetting."""
        match = re.fullmatch(r"(?:\[([^\[\]]+)\]|([^:\[\]]+)):([0-9]{1,5})", text.strip(), re.ASCII)
        if match is None:
            raise InvalidSetting(setting, text, "not of the form HOST:PORT")
        return cls.checked(match[1] or match[2], int(match[3]), setting)

    @classmethod
    def checked(cls, host: str, port: int, setting: str = "address") -> Address:
        """An address that clients can use, so no wildcard. Raises InvalidSetting."""
        if not 1 <= port <= 65535:
            raise InvalidSetting(setting, str(port), "a port is a number from 1 to 65535")
        try:
            wildcard = ipaddress.ip_address(host).is_unspecified
        except ValueError:
            wildcard = False
            if len(host) > 253 or not re.fullmatch(r"[A-Za-z0-9_]([A-Za-z0-9_.-]*[A-Za-z0-9_])?", host):
                raise InvalidSetting(setting, host, "neither a host name nor an IP address") from None
        if wildcard:
            raise InvalidSetting(setting, host, "clients can't call a wildcard address; give the address that they use")
        return cls(host, port)

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def scheme(self) -> str:
        """How URIs name the transport of what is there."""
        return "iiop"

    @property
    def setting(self) -> str:
        """The text from which another process reads the same."""
        return str(self)


@dataclass(frozen=True)
class RoleNaming(Address):
    """The naming service of a guarded system, as a role sees it.

    key: the object key of the role's naming context, which is the right to the role; observers need none. file: from
    which it was read. protocol: iiop, or ssliop for TLS."""

    key: str = field(repr=False)
    role: Role
    file: Path
    protocol: str = "iiop"

    @property
    def scheme(self) -> str:
        return self.protocol

    @property
    def setting(self) -> str:
        return str(self.file)

    @classmethod
    def read(cls, file: Path, setting: str = "--naming") -> RoleNaming:
        """From a file that `robocorba up --guarded` wrote. Raises InvalidSetting."""
        try:
            text = read_text(file).strip()
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidSetting(setting, str(file), getattr(error, "strerror", "") or "not a text") from None
        match = re.fullmatch(
            rf"corbaloc:(iiop|ssliop):1\.2@([^/]+)/(NameService|{ACCESS}/([a-z]+)/[0-9a-f]{{64}})", text, re.ASCII
        )
        roles = {role.name.lower(): role for role in Role}
        if match is None or (match[4] or "observer") not in roles:
            raise InvalidSetting(setting, str(file), "not a file of a role in a guarded system")
        address = Address.parse(match[2], setting)
        return cls(address.host, address.port, match[3], roles[match[4] or "observer"], file.absolute(), match[1])


def role_file(state: Path, role: Role) -> Path:
    """The file of a role in a state folder; there while the system is guarded."""
    return state / ACCESS / f"{role.name.lower()}.ior"


def robot_files(access: Path) -> Path:
    """The folder, in that of the roles' files, with the files of single robots."""
    return access / "robots"


def robot_keys(access: Path) -> dict[str, str]:
    """The object key of the naming context of each robot that has a file of its own, by the robot's name."""
    found = {}
    for file in robot_files(access).glob("*.ior"):
        with contextlib.suppress(InvalidSetting):  # removed meanwhile, or something else
            found[unquote(file.stem)] = RoleNaming.read(file).key
    return found


@dataclass(frozen=True)
class Settings:
    """The settings of every command. origin: where the address of the naming service is from. instance: the name of the
    one that was chosen, else empty."""

    naming: Address
    state: Path
    origin: str = field(default="", compare=False)
    instance: str = field(default="", compare=False)

    @contextlib.contextmanager
    def hinting(self, check_naming: Callable[[], object]) -> Iterator[None]:
        """Where a server is not reachable, and nor is the naming service, say what its address is from.

        check_naming: calls it, and raises NotReachable."""
        try:
            yield
        except NotReachable as error:
            try:
                check_naming()
            except NotReachable:
                up = f"robocorba up --instance {self.instance}" if self.instance else "robocorba up"
                raise NotReachable(f"{error}; is `{up}` running? {self.naming} is from {self.origin}") from None
            raise

    @classmethod
    def read(
        cls,
        naming: str | None = None,
        state: Path | None = None,
        environment: Mapping[str, str] = os.environ,
        role: Role = Role.OPERATOR,
        choose_port: Callable[[Path], str] | None = None,
    ) -> Settings:
        """Settings from arguments, environment and defaults. Raises InvalidSetting; NotReachable for an instance that
        does not run.

        role: what this process is in a guarded system, if nothing says where its naming service is. choose_port: of the
        naming service of an instance that does not run, by its state folder; None where it has to run."""
        folder, instance, (file, default) = _state_folder(state, environment)
        variable = environment.get("ROBOCORBA_NAMING") or ""
        address, origin = (naming, "--naming") if naming else (variable, "ROBOCORBA_NAMING")
        address, origin = (address, origin) if address else (default, file)
        if "/" in address or address.endswith(".ior"):
            return cls(RoleNaming.read(Path(address), origin), folder, origin, instance)
        if not address:
            origin = f"the state folder {folder}"
            if os.access(role_file(folder, role), os.R_OK):
                return cls(RoleNaming.read(role_file(folder, role), "the state folder"), folder, origin, instance)
            address = json_member(folder / "up.json", "naming")
        if not address and instance:  # ports of other systems must not be tried
            if choose_port is None:
                start = f"start it with `robocorba up --instance {instance}`"
                raise NotReachable(f"instance {instance!r} does not run (state folder {folder}); {start}")
            address = f"{DEFAULT_HOST}:{choose_port(folder)}"
        if not address:  # 2809 is the port registered for CORBA naming services
            origin, address = f"the default, as nothing runs in {folder}", f"{DEFAULT_HOST}:2809"
        return cls(Address.parse(address, origin), folder, origin, instance)


def state_folder(state: Path | None = None) -> Path:
    """The state folder by argument, environment or default. Raises InvalidSetting."""
    return _state_folder(state, os.environ)[0]


def _state_folder(state: Path | None, environment: Mapping[str, str]) -> tuple[Path, str, tuple[str, str]]:
    """The state folder; the instance that it belongs to if an instance is chosen, else empty; and where neither
    argument nor environment chooses a folder, robocorba.toml and its naming service, else empty."""
    if chosen := state or environment.get("ROBOCORBA_STATE"):
        return _folder(Path(chosen), "--state" if state else "ROBOCORBA_STATE"), "", ("", "")
    if instance := environment.get("ROBOCORBA_INSTANCE") or "":
        _checked_name("ROBOCORBA_INSTANCE", instance)
        return _folder(instance_folder(instance), "the state folder"), instance, ("", "")
    file, members = read_defaults()
    naming, folder, instance = (text_of(file, members, name) for name in ("naming", "state", "instance"))
    if instance:
        _checked_name(str(file), instance)
    chosen = file.parent / Path(folder).expanduser() if file and folder else instance_folder(instance)
    return _folder(chosen, str(file)), instance if not folder else "", (str(file), naming)


#: `add_argument` of a parser, or what takes the same.
AddArgument = Callable[..., object]


def add_common_options(add: AddArgument) -> None:
    """Options of every process for naming service and state folder."""
    instance = "one of several systems on this machine; default: ROBOCORBA_INSTANCE"
    naming = "naming service, or a role's file; default: that of the running system"
    add("--instance", type=choose_instance, metavar="NAME", help=instance)
    add("--naming", metavar="HOST:PORT|FILE", help=naming)
    add("--state", type=Path, metavar="DIR", help="state folder; default: ROBOCORBA_STATE")


@dataclass(frozen=True)
class ServerSettings:
    """What `robocorba up` passes to each server: its state folder, its endpoint, the naming service, the map."""

    state: Path
    endpoint: Address
    naming: Address
    building: Path | None

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> ServerSettings:
        """From `--state DIR --endpoint HOST:PORT [--naming HOST:PORT] [--building FILE]`.

        Raises InvalidSetting; SystemExit with a usage line for unknown or missing arguments."""
        return cls.from_arguments(cls.parser(description).parse_args(arguments))

    @staticmethod
    def parser(description: str) -> argparse.ArgumentParser:
        """The parser for these arguments; a server may add its own."""
        parser = argparse.ArgumentParser(description=description, allow_abbrev=False)
        parser.add_argument("--endpoint", required=True, metavar="HOST:PORT", help="address to listen on")
        add_common_options(parser.add_argument)
        parser.add_argument("--building", type=Path, metavar="FILE", help="map to serve")
        return parser

    @classmethod
    def from_arguments(cls, given: argparse.Namespace) -> ServerSettings:
        """The settings from parsed arguments. Raises InvalidSetting."""
        common = Settings.read(given.naming, given.state, role=Role.SERVER)
        return cls(
            state=common.state,
            endpoint=Address.parse(given.endpoint, "--endpoint"),
            naming=common.naming,
            building=given.building.absolute() if given.building else None,
        )


@dataclass(frozen=True)
class ChannelSettings:
    """Settings of an event channel's server: those of every server, the channel's name, and the channels to link with.

    peers: (name, address); the address is empty if the peer is bound in the naming service, else HOST:PORT or a URI.
    foreign: (name, URI) of channels that support only CosEventChannelAdmin. accepts_callbacks: whether it calls
    consumers that want it over their own connections."""

    server: ServerSettings
    name: str
    peers: tuple[tuple[str, str], ...]
    foreign: tuple[tuple[str, str], ...]
    accepts_callbacks: bool = False

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> ChannelSettings:
        """From the arguments of ServerSettings and `--name NAME [--peer NAME[=ADDRESS]]... [--foreign NAME=URI]...`.

        Raises InvalidSetting; SystemExit with a usage line for unknown or missing arguments."""
        parser = ServerSettings.parser(description)
        parser.add_argument("--name", required=True, metavar="NAME", help="name of the channel and its sub-network")
        peer = "channel to link with, with HOST:PORT or URI if the naming service lacks it; repeatable"
        parser.add_argument("--peer", action="append", default=[], metavar="NAME[=ADDRESS]", help=peer)
        foreign = "channel that supports only CosEventChannelAdmin, such as omniEvents; repeatable"
        parser.add_argument("--foreign", action="append", default=[], metavar="NAME=URI", help=foreign)
        parser.add_argument("--bidirectional", action="store_true", help="reach consumers behind NAT")
        given = parser.parse_args(arguments)
        peers = tuple((name, address) for name, _, address in (text.partition("=") for text in given.peer))
        foreigners = tuple((name, uri) for name, _, uri in (text.partition("=") for text in given.foreign))
        for name, uri in foreigners:
            if not uri:
                raise InvalidSetting("--foreign", name, "not of the form NAME=URI")
        return cls(ServerSettings.from_arguments(given), given.name, peers, foreigners, given.bidirectional)


@dataclass(frozen=True)
class MapEditorSettings:
    """Settings of the map editor server: those of every server, and of proposals.

    channel: the event channel at which it listens for what robots see, empty for none. accept: number of robots
    that must have seen a proposal, and for how long [s], so that it is drawn; 0 robots: none is."""

    server: ServerSettings
    channel: str
    accept: tuple[int, float]

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> MapEditorSettings:
        """From the arguments of ServerSettings and `[--channel NAME] [--accept ROBOTS,SECONDS]`. Raises as
        ServerSettings.read does."""
        parser = ServerSettings.parser(description)
        parser.add_argument("--channel", default="", metavar="NAME", help="event channel of sightings")
        what = "add an obstacle to the map after ROBOTS have seen it for SECONDS"
        parser.add_argument("--accept", default="", metavar="ROBOTS,SECONDS", help=what)
        given = parser.parse_args(arguments)
        return cls(ServerSettings.from_arguments(given), given.channel, accept_rule(given.accept))


def accept_rule(text: str) -> tuple[int, float]:
    """ROBOTS,SECONDS as numbers, 0 for an empty text. Raises InvalidSetting."""
    match = re.fullmatch(r"([1-9][0-9]?),([0-9]+(?:\.[0-9]+)?)", text or "1,0", re.ASCII)
    if match is None:
        raise InvalidSetting("--accept", text, "not of the form ROBOTS,SECONDS, such as 3,60")
    return (int(match[1]), float(match[2])) if text else (0, 0.0)


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of the simulation server: those of every server, and the event channel at which it publishes.

    channel: empty for none."""

    server: ServerSettings
    channel: str

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> SimulationSettings:
        """From the arguments of ServerSettings and `[--channel NAME]`. Raises as ServerSettings.read does."""
        parser = ServerSettings.parser(description)
        parser.add_argument("--channel", default="", metavar="NAME", help="event channel to publish events on")
        given = parser.parse_args(arguments)
        return cls(ServerSettings.from_arguments(given), given.channel)


@dataclass(frozen=True)
class SensorSettings:
    """Settings of a virtual sensor server: those of every server, and its name."""

    server: ServerSettings
    name: str

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> SensorSettings:
        """From the arguments of ServerSettings and `--name NAME`. Raises as ServerSettings.read does."""
        parser = ServerSettings.parser(description)
        parser.add_argument("--name", required=True, metavar="NAME", help="name of the virtual sensor server")
        given = parser.parse_args(arguments)
        return cls(ServerSettings.from_arguments(given), _checked_name("--name", given.name))


@dataclass(frozen=True)
class RobotSettings:
    """Settings of a robot process.

    endpoint: None for any port. floor: empty for the first. at: its start there, x, y [m], heading [rad],
    None for a free path node. channel: of its sub-network, empty for none, None for that of the
    area in which it logs on. tick_file: CSV file with one row for each
    control cycle of its programs, None for no file. prints_progress: prints a line whenever what the robot does
    changes. protects: whether robots have a protective field, None for the usual ones. perceives: whether they avoid
    what they see, and not what only the simulation knows. is_agent_only: it runs on the robot's computer, without
    the servers."""

    common: Settings
    name: str
    endpoint: Address | None
    adaptor: str
    adaptor_arguments: tuple[str, ...]
    program: Path | None
    floor: str
    at: tuple[float, float, float] | None
    channel: str | None
    tick_file: Path | None
    prints_progress: bool
    protects: bool | None = None
    perceives: bool = False
    is_agent_only: bool = False

    @staticmethod
    def add_arguments(add: AddArgument) -> None:
        """Those of a robot; its adaptor's follow after `--`."""
        add("name", metavar="NAME", help="name of the robot")
        add("--adaptor", default="simulated", metavar="A", help="robot adaptor, such as smartpal; default: simulated")
        add("--program", type=Path, metavar="FILE", help="program to run as soon as the robot is ready")
        add("--floor", default="", metavar="F", help="floor to start on; default: the first")
        add("--at", default="", metavar="X,Y[,HEADING]", help="start pose [m, rad]; default: any free one")
        channel = "event channel of its sub-network; default: that of the area in which it starts"
        add("--channel", metavar="C", help=channel)
        add("--record", type=Path, metavar="FILE", help="log each control cycle (tick) in this CSV file, replacing it")
        add("--progress", action="store_true", help="print a line when its activity changes")
        protect = "stop before obstacles that its range sensors see; default: on for actual robots"
        add("--protect", choices=("on", "off"), help=protect)
        perceive = "avoid what the simulation knows, or what the robot's sensors see; default: simulation"
        add("--perceive", choices=("simulation", "sensors"), default="simulation", help=perceive)
        alone = "on an actual robot's own computer: run uploaded programs without the servers"
        add("--agent-only", action="store_true", help=alone)
        add("--endpoint", metavar="HOST:PORT", help="address to listen on; default: any free port")
        add_common_options(add)

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> RobotSettings:
        """From the arguments of `add_arguments`. Raises InvalidSetting; SystemExit with a usage line for unknown or
        missing arguments."""
        given_arguments = list(sys.argv[1:] if arguments is None else arguments)
        adaptor_arguments: list[str] = []
        if "--" in given_arguments:
            cut = given_arguments.index("--")
            given_arguments, adaptor_arguments = given_arguments[:cut], given_arguments[cut + 1 :]
        parser = argparse.ArgumentParser(description=description, allow_abbrev=False)
        cls.add_arguments(parser.add_argument)
        given = parser.parse_args(given_arguments)
        if given.agent_only and given.perceive == "sensors":
            raise InvalidSetting("--perceive", "sensors", "with --agent-only the robot stops before what it sees")
        return cls(
            Settings.read(given.naming, given.state, role=Role.ROBOT),
            given.name,
            Address.parse(given.endpoint, "--endpoint") if given.endpoint else None,
            given.adaptor,
            tuple(adaptor_arguments),
            given.program,
            given.floor,
            _start(given.floor, given.at),
            given.channel,
            given.record,
            given.progress,
            given.protect and given.protect == "on",
            given.perceive == "sensors",
            given.agent_only,
        )


def _start(floor: str, text: str) -> tuple[float, float, float] | None:
    if not text:
        return None
    if not floor:
        raise InvalidSetting("--at", text, "needs --floor")
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3):
        raise InvalidSetting("--at", text, "not of the form X,Y or X,Y,HEADING")
    return values[0], values[1], values[2] if len(values) == 3 else 0.0


@dataclass(frozen=True)
class SmartPalSettings:
    """Settings of the stand-in for the actual SmartPal: those of every server. `naming` is the robot's own naming
    service, not that of `robocorba up`.

    seed: of its encoders' noise. start: the pose that its odometry reports first, x, y [m] and heading [rad].
    restores_servo, unlocks_by_power, limit_slack: see UnitPolicy.

    world: the map file of what really stands around it, None for a robot without sensors. world_floor: its floor there,
    empty for the first one. world_at: where it really is, whatever its odometry says. range_noise_m, range_lost: of its
    distances."""

    server: ServerSettings
    seed: int
    start: tuple[float, float, float]
    restores_servo: bool
    unlocks_by_power: bool
    limit_slack: float
    world: Path | None
    world_floor: str
    world_at: tuple[float, float, float]
    range_noise_m: float
    range_lost: float

    @classmethod
    def read(cls, arguments: Sequence[str] | None = None, description: str = "") -> SmartPalSettings:
        """From the arguments of ServerSettings and `[--seed N] [--x M] [--y M] [--heading RAD] [--servo-after-fault
        on|off] [--unlock power|unlock] [--limit-slack SHARE] [--world FILE] [--world-floor NAME] [--world-at X Y
        HEADING] [--range-noise M] [--range-lost SHARE]`. Raises as ServerSettings.read does."""
        parser = ServerSettings.parser(description)
        parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the encoders' noise")
        for coordinate in ("x", "y", "heading"):
            odometry = "initial odometry [m, rad]"
            parser.add_argument(f"--{coordinate}", type=float, default=0.0, metavar="N", help=odometry)
        servo = "whether motors hold again once the alarms of a fault are cleared"
        parser.add_argument("--servo-after-fault", choices=("on", "off"), default="on", help=servo)
        unlock = "what unlocks the base: power off and on too, or only its operation"
        parser.add_argument("--unlock", choices=("power", "unlock"), default="power", help=unlock)
        slack = "share by which speeds may exceed their limits"
        parser.add_argument("--limit-slack", type=float, default=1e-7, metavar="SHARE", help=slack)
        parser.add_argument("--world", type=Path, metavar="FILE", help="map that its sensors see")
        parser.add_argument("--world-floor", default="", metavar="NAME", help="floor of that map; default: the first")
        where = ("X", "Y", "HEADING")
        parser.add_argument("--world-at", type=float, nargs=3, metavar=where, help="true pose there; default: odometry")
        parser.add_argument("--range-noise", type=float, default=0.0, metavar="M", help="deviation of distances [m]")
        parser.add_argument("--range-lost", type=float, default=0.0, metavar="SHARE", help="share of lost rays")
        given = parser.parse_args(arguments)
        if given.seed < 0:
            raise InvalidSetting("--seed", str(given.seed), "less than 0")
        start = (given.x, given.y, given.heading)
        world_at = tuple(given.world_at or start)
        for setting, values in {"x": start[:1], "y": start[1:2], "heading": start[2:], "world-at": world_at}.items():
            if not all(map(math.isfinite, values)):
                raise InvalidSetting(f"--{setting}", ", ".join(map(str, values)), "not finite")
        for name, most in {"limit_slack": 0.1, "range_noise": 1.0, "range_lost": 1.0}.items():
            if not 0.0 <= (value := getattr(given, name)) <= most:
                raise InvalidSetting(f"--{name.replace('_', '-')}", str(value), f"not 0 to {most:g}")
        return cls(
            ServerSettings.from_arguments(given),
            given.seed,
            start,
            restores_servo=given.servo_after_fault == "on",
            unlocks_by_power=given.unlock == "power",
            limit_slack=given.limit_slack,
            world=given.world,
            world_floor=given.world_floor,
            world_at=world_at,
            range_noise_m=given.range_noise,
            range_lost=given.range_lost,
        )


def _folder(path: Path, setting: str) -> Path:
    if "\0" in str(path):
        raise InvalidSetting(setting, str(path), "not a path")
    try:
        absolute = path.expanduser().absolute()
        if absolute.exists() and not absolute.is_dir():
            raise InvalidSetting(setting, str(path), "not a folder")
    except (OSError, RuntimeError) as error:
        raise InvalidSetting(setting, str(path), str(error)) from None
    return absolute
