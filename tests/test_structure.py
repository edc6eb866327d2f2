"""Who may import whom, read from the sources without running them."""

from __future__ import annotations

import ast
import functools
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parents[1]
#: The domain, bottom up: each room, and the rooms within it that stand for themselves, with what it imports of the
#: others. What lies in a `corba` knows the ORB, nothing else here does.
DOMAIN = {
    "errors": "",
    "map_editor.spatial": "errors",
    "events": "errors",
    "map_editor": "errors",
    "robot.motion": "errors map_editor.spatial",
    "robot.kinematics": "errors map_editor.spatial",
    "robot.smartpal_stand_in": "errors map_editor.spatial robot.kinematics robot.senses simulation.sensing",
    "planning": "errors map_editor",
    "robot.data_pool": "errors map_editor",
    "simulation": "errors map_editor planning",
    "simulation.sensing": "errors map_editor simulation",
    "robot.programs": "errors map_editor.spatial planning robot.kinematics simulation.sensing",
    "robot.collision_avoidance": "errors map_editor.spatial planning robot.motion robot.kinematics robot.data_pool",
    "robot": "errors map_editor planning simulation",
    "bridges.openrtm": "errors simulation",
    "missions": "errors map_editor planning robot simulation",
}
#: Rooms, bottom up, each with its parts in CORBA: none imports one above it. What starts processes knows all of them.
LAYERS = (
    *("errors", "system", "orb", "map_editor", "planning", "events", "simulation", "robot", "missions"),
    *("system.corba", "system.supervision", "bridges", "console", "commands"),
)
#: Rooms that only these import.
IMPORTED_BY = {"bridges": {"commands"}, "console": {"commands"}}
#: What every room may use.
COMMON = {
    "robocorba.__version__",
    *(
        f"robocorba.system.{name}"
        for name in (
            *("backoff", "background", "cores", "damaged_files", "decoding", "extras", "kernels", "last_order"),
            *(
                "lazy_property",
                "output_files",
                "private_files",
                "record_file",
                "repeating",
                "sqlite_files",
                "stop_latch",
            ),
        )
    ),
}
SERVANTS = re.compile(r"robocorba/.+_servants?\.py")
#: A servant gets what it needs handed over.
AROUND_SERVANTS = {
    *("robocorba.commands", "robocorba.orb.naming", "robocorba.orb.orb", "testkit"),
    *("robocorba.system.logs", "robocorba.system.settings", "robocorba.system.supervision"),
}
CORBA = {"omniORB", "CosNaming", "CosEventComm", "CosEventChannelAdmin", "CORBA", "PortableServer"}
#: The package imports none of the programs that are built from it.
PROGRAMS = {"servers", "clients", "robocorba.servers", "robocorba.clients", "bench", "tests", "testkit"}
#: Programs that print foreign text by robocorba.system.printing; and those that print none, or show OMG's interfaces
#: without RoboCorba.
PRINTERS = ("robocorba/commands/", "clients/")
PRINTING_NOTHING_FOREIGN = ("clients/robot.py", "clients/new_robot.py", "clients/plain_events.py")
#: Where the environment is read: our variables, numba's and MuJoCo's. Processes of tests inherit theirs.
ENVIRONMENT_IN = (
    "robocorba/system/settings.py",
    "robocorba/system/kernel_store.py",
    "robocorba/robot/kinematics/mujoco_headless.py",
)
#: Threads are started by robocorba.system.background, which reports their failures. Elsewhere are pools whose results,
#: errors included, their user waits for, and a thread that nobody misses.
THREADS_ELSEWHERE = {
    "robocorba/system/background.py": "all others use it",
    "robocorba/commands/event_stats.py": "waits for all results",
    "robocorba/commands/status.py": "waits for all results",
    "robocorba/console/calls.py": "answers each call with its result or error",
    "robocorba/console/robot_views.py": "a view that fails is disconnected",
    "robocorba/console/system_state.py": "a request that fails is the problem of its row",
    "robocorba/robot/smartpal_adaptor.py": "waits for all results",
    "robocorba/events/proxies.py": "waits for all results",
    "clients/demo.py": "prints a hint",
}
#: Programs that tests start.
PROGRAMS_OF_TESTS = ("_program", "_slowly", "_server", "_client")
_THREADS = {"Thread", "Timer", "ThreadPoolExecutor", "ProcessPoolExecutor", "start_new_thread"}


@functools.cache
def parsed(text: str) -> ast.Module:
    return ast.parse(text)


def faults(path: str, text: str) -> list[str]:
    """The rules that a source of robocorba/ breaks; `path` is relative to the repository, with slashes."""
    tree = parsed(text)
    used, nodes = set(imports(path, tree)), list(ast.walk(tree))
    names = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    names |= {node.id for node in nodes if isinstance(node, ast.Name)} | {name.split(".")[-1] for name in used}
    words = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}

    found = [f"imports the program {name}" for name in within(used, PROGRAMS)]
    room = room_of(path)
    if room in DOMAIN:
        allowed = {f"robocorba.{name}" for name in (room, *DOMAIN[room].split())} | COMMON
        strange = used - set(within(used, allowed | PROGRAMS))
        strange |= {name for name in used if "corba" in name.split(".")}
        found += [f"domain code imports {name}" for name in within(strange, CORBA | {"robocorba"})]
        if "cached_property" in names:
            found.append("uses cached_property, whose lock robocorba.system.lazy_property does without")
    elif not knows_orb(path):
        found += [f"imports {name}, which orb/ is for" for name in within(used, CORBA | {"robocorba.stubs"})]
    if SERVANTS.fullmatch(path):
        around = AROUND_SERVANTS | {name for name in used if re.search(r"\.corba\.(remote_\w+|\w+_servants?)\b", name)}
        found += [f"a servant imports {name}" for name in within(used, around)]
        taboo = {"ORB_init", "resolve", "string_to_object", "resolve_initial_references", "argv", "argparse"}
        found += [f"a servant uses {name}" for name in sorted(names & taboo)]
    if path != "robocorba/orb/orb.py" and "ORB_init" in names:
        found.append("starts an ORB, which robocorba.orb.orb is for")
    if not path.startswith(ENVIRONMENT_IN):
        found += [f"reads the environment by {name}" for name in sorted(names & {"environ", "getenv", "environb"})]
    if path != "robocorba/system/settings.py":
        variables = sorted(word for word in words if re.fullmatch("ROBOCORBA_[A-Z_]+", word))
        found += [f"knows {name}, which robocorba.system.settings is for" for name in variables]
    return found


def knows_orb(path: str) -> bool:
    return path.startswith("robocorba/orb/") or "/corba/" in path


def room_of(path: str) -> str:
    """The innermost one of DOMAIN in which a file of the domain lies, else empty."""
    folders = path.split("/")[1:-1]
    inner = [".".join(folders[:count]) for count in range(len(folders), 0, -1)]
    return "" if knows_orb(path) else next((name for name in inner if name in DOMAIN), "")


def called(text: str, *words: str) -> list[ast.Call]:
    """The calls in a source; none where it has none of these words."""
    nodes = ast.walk(parsed(text)) if not words or any(word in text for word in words) else ()
    return [node for node in nodes if isinstance(node, ast.Call)]


def prints(text: str) -> list[str]:
    """How a source prints past robocorba.system.printing, which escapes foreign text."""
    used = set(imports("clients/x.py", parsed(text))) & {"rich.console.Console", "typer.echo", "rich.print"}
    names = {ast.unparse(call.func) for call in called(text)} & {"print", "typer.echo", "typer.secho", "click.echo"}
    exits = {"sys.exit" for call in called(text) if re.match("sys.exit.*f'", ast.unparse(call))}
    return sorted(used | names | exits)


def decodes(text: str) -> list[str]:
    """How a source decodes into types past robocorba.system.decoding, which several threads can use at once."""
    return sorted(
        name
        for name, call in ((ast.unparse(call.func), call) for call in called(text, "msgspec"))
        if name in ("msgspec.convert", "msgspec.json.Decoder", "msgspec.msgpack.Decoder")
        or (name in ("msgspec.json.decode", "msgspec.msgpack.decode") and call.keywords)
    )


def starts_threads(text: str) -> list[str]:
    """How a source starts threads past robocorba.system.background."""
    classes = [node for node in ast.walk(parsed(text)) if isinstance(node, ast.ClassDef)]
    used = [*(call.func for call in called(text, *_THREADS)), *(base for node in classes for base in node.bases)]
    return sorted({ast.unparse(each).rpartition(".")[2] for each in used} & _THREADS)


def suppresses_assertions(text: str) -> bool:
    blocks = [node for node in ast.walk(parsed(text)) if isinstance(node, ast.With)] if "suppress(" in text else []
    return any(
        isinstance(inner, ast.Assert)
        for block in blocks
        if any("suppress(" in ast.unparse(item) for item in block.items)
        for statement in block.body
        for inner in ast.walk(statement)
    )


def imports(path: str, tree: ast.Module) -> Iterator[str]:
    """Absolute names of what a module imports, wherever in it: `from a import b` gives a.b, which may be a module."""
    package = path.split("/")[:-1]
    for node in statements(tree.body):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *filter(None, [node.module])])
            yield from (f"{start}.{alias.name}" for alias in node.names)


def statements(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """Statements, and those inside them; much fewer than all nodes."""
    for node in body:
        yield node
        for inner in ("body", "orelse", "finalbody", "handlers", "cases"):
            yield from statements(getattr(node, inner, ()))


@functools.cache
def imports_of(file: Path) -> tuple[str, ...]:
    """The same of a file of the repository."""
    return tuple(imports(file.relative_to(ROOT).as_posix(), parsed(file.read_text())))


def within(used: set[str], packages: set[str]) -> list[str]:
    """Which of the names lie in one of the packages."""
    return sorted(name for name in used if any(f"{name}.".startswith(f"{package}.") for package in packages))


def sources(*tops: str) -> dict[str, Path]:
    """By name as it is imported, the modules below some folders of the repository."""
    found = {}
    for top in tops:
        start = "robocorba." if top in ("servers", "clients") else ""
        for file in (ROOT / top).rglob("*.py"):
            if "stubs" not in file.parts:
                parts = file.relative_to(ROOT).with_suffix("").parts
                found[start + ".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def arrows(modules: Mapping[str, Path]) -> nx.DiGraph:
    """Which module imports which other one of these."""
    graph = nx.DiGraph()
    for name, file in modules.items():
        for used in imports_of(file):
            module = used if used in modules else used.rpartition(".")[0]
            if module in modules and module != name:
                graph.add_edge(name, module)
    return graph


def folder(module: str, modules: Mapping[str, Path]) -> str:
    """The folder of a module; one directly in robocorba/ stands for itself."""
    if modules[module].name == "__init__.py" or (module.count(".") == 1 and module.startswith("robocorba.")):
        return module
    return module.rpartition(".")[0]


OURS = {name: file for name, file in sources("robocorba").items() if name != "robocorba"}
PRODUCT = sources("robocorba", "servers", "clients")
ALL = sources("robocorba", "servers", "clients", "bench", "tests", "testkit")


def test_sources_keep_the_rules() -> None:
    paths = {file.relative_to(ROOT).as_posix(): file for file in OURS.values()}
    assert {path: found for path, file in paths.items() if (found := faults(path, file.read_text()))} == {}
    # No rule is about what is not there.
    for part in (*(f"robocorba/{name.replace('.', '/')}/" for name in DOMAIN), *ENVIRONMENT_IN):
        assert any(path.startswith(part) for path in paths), part
    assert any(SERVANTS.fullmatch(path) for path in paths)
    used = defaultdict(set)
    for one, other in arrows(OURS).edges:
        used[room_of(OURS[one].relative_to(ROOT).as_posix())].add(f"{other}.")
    for room, others in DOMAIN.items():
        for other in others.split():
            assert any(name.startswith(f"robocorba.{other}.") for name in used[room]), (room, other)
    for name in COMMON - {"robocorba.__version__"}:
        assert name in OURS, name


def test_there_are_few_rooms() -> None:
    folders = {file.relative_to(ROOT).parts[1] for file in OURS.values() if len(file.relative_to(ROOT).parts) > 2}
    assert folders == {layer.split(".")[0] for layer in LAYERS}
    assert {file.name for file in (ROOT / "robocorba").glob("*.py")} == {"__init__.py", "__main__.py"}


def test_rooms_import_what_lies_below() -> None:
    def layer(module: str) -> str:
        parts = module.split(".")[1:]
        return found if (found := ".".join(parts[:2])) in LAYERS else parts[0]

    between = {(layer(one), layer(other)): (one, other) for one, other in arrows(OURS).edges if "__main__" not in one}
    upward = {
        modules
        for (one, other), modules in between.items()
        if LAYERS.index(one) < LAYERS.index(other) or (one != other and one not in IMPORTED_BY.get(other, {one}))
    }
    assert upward == set()
    for room, others in IMPORTED_BY.items():
        assert {one for one, other in between if other == room} == {room, *others}


def test_one_place_escapes_what_programs_print_and_one_decodes_into_types() -> None:
    printers = {file.relative_to(ROOT).as_posix(): file for file in sources("robocorba", "clients").values()}
    found = {path: prints(file.read_text()) for path, file in printers.items() if path.startswith(PRINTERS)}
    assert {path for path, past in found.items() if past} == set(PRINTING_NOTHING_FOREIGN)
    assert prints("from rich.console import Console\nprint(1)") == ["print", "rich.console.Console"]
    assert prints("sys.exit(f'{name} fails')") == ["sys.exit"]
    past = {file.relative_to(ROOT).as_posix(): decodes(file.read_text()) for file in PRODUCT.values()}
    assert {path for path, calls in past.items() if calls} == {"robocorba/system/decoding.py"}
    assert decodes("msgspec.json.decode(a)\nmsgspec.convert(a, T)") == ["msgspec.convert"]
    assert decodes("msgspec.msgpack.decode(a, type=T)") == ["msgspec.msgpack.decode"]


def test_tests_wait_for_conditions_and_suppress_no_assertion() -> None:
    """But for what tests/waits.py names."""
    sleeping = [
        file.relative_to(ROOT).as_posix()
        for file in sources("tests").values()
        if not file.stem.endswith(PROGRAMS_OF_TESTS)
        and "time.sleep" in {ast.unparse(call.func) for call in called(file.read_text(), "sleep")}
    ]
    assert sleeping == ["tests/waits.py"]
    # An assertion after what raises within `suppress` is not reached.
    assert [file for file in sources("tests").values() if suppresses_assertions(file.read_text())] == []
    assert suppresses_assertions("with a, contextlib.suppress(E):\n    f()\n    assert x")
    assert not suppresses_assertions("with suppress(E):\n    f()\nassert x")


def test_one_place_starts_threads() -> None:
    found = {file.relative_to(ROOT).as_posix(): starts_threads(file.read_text()) for file in PRODUCT.values()}
    outside = {path for path, ways in found.items() if ways and not path.startswith("testkit/")}
    assert outside == set(THREADS_ELSEWHERE)
    pools = {path for path in outside if found[path] == ["ThreadPoolExecutor"]}
    assert outside - pools == {"robocorba/system/background.py", "clients/demo.py"}
    assert starts_threads("import threading\nthreading.Thread(target=f).start()") == ["Thread"]
    assert starts_threads("class A(Thread): pass\nTimer(1.0, f)") == ["Thread", "Timer"]
    assert starts_threads("threading.current_thread()\na: threading.Thread") == []


def test_imports_have_no_circles() -> None:
    modules = arrows(ALL)
    folders = nx.DiGraph((folder(one, ALL), folder(other, ALL)) for one, other in modules.edges)
    folders.remove_edges_from(list(nx.selfloop_edges(folders)))
    for graph in (modules, folders):
        assert [sorted(circle) for circle in nx.strongly_connected_components(graph) if len(circle) > 1] == []
    # But for the tests of the benches themselves.
    between = [
        (one, other)
        for one, other in arrows(ALL).edges
        if {one.split(".")[0], other.split(".")[0]} == {"bench", "tests"}
    ]
    assert [(one, other) for one, other in between if not one.startswith("tests.bench.")] == []


@pytest.mark.parametrize(
    ("path", "text", "fault"),
    [
        ("map_editor/x.py", "from omniORB import CORBA", "domain code imports omniORB.CORBA"),
        ("errors/x.py", "import CosNaming", "domain code imports CosNaming"),
        ("planning/x.py", "def f():\n    from robocorba.orb import orb", "domain code imports robocorba.orb.orb"),
        ("planning/x.py", "from .. import orb", "domain code imports robocorba.orb"),
        ("map_editor/formats/x.py", "from ...orb.a import b", "domain code imports robocorba.orb.a.b"),
        ("planning/x.py", "from .corba.a import b", "domain code imports robocorba.planning.corba.a.b"),
        ("planning/x.py", "import robocorba.commands.up as u", "domain code imports robocorba.commands.up"),
        ("map_editor/x.py", "from robocorba.planning.x import A", "domain code imports robocorba.planning.x.A"),
        ("map_editor/spatial/x.py", "from robocorba.map_editor import x", "domain code imports robocorba.map_editor.x"),
        ("events/x.py", "from a import cached_property", "uses cached_property, whose lock"),
        ("events/corba/x_servant.py", "from robocorba.events.corba import remote_y", "a servant imports"),
        ("events/corba/x_servants.py", "from .y_servant import Z", "a servant imports"),
        ("robot/corba/x_servant.py", "import robocorba.orb.naming", "a servant imports robocorba.orb.naming"),
        ("robot/corba/x_servant.py", "orb.resolve('PathPlanner', P)", "a servant uses resolve"),
        ("robot/corba/x_servant.py", "from sys import argv", "a servant uses argv"),
        ("system/logs.py", "from servers import map_editor", "imports the program servers.map_editor"),
        ("commands/x.py", "import robocorba.clients.demo", "imports the program robocorba.clients.demo"),
        ("errors/x.py", "from tests.map_editor import buildings", "imports the program tests.map_editor.buildings"),
        ("system/x.py", "from robocorba.stubs import R", "imports robocorba.stubs.R, which orb/ is for"),
        ("console/x.py", "from omniORB import CORBA", "imports omniORB.CORBA, which orb/ is for"),
        ("commands/x.py", "CORBA.ORB_init([])", "starts an ORB, which robocorba.orb.orb is for"),
        ("system/logs.py", "import os\nos.environ['HOME']", "reads the environment by environ"),
        ("system/logs.py", "from os import getenv", "reads the environment by getenv"),
        ("system/logs.py", "f('ROBOCORBA_STATE')", "knows ROBOCORBA_STATE, which robocorba.system.settings is for"),
        # What is allowed:
        ("map_editor/x.py", "from robocorba.map_editor.model import Wall\nimport robocorba.errors.base", ""),
        ("map_editor/x.py", "'not omniORB'  # import omniORB", ""),
        ("planning/x.py", "from robocorba.system.kernels import kernel", ""),
        ("planning/corba/x_servant.py", "from robocorba.stubs import A\nfrom robocorba.orb import structs", ""),
        ("orb/orb.py", "from omniORB import CORBA\nCORBA.ORB_init([])", ""),
        ("system/settings.py", "import os\nos.environ['ROBOCORBA_STATE']", ""),
        ("commands/x.py", "option(help='The state folder [ROBOCORBA_STATE].')\nimport testsuite", ""),
    ],
)
def test_each_rule_can_be_broken(path: str, text: str, fault: str) -> None:
    found = faults(f"robocorba/{path}", text)
    assert any(each.startswith(fault) for each in found) if fault else found == []
