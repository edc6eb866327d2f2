"""What a foreign channel gives back is recognised, as often as it was pushed."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from robocorba.events.foreign import Echoes


@given(st.lists(st.tuples(st.booleans(), st.sampled_from("abc")), max_size=60))
def test_each_push_is_recognised_once(steps: list[tuple[bool, str]]) -> None:
    echoes, open_pushes = Echoes(), Counter[str]()
    for is_push, content in steps:
        if is_push:
            echoes.expect(content)
            open_pushes[content] += 1
        else:
            assert echoes.recognise(content) == (open_pushes[content] > 0)
            open_pushes[content] = max(0, open_pushes[content] - 1)


def test_an_expected_echo_is_forgotten_after_its_time() -> None:
    echoes = Echoes(echo_s=-1.0)
    echoes.expect("a")
    assert not echoes.recognise("a")


def test_the_number_of_expected_echoes_is_bounded() -> None:
    echoes = Echoes(max_echoes=10)
    for number in range(30):
        echoes.expect(number)
    assert [number for number in range(30) if echoes.recognise(number)] == list(range(20, 30))


def test_repeated_contents_are_recognised_each_time() -> None:
    echoes = Echoes(max_echoes=10)
    for _ in range(30):
        echoes.expect("alive")
        assert echoes.recognise("alive")
        assert not echoes.recognise("alive")
