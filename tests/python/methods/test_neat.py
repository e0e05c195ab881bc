"""NEAT: growing networks in species."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, optimize, resume
from swarmwright.controllers.kinds.growing.genes import read
from swarmwright.controllers.kinds.neat import GrowingNeat, NeatOptions
from swarmwright.testing import check_method
from tests.python.methods.functions import new
from tests.python.methods.test_xor import answers, last_best
from tests.python.records import same_record


def subject(**options: Any) -> GrowingNeat:
    return GrowingNeat(NeatOptions(**options), sensors=2, actuators=1)


@pytest.mark.slow
def test_it_is_a_method() -> None:
    check_method("neat")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_growing_network_learns_xor(seed: int) -> None:
    """It cannot without hidden nodes."""
    method = new("neat", seed=seed, subject=subject(), generations=150, target=-0.04)
    fitness, best = last_best(method)
    assert fitness >= -0.04
    assert np.abs(answers(method.representation, best) - [-1, 1, 1, -1]).max() <= 0.2
    assert read(method.representation.specification(best)).hidden > 0


def experiment(**method: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"maxSteps": 6, "placement": "random"},
            "controller": {"kind": "neat", "recurrent": True, "add_node": 0.3, "add_connection": 0.3},
            "method": {"kind": "neat", "population": 30, "generations": 5, **method},
            "servers": "local",
        }
    )


def test_a_resumed_run_has_the_record_of_a_whole_run(tmp_path: Path) -> None:
    whole = optimize(experiment(), out=tmp_path / "whole")
    part = optimize(experiment(), lambda now: now.generation < 2, out=tmp_path / "part")
    same_record(resume(part), whole)
    assert whole.record.genomes[:, 0].max() > 0, "it has grown"


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 2])
def test_servers_give_the_record_of_this_process(servers: int, tmp_path: Path) -> None:
    here = optimize(experiment(), out=tmp_path / "here")
    made = Experiment.from_mapping({**experiment().to_mapping(), "servers": servers})
    same_record(optimize(made, out=tmp_path / "there"), here)


@pytest.mark.parametrize(
    ("controller", "reason"),
    [
        ({"kind": "layered"}, "neat cannot evolve layered: it evolves networks that grow"),
        ({"kind": "neat", "sources": [[0, 1, 2, 3]]}, "use controller: {kind: neat} without sources"),
        ({"kind": "neat", "iterations": 2}, "iterations is for fixed connections; give sources"),
        ({"kind": "neat", "sources": [[0]], "recurrent": True}, "recurrent is for networks that grow"),
    ],
)
def test_what_does_not_fit_is_refused(controller: dict[str, Any], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Experiment.from_mapping(
            {"simulation": "minisim", "controller": controller, "method": {"kind": "neat"}}
        )
