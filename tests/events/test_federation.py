"""The advertisements of channels: versions, links and bounds, and which of them a peer lacks."""

from __future__ import annotations

import itertools
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocorba.errors.events import InvalidPeer
from robocorba.events.federation import Advertisement, Federation, KnownAdvertisements, check_name
from robocorba.events.subscription import Pattern

WANTS_T = (Pattern("t"),)


def advertisement(name: str, version: int, *peers: str, interest: tuple[Pattern, ...] = WANTS_T) -> Advertisement:
    return Advertisement(name, version, peers, interest)


def test_a_link_that_is_down_is_used_only_where_there_is_no_other_way() -> None:
    """In a ring: lab - hall - yard - attic - lab."""
    lab = Federation("lab")
    lab.advertise(["attic", "hall"], ())
    neighbours = {"hall": ("lab", "yard"), "yard": ("attic", "hall"), "attic": ("lab", "yard")}
    lab.learn([advertisement(name, 1, *peers) for name, peers in neighbours.items()])
    lab.learn([advertisement("attic", 2, "lab", "yard")._replace(down=("yard",))])
    assert lab.ways("t", "s", "lab") == {"attic": ["attic"], "hall": ["hall", "yard"]}
    assert lab.advertise(["attic", "hall"], (), down=["hall"])
    # Each of both ways to the yard has a link that is down.
    assert lab.ways("t", "s", "lab") == {"attic": ["attic", "yard"], "hall": ["hall"]}
    lab.learn([advertisement("attic", 3, "lab", "yard")])
    assert lab.ways("t", "s", "lab") == {"attic": ["attic", "yard", "hall"]}
    assert lab.advertise(["attic", "hall"], ())
    assert lab.ways("t", "s", "lab") == {"attic": ["attic", "yard"], "hall": ["hall"]}


def test_a_link_needs_both_ends_and_an_unreachable_channel_is_ignored_until_it_is_reachable_again() -> None:
    lab = Federation("lab")
    lab.advertise(["hall"], ())  # which has not advertised yet
    lab.learn([advertisement("hall", 1, "lab", "yard", interest=()), advertisement("yard", 1)])
    assert "hall" not in lab.ways("t", "s", "lab")  # the yard knows of no link
    lab.learn([advertisement("yard", 2, "hall")])
    assert "hall" in lab.ways("t", "s", "lab")
    lab.learn([advertisement("hall", 2, "lab", interest=())])
    assert [n.name for n in lab.advertisements] == ["lab", "hall"]
    assert "hall" not in lab.ways("t", "s", "lab")
    # Only the hall has sent an advertisement, the yard has not.
    lab.learn([advertisement("hall", 3, "lab", "yard", interest=())])
    assert [n.name for n in lab.advertisements] == ["lab", "hall", "yard"]
    assert "hall" in lab.ways("t", "s", "lab")


def test_advertisements_are_bounded_and_unreachable_ones_make_room() -> None:
    lab = Federation("lab", max_channels=4)
    lab.advertise(["a"], ())
    lab.learn([advertisement("a", 1, "lab", "b"), advertisement("far1", 1), advertisement("far2", 1)])
    lab.learn([advertisement("b", 1, "a", "c")])
    lab.learn([advertisement("c", 1, "b")])
    assert [n.name for n in lab.advertisements] == ["lab", "a", "b", "c"]
    lab.learn([advertisement("d", 1, "c"), advertisement("c", 2, "b", "d")])
    assert [n.name for n in lab.advertisements] == ["lab", "a", "b", "c"]
    assert (lab.excess("a"), lab.excess("b")) == ("without d: the maximum is 4 channels", "")
    lab.learn([advertisement("b", 2, "a"), advertisement("a", 2, "lab", "b", "d"), advertisement("d", 2, "a")])
    assert [n.name for n in lab.advertisements] == ["lab", "a", "b", "d"] and lab.excess("a") == ""


def test_names_of_channels() -> None:
    for name in ("lab", "L-2.east", "_", "9", "a" * 60):
        assert check_name(name) == name
    for name in ("", "-a", ".a", "a/b", "a b", "ä", "a" * 61, "a\n"):
        with pytest.raises(InvalidPeer) as refused:
            check_name(name, "peer")
        assert refused.value.field == "peer"


@given(st.lists(st.tuples(st.dictionaries(st.sampled_from("ABC"), st.integers(1, 4)), st.booleans())))
def test_the_other_end_lacks_what_is_newer_than_it_had(steps: list[tuple[dict[str, int], bool]]) -> None:
    known, had = KnownAdvertisements(), dict.fromkeys("ABC", 0)
    for versions, arrives in steps:
        advertisements = [Advertisement(name, version, (), ()) for name, version in versions.items()]
        newer = [entry for entry in advertisements if entry.version > had[entry.name]]
        assert known.missing(advertisements) == known.missing(advertisements) == newer
        if arrives:
            known.add(newer)
            had.update((entry.name, entry.version) for entry in newer)
            assert known.missing(advertisements) == []


def exchange(*federations: Federation) -> None:
    """Each neighbour passes on what it knows, to both sides."""
    for here, there in itertools.pairwise(federations):
        for one, other in ((here, there), (there, here)):
            other.learn(one.advertisements)


def chain_with_two_labs() -> list[Federation]:
    """lab - hall - yard - lab."""
    chain = [Federation("lab", life=7), Federation("hall"), Federation("yard"), Federation("lab", life=8)]
    for here, peers in zip(chain, (["hall"], ["lab", "yard"], ["hall", "lab"], ["yard"]), strict=True):
        here.advertise(peers, ())
    return chain


def test_two_channels_of_one_name_are_found_everywhere_and_when_one_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    chain = chain_with_two_labs()
    for _ in range(16):
        now_s += 0.5
        exchange(*chain)
    reason = "two channels with the name lab are in the federation (one linked with hall; one linked with yard)"
    for federation in chain:
        assert federation.conflicts() == {"lab": f"{reason}; give one of them another name"}
    for _ in range(30):  # it lasts as long as both are there, and they supersede each other no more often than needed
        now_s += 0.5
        versions = [federation.own.version for federation in chain]
        exchange(*chain)
        assert [bool(federation.conflicts()) for federation in chain] == [True] * 4
        assert all(after.own.version - version <= 3 << 32 for after, version in zip(chain, versions, strict=True))
    for _ in range(30):
        now_s += 0.5
        exchange(*chain[:3])
    assert [federation.conflicts() for federation in chain[:3]] == [{}] * 3
    assert "lab" not in chain[1].ways("t", "s", "hall")
    chain[0].advertise(["hall"], WANTS_T)
    exchange(*chain[:3])
    assert "lab" in chain[1].ways("t", "s", "hall")
