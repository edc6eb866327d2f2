"""How much there is of everything: the numbers may only fall. A change that makes something smaller lowers its number.
Only a part that was promised and missing may raise it: last instances, robocorba.toml, SRDF, a course, advice about
federations, and what the console keeps and how it drives robots."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: What the package may have at most; what was measured, rounded up.
AT_MOST = {
    "lines of code": 52_975,
    "classes": 977,
    "upper-case names of modules": 1_074,
    "kernels": 66,
    "functions compiled within kernels": 76,
    "protocols": 24,
    "modules at the root": 2,
    "rooms": 12,
}
#: Lines in all of Python outside the package and of the console's JavaScript, and words of documentation.
LINES_AT_MOST = {"tests": 53_083, "testkit": 7_076, "bench": 7_934, "robocorba/console/static": 11_860}
WORDS_AT_MOST = {"docs": 31_970, "README.md": 854, "CHANGELOG.md": 1_768}


@functools.cache
def modules() -> dict[Path, ast.Module]:
    """The package's modules without those that omniidl makes."""
    files = (ROOT / "robocorba").rglob("*.py")
    return {file: ast.parse(file.read_text()) for file in sorted(files) if "stubs" not in file.parts}


def code_lines(file: Path, tree: ast.Module) -> int:
    """Lines that are neither blank nor a comment nor of a docstring."""
    docstrings = {line for node in ast.walk(tree) for line in docstring_lines(node)}
    lines = enumerate(file.read_text().splitlines(), 1)
    return sum(bool(line.strip()) and line.strip()[0] != "#" and number not in docstrings for number, line in lines)


def docstring_lines(node: ast.AST) -> range:
    if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
        first = node.body[:1] if ast.get_docstring(node) is not None else []
        return range(first[0].lineno, (first[0].end_lineno or 0) + 1) if first else range(0)
    return range(0)


def upper_case_names(tree: ast.Module) -> Iterator[str]:
    for node in tree.body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = (name for target in targets for name in ast.walk(target))
            yield from (name.id for name in names if isinstance(name, ast.Name) and name.id.isupper())


@functools.cache
def measured() -> dict[str, int]:
    trees = modules().values()
    classes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    functions = (node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))
    marks = [ast.unparse(mark) for function in functions for mark in function.decorator_list]
    package = ROOT / "robocorba"
    folders = [folder for folder in package.iterdir() if folder.name != "stubs" and not folder.is_symlink()]
    return {
        "lines of code": sum(code_lines(file, tree) for file, tree in modules().items()),
        "classes": len(classes),
        "upper-case names of modules": sum(1 for tree in trees for _ in upper_case_names(tree)),
        "kernels": marks.count("kernel"),
        "functions compiled within kernels": marks.count("inner_kernel"),
        "protocols": sum(any(ast.unparse(base) == "Protocol" for base in node.bases) for node in classes),
        "modules at the root": len(list(package.glob("*.py"))),
        "rooms": sum((room / "__init__.py").exists() for room in folders),
    }


@pytest.mark.parametrize("what", AT_MOST)
def test_the_package_only_gets_smaller(what: str) -> None:
    assert measured()[what] <= AT_MOST[what]


@pytest.mark.parametrize("folder", LINES_AT_MOST)
def test_what_lies_beside_the_package_only_gets_smaller(folder: str) -> None:
    files = [file for suffix in ("py", "js") for file in (ROOT / folder).rglob(f"*.{suffix}")]
    lines = {file: len(file.read_text().splitlines()) for file in files}
    assert sum(lines.values()) <= LINES_AT_MOST[folder]
    assert not [file.name for file, count in lines.items() if file.suffix == ".js" and count >= 300]


@pytest.mark.parametrize("name", WORDS_AT_MOST)
def test_the_documentation_only_gets_shorter(name: str) -> None:
    pages = (ROOT / name).rglob("*.md") if (ROOT / name).is_dir() else [ROOT / name]
    assert sum(len(page.read_text().split()) for page in pages) <= WORDS_AT_MOST[name]
