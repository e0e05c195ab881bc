"""The random numbers are Philox 4x64-10, addressed by seed, purpose, generation and candidate."""

from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import _engine
from swarmwright.common.random_numbers import Stream, Streams

MASK = (1 << 64) - 1
WORDS = st.integers(0, MASK)


def purpose_key(purpose: str) -> int:
    return int.from_bytes(sha256(purpose.encode()).digest()[:8], "little")


def philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox 4x64-10 as its paper writes it (Salmon et al. 2011), in plain integers."""
    for _ in range(10):
        first, second = 0xD2E7470EE14C6C93 * counter[0], 0xCA5A826395121157 * counter[2]
        counter = [
            (second >> 64) ^ counter[1] ^ key[0],
            second & MASK,
            (first >> 64) ^ counter[3] ^ key[1],
            first & MASK,
        ]
        key = [(key[0] + 0x9E3779B97F4A7C15) & MASK, (key[1] + 0xBB67AE8584CAA73B) & MASK]
    return counter


def test_the_reference_gives_the_published_answers() -> None:
    # Known answers of Random123: all bits 0, all bits 1.
    assert philox([0] * 4, [0] * 2) == [
        0x16554D9ECA36314C,
        0xDB20FE9D672D0FDC,
        0xD7E772CEE186176B,
        0x7E68B68AEC7BA23B,
    ]
    assert philox([MASK] * 4, [MASK] * 2) == [
        0x87B092C3013FE90B,
        0x438C3C67BE8D0224,
        0x9CC7D7C69CD777B6,
        0xA09CAEBF594F0BA0,
    ]


@given(seed=WORDS, generation=WORDS, candidate=WORDS, purpose=st.text(max_size=20))
def test_words_are_those_of_the_reference(seed: int, generation: int, candidate: int, purpose: str) -> None:
    # The first block has the number 1.
    key = [seed, purpose_key(purpose)]
    expected = [word for block in (1, 2, 3) for word in philox([block, candidate, generation, 0], key)]
    assert Stream(seed, purpose, generation, candidate).raw(12).tolist() == expected


@given(seed=WORDS, candidate=WORDS, start=st.integers(0, 9))
def test_words_are_those_of_numpy(seed: int, candidate: int, start: int) -> None:
    key = np.array([seed, purpose_key("test")], dtype=np.uint64)
    numpy = np.random.Philox(key=key, counter=np.array([0, candidate, 3, 0], dtype=np.uint64))
    stream = Stream(seed, "test", 3, candidate)
    for count in (start, 1, 6):
        assert stream.raw(count).tolist() == numpy.random_raw(count).tolist()


def test_many_streams_are_the_streams() -> None:
    candidates = [0, 7, 2**64 - 1, 7]

    def streams() -> list[Stream]:
        return [Stream(5, "test", 2, candidate) for candidate in candidates]

    many = Streams(5, "test", 2, candidates)
    assert len(many) == 4
    assert many.integers(10, 3).tolist() == [one.integers(10, 3) for one in streams()]
    drawn = [[*one.raw(3)] and one.unit(2).tolist() for one in streams()]
    assert many.units(2).tolist() == drawn
    rest = [one.raw(8).tolist()[5:] for one in streams()]
    assert [one.raw(3).tolist() for one in many] == rest
    assert many[1].raw(3).tolist() == rest[1], "a copy does not move the stream"
    limits = np.array([1, 2, 3, 1000])
    each = [one.integer(below) for one, below in zip(streams(), limits.tolist(), strict=True)]
    assert Streams(5, "test", 2, candidates).integers(limits, 1)[:, 0].tolist() == each
    with pytest.raises(IndexError):
        many[4]


@pytest.mark.parametrize("count", [0, 1, 2, 7])
@pytest.mark.parametrize("used", [0, 3])
def test_normal_numbers_of_a_stream_are_those_of_many(count: int, used: int) -> None:
    def streams() -> Streams:
        many = Streams(5, "test", 2, range(3))
        many.units(used)
        return many

    alone, many = list(streams()), streams()
    assert [one.normals(count).tolist() for one in alone] == many.normals(count).tolist()
    assert [one.normals(count).shape for one in alone] == [(count,)] * 3
    many.normals(count)
    assert [one.raw(2).tolist() for one in alone] == [one.raw(2).tolist() for one in many]


@pytest.mark.parametrize("below", [0, 2**64 + 1])
def test_there_must_be_something_to_draw(below: int) -> None:
    with pytest.raises(_engine.InputError, match="below"):
        Stream(1, "test").integer(below)


def test_drawing_in_parts_is_drawing_at_once() -> None:
    parts = Stream(5, "test", 1, 2)
    assert [*parts.raw(3), *parts.raw(6)] == list(Stream(5, "test", 1, 2).raw(9))


@given(WORDS, st.integers(1, 1 << 64))
def test_integers_stay_below(seed: int, below: int) -> None:
    stream = Stream(seed, "test")
    assert all(0 <= stream.integer(below) < below for _ in range(5))


def test_integers_are_fair() -> None:
    stream = Stream(1, "dice")
    throws = np.bincount([stream.integer(6) for _ in range(6000)], minlength=6)
    # Chi-squared with five degrees of freedom: above 20.5 once in a thousand seeds.
    assert ((throws - 1000) ** 2 / 1000).sum() < 20.5


def test_units_fill_their_interval() -> None:
    units = Stream(1, "units").unit(10_000)
    assert units.min() >= 0
    assert units.max() < 1
    assert units.mean() == pytest.approx(0.5, abs=0.01)
    assert ((units * 2.0**53) % 1 == 0).all()
    assert np.histogram(units, bins=10, range=(0, 1))[0].min() > 900


@given(st.floats(0, 1e6), WORDS)
def test_uniform_stays_within_its_border(border: float, seed: int) -> None:
    values = Stream(seed, "test").uniform(np.full(20, border))
    assert (np.abs(values) <= border).all()


@pytest.mark.parametrize("candidates", [range(3, 9), range(9, 3, -2), range(0), range(5, 2)])
def test_candidates_may_be_a_range_or_an_array(candidates: range) -> None:
    listed = Streams(5, "test", 2, list(candidates)).units(2)
    assert Streams(5, "test", 2, candidates).units(2).tolist() == listed.tolist()
    array = np.array(candidates, dtype=np.int64)
    assert Streams(5, "test", 2, array).units(2).tolist() == listed.tolist()
    assert Streams(5, "test", 2, np.repeat(array, 2)[::2]).units(2).tolist() == listed.tolist()


def test_candidates_may_be_as_large_as_64_bits() -> None:
    last = range(2**64 - 2, 2**64)
    assert (
        Streams(5, "test", 2, last).units(1).tolist() == Streams(5, "test", 2, list(last)).units(1).tolist()
    )


def test_candidates_are_not_negative() -> None:
    for candidates in (range(-1, 3), [-1], np.array([3, -1])):
        with pytest.raises(OverflowError):
            Streams(5, "test", 2, candidates)
