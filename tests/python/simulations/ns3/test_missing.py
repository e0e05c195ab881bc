"""Radios where ns-3 is not installed, and wrong values, which need none."""

import sys
from typing import Any

import pytest

from swarmwright import InputError
from swarmwright.simulations import ns3 as implementation
from swarmwright.simulations.ns3 import Radios


def test_the_message_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cppyy", None)
    implementation._library.cache_clear()
    with pytest.raises(InputError, match=r"cppyy is not installed; pip install 'swarmwright\[ns3\]'"):
        Radios(2, seed=1)
    implementation._library.cache_clear()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"count": 0}, "count: 0 found, expected a number from 1 to 10000"),
        ({"seed": -1}, "seed: -1 found"),
        ({"range": 0.0}, "range: 0.0 found"),
        ({"range": float("nan")}, "range: nan found"),
        ({"exponent": "3"}, "exponent: '3' found"),
        ({"fading": 0.1}, "fading: 0.1 found"),
        ({"rate": 54}, "rate: 54 found, expected 1, 2, 5.5 or 11 Mbit/s"),
        ({"jitter": -1}, "jitter: -1 found"),
    ],
)
def test_wrong_values(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Radios(**{"count": 2, "seed": 1, **values})
