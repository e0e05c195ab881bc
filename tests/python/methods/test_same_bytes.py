"""Runs of methods in Python have the same record on any servers, and when they are resumed."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, Generation, optimize, resume
from tests.python.methods.needed import method_of
from tests.python.records import same_record

METHODS: list[dict[str, Any]] = [
    {"kind": "ga_species"},
    {"kind": "tpe", "population": 5},  # it takes its time
    {"kind": "map_elites", "operation": "steady_state"},
    {"kind": "nsga2", "operation": "steady_state"},
    {"kind": "cuckoo_search"},
    {"kind": "novelty", "objective": "mixed"},
    {
        "kind": "novelty",
        "objective": "local_competition",
        "archive": {"kind": "threshold", "threshold": 0.01},
    },
    {"kind": "novelty", "species": {}, "criteria": {"fitness": {"at_least": -5}}},
]


@pytest.mark.slow
@pytest.mark.parametrize("options", METHODS)
def test_servers_and_interruptions_do_not_matter(options: dict[str, Any], tmp_path: Path) -> None:
    experiment = Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
            "method": method_of(**{"population": 20, "generations": 9, **options}),
            "ranking": {"episodes": 2},
            "seed": 5,
        }
    )

    def until_four(now: Generation) -> bool:
        return now.generation < 3

    whole = optimize(experiment, servers="in-process", out=tmp_path / "whole")
    assert whole.generations == 9
    for servers in (1, 2):
        part = optimize(experiment, until_four, servers=servers, out=tmp_path / str(servers))
        assert part.generations == 4
        run = resume(part, servers=3 - servers)
        same_record(run, whole)
        assert run.best == whole.best
        assert run.best.fitness == whole.record.fitness.max()
