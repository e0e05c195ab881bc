"""Radios in ns-3: range, loss, delay, bandwidth, repeated episodes."""

import importlib.util
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError
from swarmwright.simulations.ns3 import Delivery, Radios

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("cppyy") is None, reason="ns3 is not installed; make test-simulators"
    ),
]


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    yield
    if Radios._open is not None:
        Radios._open.close()


def delivered(distance: float, *, messages: int = 20, **options: Any) -> list[Delivery]:
    with Radios(2, **{"seed": 1, **options}) as radios:
        places = [[0.0, 0.0], [distance, 0.0]]
        return [one for _ in range(messages) for one in radios.step(places, [(0, b"x" * 100)], 0.1)]


@pytest.mark.parametrize("rate", [1, 2, 5.5, 11])
@pytest.mark.parametrize(("range_", "exponent"), [(0.3, 2.0), (10.0, 3.0), (80.0, 4.0)])
def test_the_range_is_that_of_the_path_loss(rate: float, range_: float, exponent: float) -> None:
    options: dict[str, Any] = {"rate": rate, "range": range_, "exponent": exponent, "messages": 5}
    assert len(delivered(0.95 * range_, **options)) == 5
    assert delivered(1.05 * range_, **options) == []


def test_the_power_follows_from_the_range() -> None:
    with Radios(1, seed=1, range=100.0, exponent=2.0) as radios:
        assert radios.power == pytest.approx(-82 + 40.05 + 40)


def test_payloads_arrive_at_all_others_in_range_after_their_time_on_the_air() -> None:
    with Radios(3, seed=1, range=5.0, jitter=0.0) as radios:
        found = radios.step([[0, 0, 0], [0, 3, 0], [0, 0, 7]], [(0, b"to all"), (2, b"to none")], 0.1)
        assert [(one.receiver, one.sender, one.payload) for one in found] == [(1, 0, b"to all")]
        (short,) = radios.step([[0, 0], [3, 0], [20, 0]], [(1, b"x" * 10)], 0.1)
        (long,) = radios.step([[0, 0], [3, 0], [20, 0]], [(1, b"x" * 1010)], 0.1)
        # 1000 bytes more at 1 Mbit/s; up to 31 slots of 20 us before a frame are random.
        assert long.delay - short.delay == pytest.approx(0.008, abs=31 * 20e-6)
        assert 31 * 20e-6 + 0.002 > short.delay > 10 * 8e-6


def test_a_message_may_arrive_in_a_later_step() -> None:
    with Radios(2, seed=1, jitter=0.0) as radios:
        places = [[0, 0], [1, 0]]
        assert radios.step(places, [(0, b"x" * 1000)], 0.005) == []
        (one,) = radios.step(places, [], 0.005)
        assert 0.008 < one.delay < 0.01


def share(count: int, size: int) -> float:
    with Radios(count, seed=1) as radios:
        places = np.random.default_rng(1).uniform(-1, 1, (count, 2))
        sent = [(sender, b"x" * size) for sender in range(count)]
        found = sum(len(radios.step(places, sent, 0.1)) for _ in range(10))
    return found / (10 * count * (count - 1))


def test_messages_are_lost_by_load() -> None:
    few, more, most = share(2, 100), share(20, 100), share(40, 100)
    assert few == 1.0
    assert few > more + 0.05 > most + 0.15
    # 20 messages of 1000 bytes take 0.17 s of each 0.1 s: about half of them arrive so far.
    assert 0.3 < share(20, 1000) < 0.7


def test_fading_makes_the_range_gradual() -> None:
    near, far = (len(delivered(one, fading=1.0, messages=100)) for one in (5.0, 12.0))
    assert 60 < near < 100
    assert 0 < far < 50


PROGRAM = """
import hashlib, sys
import numpy as np
from swarmwright.simulations.ns3 import Radios

def swarm(seed):
    numbers = np.random.default_rng(seed)
    places = numbers.uniform(-5, 5, (12, 2))
    with Radios(12, seed=seed, range=6.0, fading=3.0) as radios:
        found = []
        for _ in range(20):
            places += numbers.normal(0, 0.1, places.shape)
            found += radios.step(places, [(sender, bytes(50)) for sender in range(12)], 0.1)
    return hashlib.sha256(repr(found).encode()).hexdigest()

first = swarm(1)
assert first != swarm(2) and len({swarm(seed) for seed in (2**62, 2**62 + 1, 4294944443)}) == 3
assert first == swarm(1)
print(first)
"""


def test_the_same_seed_gives_the_same_deliveries_in_two_processes() -> None:
    said = [subprocess.check_output([sys.executable, "-c", PROGRAM], timeout=100) for _ in range(2)]
    assert said[0] == said[1]


def test_mistakes() -> None:
    radios = Radios(2, seed=1)
    with pytest.raises(InputError, match="other radios are open, but ns-3 allows one simulation"):
        Radios(2, seed=1)
    places = np.zeros((2, 2))
    for values, message in (
        (
            (np.zeros((3, 2)), [], 0.1),
            r"expected \(2, 2\) or \(2, 3\) finite numbers, found the shape \(3, 2\)",
        ),
        ((places + np.nan, [], 0.1), "finite numbers"),
        ((places, [(2, b"x")], 0.1), "there is no radio 2, only 0 to 1"),
        ((places, [(0, "text")], 0.1), "'text' found, expected at most 2200 bytes"),
        ((places, [(0, bytes(2201))], 0.1), "found, expected at most 2200 bytes"),
        ((places, [], 0.0), "seconds: 0.0 found"),
    ):
        with pytest.raises(InputError, match=message):
            radios.step(*values)
    radios.close()
    radios.close()
    with pytest.raises(InputError, match="the radios are closed"):
        radios.step(places, [], 0.1)
