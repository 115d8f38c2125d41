"""What a radio does to frames, one fault at a time."""

from itertools import pairwise
from random import Random

import pytest

from companion.mavlink.codec import Encoder, FrameParser, Layout
from sitl.wire.impairments import NEVER_US, Channel, Impairments

HEARTBEAT = Encoder(Layout("HEARTBEAT"), 1, 1)
ATTITUDE = Encoder(Layout("ATTITUDE"), 1, 1)
COUNT = 4000


def heartbeat(number: int) -> bytes:
    return HEARTBEAT.encode(number, number, 2, 12, 81, 4, 3)


def through(how: Impairments, count: int = COUNT, seed: int = 1) -> list[tuple[int, int]]:
    """(number, when in us) of the intact frames, one sent a millisecond."""
    channel = Channel(Random(seed), how)
    arrived = []
    for number in range(count):
        channel.put(heartbeat(number), 1000 * number)
    for now in range(0, 1000 * count + 1_000_000, 250):
        for frame, intact in channel.arrived(now):
            if intact:
                arrived.append((int.from_bytes(frame[10:14], "little"), now))
    assert channel.due_us == NEVER_US
    return arrived


def test_a_channel_that_does_nothing_passes_everything_at_once() -> None:
    assert through(Impairments(), 50) == [(n, 1000 * n) for n in range(50)]


def test_delay_is_what_it_says() -> None:
    assert {when - 1000 * n for n, when in through(Impairments(0.03), 50)} == {30_000}


def test_jitter_keeps_the_order() -> None:
    arrived = through(Impairments(0.005, 0.02))
    late = [when - 1000 * n for n, when in arrived]
    assert [n for n, _ in arrived] == list(range(COUNT))
    assert min(late) >= 5_000
    assert 20_000 < max(late) <= 25_250


def test_loss_is_as_frequent_as_it_says() -> None:
    assert len(through(Impairments(loss=0.1))) == pytest.approx(0.9 * COUNT, rel=0.02)


def test_bursts_are_as_long_as_the_chain_says() -> None:
    arrived = [n for n, _ in through(Impairments(burst_begins=0.02, burst_ends=0.2), 20_000)]
    gaps = [b - a - 1 for a, b in pairwise(arrived) if b > a + 1]
    assert sum(gaps) / len(gaps) == pytest.approx(5.0, rel=0.15)
    assert max(gaps) > 10


def test_duplicates_are_copies() -> None:
    numbers = [n for n, _ in through(Impairments(duplication=0.2))]
    assert len(numbers) == pytest.approx(1.2 * COUNT, rel=0.03)
    assert set(numbers) == set(range(COUNT))


def test_only_reordering_lets_a_frame_be_overtaken() -> None:
    numbers = [n for n, _ in through(Impairments(reordering=0.1))]
    assert sorted(numbers) == list(range(COUNT))
    overtaken = sum(b < a for a, b in pairwise(numbers))
    assert 0.05 * COUNT < overtaken < 0.12 * COUNT


def test_flipped_bits_never_pass_for_a_frame() -> None:
    channel = Channel(Random(1), Impairments(corruption=1.0))
    parser = FrameParser()
    for number in range(COUNT):
        channel.put(heartbeat(number), number)
    deliveries = channel.arrived(COUNT)
    assert len(deliveries) == COUNT
    assert not any(intact for _, intact in deliveries)
    assert all(frame != heartbeat(n) for n, (frame, _) in enumerate(deliveries))
    assert sum(len(parser.feed(frame)) for frame, _ in deliveries) <= 1  # a CRC of 16 bits lets one in 65536 through


def test_one_message_can_be_muted_and_thinned() -> None:
    channel = Channel(Random(1))
    channel.muted.add(0)
    channel.keep_one_in[30] = 3
    for number in range(30):
        channel.put(heartbeat(number), 0)
        channel.put(ATTITUDE.encode(number, number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0)
    ids = [frame[7] for frame, _ in channel.arrived(0)]
    assert ids == [30] * 10
    assert channel.lost == 50


def test_a_channel_that_is_muted_altogether_is_silent() -> None:
    channel = Channel(Random(1))
    channel.muted.add(Channel.ALL)
    channel.put(heartbeat(0), 0)
    assert channel.arrived(0) == []


def test_prompt_until_something_takes_time() -> None:
    channel = Channel(Random(1))
    assert channel.prompt
    channel.put(heartbeat(0), 0)
    assert not channel.prompt
    channel.arrived(0)
    assert channel.prompt
    channel.impairments = Impairments(delay_s=0.01)
    assert not channel.prompt


def test_the_same_seed_has_the_same_luck() -> None:
    how = Impairments(0.01, 0.01, 0.1, 0.02, 0.2, 0.1, 0.1)
    assert through(how, 500, 7) == through(how, 500, 7)
    assert through(how, 500, 7) != through(how, 500, 8)
