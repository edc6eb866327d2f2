"""Each tutorial of docs/, followed as its reader does: types its commands into terminals, saves its files, compares
what is printed.

What counts in a tutorial are its fenced blocks, from the first to the last:

- ```sh: commands for the first terminal; each must succeed. `terminal=NAME` is another one. `stays`: the last command
  runs on, until ^C, a line of a later block, ends it. `elsewhere`: another test runs it, or it needs a browser.
- ```text: what the block before it prints, or `terminal=NAME` since its last block, among other lines, in this order;
  ... matches anything.
- any other with `file=NAME`: a file of that name is saved with this content.

The reader waits with patience: LIMIT_S for each command and each line."""

from __future__ import annotations

import contextlib
import functools
import os
import re
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pexpect
import psutil
import pytest

from robocorba.system.claimed_ports import claimed_ports
from testkit.actual_robot import running_stand_in
from testkit.namespaces import Namespace

#: Time limit for a command, and for each line that it prints [s]; for the end of what Ctrl-C has interrupted.
LIMIT_S, END_S = 150.0, 60.0
FIRST = "first"
TUTORIALS = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
#: The shell's prompt, with the exit code of the command before it.
PROMPT = re.compile(r"tutorial-(\d+)> ")
#: What terminals make of output.
_CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]|\r")
_TITLE = re.compile(r"^## ([^\n]+)$", re.MULTILINE)
_BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block. line: number of its first line in the page."""

    language: str
    words: dict[str, str]
    content: str
    line: int

    @property
    def terminal(self) -> str:
        return self.words.get("terminal", FIRST)

    @property
    def commands(self) -> list[str]:
        """One a line, without comments; a line that ends with a backslash continues on the next one."""
        joined = re.sub(r"\\\n\s*", "", self.content)
        return [re.sub(r"\s+# .*", "", line).strip() for line in joined.splitlines() if line.strip()]


def sections(page: Path) -> dict[str, list[Block]]:
    """The blocks of each section of a page, by its title; what is before the first one has none."""
    text = page.read_text()
    found: dict[str, list[Block]] = {}
    titles = [(match.start(), match[1]) for match in _TITLE.finditer(text)]
    for match in _BLOCK.finditer(text):
        _, title = max(((start, title) for start, title in titles if start < match.start()), default=(0, ""))
        words = dict(word.partition("=")[::2] for word in match[2].split())
        line = text.count("\n", 0, match.start()) + 2
        found.setdefault(title, []).append(Block(match[1], words, match[3], line))
    return found


class Reader:
    """Follows a page in an empty folder. Use it in a `with`.

    environment: of the terminals. elsewhere: prefixes that run the shell of a terminal on another machine, by the name
    of the terminal. options: what the reader types in place of some options, such as for a port that is not free."""

    def __init__(
        self,
        page: Path,
        folder: Path,
        environment: Mapping[str, str],
        elsewhere: Mapping[str, Sequence[str]] = MappingProxyType({}),
        options: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._page, self._folder, self._environment = page, folder, environment
        self._elsewhere, self._options = elsewhere, options
        self._left = sections(page)
        self._is_lost = False
        self._terminals: dict[str, Terminal] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def follow(self, until: str = "") -> None:
        """Follow all sections up to one, or to the last, that were not followed yet."""
        assert not self._is_lost, "a section before failed"
        self._is_lost = True
        for title in list(self._left):
            self._follow(self._left.pop(title))
            if title == until:
                break
        self._is_lost = False

    def _follow(self, section: Sequence[Block]) -> None:
        last: Terminal | None = None
        for block in section:
            where = f"{self._page.name}:{block.line}"
            if block.language == "sh" and "elsewhere" in block.words:
                last = None
            elif block.language == "sh":
                for option, own in self._options.items():
                    block = block._replace(content=block.content.replace(option, own))
                if block.terminal not in self._terminals:
                    prefix = self._elsewhere.get(block.terminal, ())
                    opened = self._stack.enter_context(terminal(self._folder, self._environment, prefix))
                    self._terminals[block.terminal] = opened
                last = self._terminals[block.terminal]
                last.type(block, where)
            elif block.language == "text" and (printing := self._terminals.get(block.words.get("terminal", ""), last)):
                printing.expect(block.content, where)
            elif "file" in block.words:
                file = self._folder / block.words["file"]
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(block.content)


class Terminal:
    """A shell."""

    def __init__(self, shell: pexpect.spawn[str]) -> None:
        self._shell = shell
        self._printed = ""
        self._runs_on = False

    def type(self, block: Block, where: str) -> None:
        """Type commands, and wait for each but one that stays."""
        self._printed = ""
        commands = block.commands
        for number, command in enumerate(commands):
            if command == "^C":
                self._shell.sendintr()
                self._wait(where, command, END_S)
                continue
            assert not self._runs_on, f"{where}: something runs in this terminal; end it by ^C first"
            self._shell.sendline(command)
            if "stays" in block.words and number == len(commands) - 1:
                self._runs_on = True
                return
            code = self._wait(where, command, LIMIT_S)
            assert code == 0, f"{where}: {command}\nexit code {code}\n{self._printed}"

    def expect(self, wanted: str, where: str) -> None:
        """What was printed since the last block has these lines."""
        end = 0
        for number, line in enumerate(filter(str.strip, wanted.splitlines())):
            pattern = re.compile(pattern_of(line))
            while not (found := pattern.search(self._printed, end)):
                assert self._runs_on, f"{where}+{number}: {line!r} was not printed, but\n{self._printed[end:]}"
                self._read(f"{where}+{number}: {line!r} was not printed")
            end = found.end()

    def close(self) -> None:
        """End what runs here."""
        with contextlib.suppress(psutil.NoSuchProcess):
            children = psutil.Process(self._shell.pid).children(recursive=True)
            for child in children:
                with contextlib.suppress(psutil.NoSuchProcess):
                    child.send_signal(signal.SIGINT)
            for child in psutil.wait_procs(children, END_S)[1]:
                child.kill()
        self._shell.close(force=True)

    def _wait(self, where: str, command: str, limit_s: float) -> int:
        """Wait for the prompt; returns the exit code."""
        index = self._shell.expect([PROMPT, pexpect.TIMEOUT, pexpect.EOF], timeout=limit_s)
        self._printed += _CONTROL.sub("", self._shell.before or "")
        assert index == 0, f"{where}: {command} has not ended\n{self._printed}"
        self._runs_on = False
        return int(self._shell.match[1])

    def _read(self, complaint: str) -> None:
        """Read one more line of what runs on, or that it has ended."""
        index = self._shell.expect([PROMPT, r"[^\n]*\n", pexpect.TIMEOUT, pexpect.EOF], timeout=LIMIT_S)
        self._printed += _CONTROL.sub("", (self._shell.before or "") + (self._shell.after if index == 1 else ""))
        assert index <= 1, f"{complaint}, but\n{self._printed}"
        self._runs_on = index == 1


@contextmanager
def terminal(folder: Path, environment: Mapping[str, str], prefix: Sequence[str]) -> Iterator[Terminal]:
    """A shell in a folder. It knows no more of this process's environment than what it is given."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME", "NUMBA_CACHE_DIR") if name in os.environ}
    kept["PATH"] = f"{Path(sys.executable).parent}:{kept['PATH']}"
    clean = {
        **kept,
        "LANG": "C.UTF-8",
        "TERM": "xterm",
        "ROBOCORBA_STATE": str(folder / "default-state"),
        **environment,
    }
    command = [*prefix, "bash", "--norc", "--noprofile"]
    shell: pexpect.spawn[str] = pexpect.spawn(
        command[0],
        command[1:],
        cwd=str(folder),
        env=clean,  # type: ignore[arg-type]
        encoding="utf-8",
        codec_errors="replace",
        dimensions=(50, 200),
        echo=False,
    )
    shell.delaybeforesend = None
    opened = Terminal(shell)
    try:
        shell.sendline("PS1='tutorial-$?> ' PS2=''")
        shell.expect(PROMPT, timeout=END_S)
        yield opened
    finally:
        opened.close()


def pattern_of(line: str) -> str:
    """The regular expression of a line of which ... stands for anything, and which may be spaced differently."""
    parts = [r"\s+".join(map(re.escape, part.split())) for part in line.strip().split("...")]
    return r"[^\n]*".join(parts)


# ---- the pages ----

#: Another system on this machine has the console's port.
CONSOLE = {"--console ": "--console --console-port 0 "}
#: The reader installs a package; here it goes into a folder of the test, not into the suite's environment.
INSTALLED_ALONE = "--quiet --disable-pip-version-check --no-build-isolation --no-deps"


@contextmanager
def one_machine(page: Path, folder: Path) -> Iterator[Reader]:
    plugins = folder / "plugins"
    options = {**CONSOLE, "--quiet .": f"{INSTALLED_ALONE} --target {plugins} ."}
    (folder / "reader").mkdir()
    with claimed_ports() as port:
        environment = {"ROBOCORBA_NAMING": f"127.0.0.1:{port}", "PYTHONPATH": str(plugins)}
        with Reader(page, folder / "reader", environment, options=options) as reader:
            yield reader


@contextmanager
def two_machines(page: Path, folder: Path) -> Iterator[Reader]:
    try:
        one, two = Namespace(), Namespace()
    except OSError as error:
        pytest.skip(f"needs network namespaces: {error}")
    with one, two:
        one.ip("link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", two.path)
        for number, machine in enumerate((one, two), 1):
            machine.ip("address", "add", f"10.60.0.{number}/24", "dev", "eth0")
            machine.ip("link", "set", "eth0", "up")
        terminals = {"one": one.command(), "listener": one.command(), "two": two.command()}
        with Reader(page, folder, {}, terminals) as reader:
            yield reader


@contextmanager
def real_smartpal(page: Path, folder: Path) -> Iterator[Reader]:
    """The stand-in is the robot."""
    with running_stand_in(folder / "robot") as robot, claimed_ports() as port:
        (folder / "reader").mkdir()
        options = {"192.168.4.211:5005": str(robot.naming)}
        with Reader(page, folder / "reader", {"ROBOCORBA_NAMING": f"127.0.0.1:{port}"}, options=options) as reader:
            yield reader


#: Each page, and the machines of its reader.
PAGES = dict.fromkeys(TUTORIALS.glob("*.md"), one_machine) | {
    TUTORIALS / "two-machines.md": two_machines,
    TUTORIALS.parent / "real-smartpal.md": real_smartpal,
}


#: The longest page has a file of tests of its own.
LONGEST = TUTORIALS / "first-hour.md"


@contextmanager
def open_readers(factory: pytest.TempPathFactory) -> Iterator[Callable[[Path], Reader]]:
    """The reader of each page, who begins when first asked for."""
    with ExitStack() as stack:

        @functools.cache
        def reader(page: Path) -> Reader:
            return stack.enter_context(PAGES[page](page, factory.mktemp(page.stem)))

        yield reader


def params(pages: Iterable[Path]) -> list[Any]:
    """Each section of pages, for a test of `page` and `section`."""
    return [pytest.param(page, title, id=f"{page.stem}-{title}") for page in pages for title in sections(page)]
