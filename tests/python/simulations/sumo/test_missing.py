"""SUMO where it is not installed."""

import sys

import pytest

from swarmwright import Experiment, InputError


def test_the_message_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libsumo", None)
    with pytest.raises(InputError, match=r"libsumo is not installed; pip install 'swarmwright\[sumo\]'"):
        Experiment.from_mapping({"simulation": "swarmwright.simulations.sumo:Vehicles"})
