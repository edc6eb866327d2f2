from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robocorba.events.federation import Advertisement, Federation
from robocorba.events.known_advertisements import KnownAdvertisements

#: Name and version of channels.
VERSIONS = st.dictionaries(st.sampled_from("ABC"), st.integers(1, 4))


@given(st.lists(st.tuples(VERSIONS, st.booleans())))
def test_the_other_end_lacks_what_is_newer_than_it_had(steps: list[tuple[dict[str, int], bool]]) -> None:
    known, had = KnownAdvertisements(), dict.fromkeys("ABC", 0)
    for versions, arrives in steps:
        advertisements = [Advertisement(name, version, (), ()) for name, version in versions.items()]
        for _ in range(2):
            missing = known.missing(advertisements)
            assert {entry.name: entry.version for entry in missing} == {
                name: version for name, version in versions.items() if version > had[name]
            }
        if arrives:
            known.add(missing)
            had.update((entry.name, entry.version) for entry in missing)
            assert known.missing(advertisements) == []


def test_the_advertisements_of_a_federation_are_listed_once_for_each_change() -> None:
    lab, hall = Federation("lab"), Federation("hall", life=7)
    listed = lab.advertisements
    assert lab.advertisements is listed
    lab.advertise(["hall"], ())
    hall.advertise(["lab"], ())
    assert [entry.peers for entry in lab.advertisements] == [("hall",)]
    lab.learn(hall.advertisements)
    assert [entry.name for entry in lab.advertisements] == ["lab", "hall"]
    listed = lab.advertisements
    lab.learn(hall.advertisements)
    assert lab.advertisements is listed
    lab.learn([Advertisement("lab", 9 << 32, (), ())])  # of an earlier process
    assert lab.advertisements[0].version > 9 << 32
