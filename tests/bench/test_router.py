"""The network of the benches: its segments against an independent model, and the ways of packets."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from testkit.router import QUEUE_BYTES, Network, Segment

A, B, C = (bytes(address) for address in ((192, 168, 0, 2), (192, 168, 0, 3), (192, 168, 8, 2)))


def packet(source: bytes, target: bytes, size: int = 1000) -> bytes:
    """An IPv4 packet as far as the network reads it."""
    return bytes(12) + source + target + bytes(size - 20)


@given(
    st.sampled_from([1, 10, 100]), st.lists(st.tuples(st.integers(0, 3_000_000), st.integers(20, 1500)), max_size=120)
)
def test_a_segment_carries_one_frame_at_a_time(mbit_s: int, sent: list[tuple[int, int]]) -> None:
    segment, at_ns = Segment(), 0
    segment.mbit_s = mbit_s
    waiting = Fraction(0)  # the model: bits of frames and the gaps behind them leave at the bit rate
    for pause_ns, size in sent:
        at_ns += pause_ns
        waiting = max(Fraction(0), waiting - Fraction(pause_ns * mbit_s, 1000))
        arrives_ns = segment.carry(size, at_ns)
        if abs(waiting - 8 * QUEUE_BYTES) < 8:  # rounded to nanoseconds, both answers are right
            return
        assert (arrives_ns is None) == (waiting > 8 * QUEUE_BYTES)
        if arrives_ns is not None:
            frame = 8 * (8 + 14 + max(46, size) + 4)
            assert abs(arrives_ns - at_ns - (waiting + frame) * 1000 / mbit_s) <= 2 * len(sent)
            waiting += frame + 8 * 12


def test_packets_share_segments_in_both_directions_and_take_two_and_the_link_to_another_sub_network() -> None:
    network = Network([A, B, C])
    network.put(packet(A, C), 5)
    assert network.take(5) == packet(A, C)  # at first without limits
    network.change(mbit_s=10, delay_us=300)
    for target, source in [(A, B), (B, A)] * 100:
        network.put(packet(source, target, 1500), 0)
    assert network.segments[A[:3]].dropped == 200 - 40
    assert network.take(1526 * 800 - 1) is None
    assert [network.take(10**8) for _ in range(60)].count(packet(A, B, 1500)) == 20
    network.put(packet(A, C), 10**9)
    network.put(packet(A, bytes(4)), 10**9)  # nobody's
    assert network.due_ns == 10**9 + 1026 * 800 + 300_000
    assert network.take(10**9 + 10**7) == packet(A, C)  # looked at late, it is on time: the next frame need not wait
    network.put(packet(C, A), 10**9 + 2 * 10**6)
    assert network.due_ns == 10**9 + 2 * 10**6 + 1026 * 800 + 300_000
    assert (network.packets, network.bytes) == (3, 3000)
    network.change(is_cut=True)
    network.put(packet(A, C), 2 * 10**9)
    network.put(packet(A, B), 2 * 10**9)
    arrived = [network.take(3 * 10**9) for _ in range(3)]
    assert arrived == [packet(C, A), packet(A, B), None] and network.packets == 3
    network.change(is_cut=False, mbit_s=0, far_us={"192.168.8": 50})
    network.put(packet(C, A), 4 * 10**9)
    assert network.due_ns == 4 * 10**9 + 350_000
