"""Digests of kernels: of a kernel's own source and of all that it is compiled from.

A kernel is compiled from its function and from the functions, classes and constants that these name, in all modules of
the package. Its digest is that of their syntax trees, so other edits of the same modules, comments and docstrings keep
the compiled kernel. Where it is unclear what a module does, more is taken in than necessary.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

#: Length of a digest in file names [hexadecimal digits]; 80 bits distinguish all versions ever made.
DIGITS = 20
_DECORATOR = "kernel"
#: Folder of generated modules, which no kernel is compiled from.
_GENERATED = "stubs"
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class KernelSource(NamedTuple):
    """What a kernel is compiled from: its digest, and the size of all its functions [characters of a syntax tree]."""

    digest: str
    size: int


#: A module and a name that it defines; None for all names.
_Part = tuple[str, "str | None"]


def kernel_sources(root: Path, environment: str = "") -> dict[str, KernelSource]:
    """The source of each kernel, such as "robocorba.planning.packing.rows", of the package in the folder `root`.

    environment: what else kernels depend on, such as the version of the compiler."""
    package = _Package(root)
    found = {}
    for path in _sources(root):
        if f"@{_DECORATOR}\n" not in path.read_text():
            continue
        module = package.name_of(path)
        for name in package.module(module).kernels:
            found[f"{module}.{name}"] = package.source(module, name, environment)
    return found


def sources_digest(root: Path) -> str:
    """Digest of all sources of the package in the folder `root`: while it is the same, so are those of the kernels."""
    digest = hashlib.sha256()
    for path in _sources(root):
        digest.update(f"{path.relative_to(root)}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:DIGITS]


def _sources(root: Path) -> list[Path]:
    found = []
    for folder, folders, names in os.walk(root):
        folders[:] = [name for name in folders if name not in (_GENERATED, "__pycache__")]
        found += [Path(folder, name) for name in names if name.endswith(".py")]
    return sorted(found)


class _Package:
    """The modules of a package, parsed when they are needed."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._modules: dict[str, _Module] = {}

    def name_of(self, path: Path) -> str:
        parts = [self._root.name, *path.relative_to(self._root).with_suffix("").parts]
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    def module(self, name: str) -> _Module:
        if name not in self._modules:
            path = self._path(name)
            self._modules[name] = _Module(name, ast.parse(path.read_text() if path else ""), self)
        return self._modules[name]

    def contains(self, module: str) -> bool:
        return self._path(module) is not None

    def source(self, module: str, name: str, environment: str) -> KernelSource:
        statements = list(self.closure((module, name)))
        texts = sorted({f"{part}: {statement.text}" for part, statement in statements})
        digest = hashlib.sha256("\n".join([f"{module}.{name}", environment, *texts]).encode())
        size = sum(len(statement.text) for _, statement in statements if statement.is_function)
        return KernelSource(digest.hexdigest()[:DIGITS], size)

    def closure(self, first: _Part) -> Iterator[tuple[str, _Statement]]:
        """All statements that a part depends on, each with the name of its module."""
        waiting, seen = [first], {first}
        while waiting:
            module, name = waiting.pop()
            if module == f"{self._root.name}.{_DECORATOR}s":
                continue  # what it does to kernels is part of their environment
            parts, statements = self.module(module).needed_for(name)
            yield from ((module, statement) for statement in statements)
            for part in parts - seen:
                seen.add(part)
                waiting.append(part)

    def _path(self, module: str) -> Path | None:
        package, *names = module.split(".")
        if package != self._root.name:
            return None
        path = self._root.joinpath(*names)
        return next((file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file()), None)


class _Statement:
    """A statement at the top level of a module."""

    def __init__(self, node: ast.stmt) -> None:
        self._node = node
        self.is_function = isinstance(node, _FUNCTIONS)

    @cached_property
    def text(self) -> str:
        """What it is, whatever its layout."""
        return ast.dump(self._node)

    @cached_property
    def names(self) -> frozenset[str]:
        """The names that it uses."""
        return frozenset(node.id for node in ast.walk(self._node) if isinstance(node, ast.Name))


class _Module:
    """What a module's top-level statements define. kernels: names of its kernels."""

    def __init__(self, name: str, tree: ast.Module, package: _Package) -> None:
        self._name, self._package = name, package
        self._definitions: dict[str, list[_Statement]] = defaultdict(list)
        self._imports: dict[str, set[_Part]] = defaultdict(set)
        #: Statements that may change any of the names: needed for all.
        self._others: list[_Statement] = []
        self.kernels: list[str] = []
        _remove_docstrings(tree)
        for statement in tree.body:
            self._add(statement)

    def needed_for(self, name: str | None) -> tuple[set[_Part], list[_Statement]]:
        """What one of its names needs, None for all names: other parts, and statements of this module."""
        names: Iterable[str] = [*self._definitions, *self._imports] if name is None else [name]
        statements = [*self._others]
        parts: set[_Part] = set()
        for each in names:
            statements += self._definitions.get(each, ())
            parts |= self._imports.get(each, set())
        parts |= self._imports.get("*", set())  # names may come from there
        used = frozenset[str]().union(*(statement.names for statement in statements))
        parts |= {(self._name, each) for each in used if each in self._definitions or each in self._imports}
        return parts, statements

    def _add(self, statement: ast.stmt) -> None:
        if isinstance(statement, (*_FUNCTIONS, ast.ClassDef)):
            self._definitions[statement.name].append(_Statement(statement))
            if any(isinstance(each, ast.Name) and each.id == _DECORATOR for each in statement.decorator_list):
                self.kernels.append(statement.name)
        elif isinstance(statement, (ast.Import, ast.ImportFrom)):
            self._add_import(statement)
        elif names := _assigned(statement):
            for name in names:
                self._definitions[name].append(_Statement(statement))
        elif not _is_main(statement):
            self._others.append(_Statement(statement))
            for node in ast.walk(statement):
                if isinstance(node, (ast.Import, ast.ImportFrom)):
                    self._add_import(node)

    def _add_import(self, statement: ast.Import | ast.ImportFrom) -> None:
        for alias in statement.names:
            bound = alias.asname or alias.name.partition(".")[0]
            if isinstance(statement, ast.Import):
                part: _Part = (alias.name, None)
            else:
                source = self._absolute(statement)
                submodule = f"{source}.{alias.name}"
                part = (submodule, None) if self._package.contains(submodule) else (source, alias.name)
                if alias.name == "*":
                    part = (source, None)
            if self._package.contains(part[0]):
                self._imports[bound].add(part)
            else:  # of another package, whose version counts
                self._definitions[bound].append(_Statement(statement))

    def _absolute(self, statement: ast.ImportFrom) -> str:
        """The module that names are imported from."""
        if not statement.level:
            return statement.module or ""
        is_package = self._package.contains(f"{self._name}.__init__")
        parts = self._name.split(".")
        parts = parts[: len(parts) - statement.level + is_package]
        return ".".join([*parts, *filter(None, [statement.module])])


def _assigned(statement: ast.stmt) -> list[str]:
    """The names that a plain assignment defines; empty for other statements."""
    if isinstance(statement, ast.AnnAssign):
        targets: list[ast.expr] = [statement.target]
    elif isinstance(statement, ast.Assign):
        targets = statement.targets
    else:
        return []
    flat = [each for target in targets for each in (target.elts if isinstance(target, ast.Tuple) else [target])]
    names = [each.id for each in flat if isinstance(each, ast.Name)]
    return names if len(names) == len(flat) else []


def _is_main(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.If) and "__name__" in ast.dump(statement.test)


def _remove_docstrings(tree: ast.Module) -> None:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, *_FUNCTIONS)):
            node.body = [each for each in node.body if not _is_text(each)]


def _is_text(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
