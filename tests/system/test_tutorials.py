"""The tutorials of docs/ but the longest, each followed as its reader does: see tutorial_reader.py."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.system.tutorial_reader import LONGEST, PAGES, Reader, open_readers, params

pytestmark = [pytest.mark.system, pytest.mark.slow(180), pytest.mark.full]


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[Path], Reader]]:
    with open_readers(tmp_path_factory) as reader:
        yield reader


@pytest.mark.parametrize(("page", "section"), params(sorted(PAGES.keys() - {LONGEST})))
def test_the_reader_gets_to_the_end(readers: Callable[[Path], Reader], page: Path, section: str) -> None:
    readers(page).follow(section)
