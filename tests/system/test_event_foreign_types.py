"""Events of types that the channel has no stubs for."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.event_place import Place, open_place

pytestmark = [pytest.mark.system, pytest.mark.full]

CLIENT = (sys.executable, str(Path(__file__).with_name("event_types_client.py")))
TYPES = (
    "struct", "union", "enum", "recursive", "sequence", "array", "exception", "wstring", "octets", "fixed", "string",
    "double", "any", "typecode", "null", "object reference", "nil", "valuetype", "no value", "value ring",
    "derived value",
)  # fmt: skip
WAYS = ("pushed", "with header", "pulled")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    with pytest.MonkeyPatch.context() as patch, open_place(tmp_path_factory.mktemp("types")) as place:
        patch.setenv("ROBOCORBA_VALUETYPES", "1")
        place.start("lab")
        yield place


@pytest.fixture(scope="module")
def outcomes(place: Place) -> dict[tuple[str, str], str]:
    """By type and way, what the client says of what came."""
    client = place.launch(*CLIENT, place.uri("lab"))
    out, err = client.communicate(timeout=120)
    assert client.returncode == 0, err
    lines = [line.split(": ", 2) for line in out.splitlines()]
    return {(type, way): rest[0] if rest else "" for type, way, *rest in lines}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("type", TYPES)
def test_a_value_comes_unchanged(outcomes: dict[tuple[str, str], str], type: str, way: str) -> None:
    assert outcomes[type, way] == "same"


def test_a_value_that_is_more_than_its_type_says_is_cut_as_its_idl_allows(
    outcomes: dict[tuple[str, str], str],
) -> None:
    for way in WAYS:
        assert outcomes["derived value as its base", way].endswith("('Tag', [('name', 'a'), ('number', 1)]))")


def test_a_boxed_value_which_needs_stubs_is_refused(outcomes: dict[tuple[str, str], str]) -> None:
    assert outcomes["boxed value", "refused"].startswith("CORBA.MARSHAL")


def test_the_channel_has_an_account_of_all(place: Place, outcomes: dict[tuple[str, str], str]) -> None:
    assert place.balanced_states("lab")
