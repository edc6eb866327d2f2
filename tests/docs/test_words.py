"""Help texts, messages and pages have plain words: none of those that readers stumbled over, and helps are short."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from typing import Any

import typer

from robocorba.commands import command
from tests.docs.test_documents import PAGES
from tests.test_budget import modules

#: What needs a second reading, and what to write instead.
STUMBLES = {
    r"but for|apart from": "except",
    r"in place of": "instead of, or `replacing it`",
    r"all the same": "still",
    r"go(es)? on": "continue",
    r"(is|are|do|does|leads?) no more": "no longer",
    r"former": "previous",
    r"(has|have|had) not(?! \w+(ed|en|n|t)\b)": "lacks, has no",
    r"somebody|anybody|nobody (has|knows|waits|looks|reads?)": "the one that acts: a robot, another client, a person",
    r"(by|of|in|with|than|from|as) (that|those) of": "the noun again",
    r"(?:^|[.;:(|] |\*\*)who (has|is|reaches|reads|serves)": "a client that, the holder",
    r"(that|which|who)\b[^.;:|,()]{1,40}\b(that|which|who)\b[^.;:|,()]{1,40}\b(that|which|who)": "two sentences",
    r"so (many|long|often)": "the number, or the option's letter",
    r"not (while|those)": "a verb",
    r"with another content": "that differs",
}
#: An option's help is an imperative or the thing to give, with its unit and default at the end.
_POOR_STARTS = re.compile(r"(The|An?|Its?|Their|Such|By|As|Those|Not|Whether|What|That)\b")
_CODE = re.compile(r"^(```.*?^```|    .*?)$|`[^`\n]*`", re.DOTALL | re.MULTILINE)


def helps() -> Iterator[tuple[str, str]]:
    """The words that name a command or a parameter, and its help, of all commands."""
    waiting: list[tuple[str, Any]] = [("robocorba", typer.main.get_command(command()))]
    for words, each in waiting:
        waiting += [(f"{words} {name}", one) for name, one in getattr(each, "commands", {}).items()]
        yield words, each.help or ""
        for option in each.params:
            if "completion" not in option.name:  # the library's own
                yield f"{words} {option.opts[-1]}", option.help or ""


def messages() -> Iterator[tuple[str, str]]:
    """Module and texts of the constants of the package that are no docstrings."""
    for file, tree in modules().items():
        nodes = list(ast.walk(tree))
        silent = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        texts = (node.value for node in nodes if isinstance(node, ast.Constant) and id(node) not in silent)
        yield file.stem, "\n|".join(text for text in texts if isinstance(text, str) and " " in text)


def stumbles(text: str) -> list[str]:
    return [
        f"{found[0]!r}: write {instead}"
        for pattern, instead in STUMBLES.items()
        for found in re.finditer(rf"(?<![\w-])(?:{pattern})(?![\w-])", text, re.IGNORECASE | re.MULTILINE)
    ]


def test_pages_and_messages_have_plain_words() -> None:
    pages = [(page.name, _CODE.sub("", page.read_text()).replace("\n", " ")) for page in PAGES]
    assert [(where, found) for where, text in (*pages, *messages()) if (found := stumbles(text))] == []


def test_helps_have_plain_words_and_at_most_two_sentences() -> None:
    for words, text in helps():
        sentences = re.findall(r"[^.]\.(?: |$)", text.split("\n\n")[0])
        assert 0 < len(sentences) <= 2 and not _POOR_STARTS.match(text) and "[default" not in text, (words, text)
        assert stumbles(text) == [], words
