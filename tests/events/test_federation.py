"""The advertisements of channels: versions, links and bounds."""

from __future__ import annotations

import pytest

from robocorba.errors.events import InvalidPeer
from robocorba.events.federation import Advertisement, Federation, check_name
from robocorba.events.subscription import Pattern

WANTS_T = (Pattern("t"),)


def notice(name: str, version: int, *peers: str, interest: tuple[Pattern, ...] = WANTS_T) -> Advertisement:
    return Advertisement(name, version, peers, interest)


def test_only_a_higher_version_is_news() -> None:
    lab = Federation("lab")
    lab.advertise(["hall"], ())
    assert lab.learn([notice("hall", 5, "lab")])
    assert not lab.learn([notice("hall", 5, "lab")])
    assert not lab.learn([notice("hall", 4)])
    assert lab.is_wanted("hall", "t", "s", "lab")
    assert lab.learn([notice("hall", 6, "lab", interest=())])
    assert not lab.is_wanted("hall", "t", "s", "lab")


def test_to_tell_the_same_again_is_no_news() -> None:
    lab = Federation("lab")
    assert lab.advertise(["hall"], WANTS_T)
    before = lab.own
    assert not lab.advertise(["hall"], WANTS_T)
    assert lab.own == before
    assert lab.advertise(["hall"], ())
    assert lab.own.version > before.version


def test_a_link_counts_when_both_ends_tell_of_it_or_one_is_not_heard_yet() -> None:
    lab = Federation("lab")
    lab.advertise(["hall"], ())
    lab.learn([notice("hall", 1, "lab", "yard", interest=()), notice("yard", 1)])
    assert not lab.is_wanted("hall", "t", "s", "lab")  # the yard knows of no link
    lab.learn([notice("yard", 2, "hall")])
    assert lab.is_wanted("hall", "t", "s", "lab")


def test_a_channel_that_no_way_leads_to_counts_for_nothing_until_there_is_one_again() -> None:
    lab = Federation("lab")
    lab.advertise(["hall"], ())
    lab.learn([notice("hall", 1, "lab", "yard", interest=()), notice("yard", 1, "hall")])
    lab.learn([notice("hall", 2, "lab", interest=())])
    assert [n.name for n in lab.advertisements] == ["lab", "hall"]
    assert not lab.is_wanted("hall", "t", "s", "lab")
    # Only the hall has sent an advertisement, the yard has not.
    lab.learn([notice("hall", 3, "lab", "yard", interest=())])
    assert [n.name for n in lab.advertisements] == ["lab", "hall", "yard"]
    assert lab.is_wanted("hall", "t", "s", "lab")


def test_a_channel_that_forgot_itself_is_believed_again() -> None:
    """Its clock was set back as well: what the others remember has a higher version than its new advertisement."""
    before = 2**62
    lab, hall = Federation("lab"), Federation("hall")
    lab.advertise(["hall"], WANTS_T)
    hall.learn([notice("lab", before, "hall", interest=())])
    hall.advertise(["lab"], ())
    assert not hall.learn([lab.own])
    assert lab.learn(hall.advertisements)
    assert hall.learn([lab.own])
    assert hall.is_wanted("lab", "t", "s", "hall")


def test_its_own_notice_that_comes_back_changes_nothing() -> None:
    lab = Federation("lab")
    lab.advertise(["hall"], WANTS_T)
    before = lab.own
    assert not lab.learn([before])
    assert lab.own is before


def test_a_restarted_channel_tells_a_newer_notice_with_the_same_content() -> None:
    before = Federation("lab")
    before.advertise(["hall"], WANTS_T)
    after = Federation("lab", before.advertisements)
    assert after.own.version > before.own.version
    assert (after.own.peers, after.own.interest) == (("hall",), WANTS_T)


def test_notices_are_bounded_and_unreachable_ones_make_room() -> None:
    lab = Federation("lab", max_channels=4)
    lab.advertise(["a"], ())
    lab.learn([notice("a", 1, "lab", "b"), notice("far1", 1), notice("far2", 1)])
    lab.learn([notice("b", 1, "a", "c")])
    lab.learn([notice("c", 1, "b")])
    assert [n.name for n in lab.advertisements] == ["lab", "a", "b", "c"]
    lab.learn([notice("d", 1, "c"), notice("c", 2, "b", "d")])
    assert [n.name for n in lab.advertisements] == ["lab", "a", "b", "c"]


@pytest.mark.parametrize("name", ["", "-a", ".a", "a/b", "a b", "ä", "a" * 61, "a\n"])
def test_names_that_no_channel_can_have(name: str) -> None:
    with pytest.raises(InvalidPeer) as refused:
        check_name(name, "peer")
    assert refused.value.field == "peer"


@pytest.mark.parametrize("name", ["lab", "L-2.east", "_", "9", "a" * 60])
def test_names_of_channels(name: str) -> None:
    assert check_name(name) == name
