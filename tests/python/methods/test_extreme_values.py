"""Methods that compute with fitness or metrics, told extreme numbers: no warnings, and finite genomes."""

from typing import Any

import numpy as np
import pytest

from swarmwright.controllers import REPRESENTATIONS
from tests.python.methods.functions import new

MEASURES = {"population": 40, "measures": {name: {"range": [0, 1]} for name in "xy"}}
OBJECTIVES = {"population": 40, "objectives": {"a": "minimize", "b": "maximize"}}
UNSTRUCTURED = {"kind": "unstructured", "neighbours": 5}
CASES: list[tuple[str, dict[str, Any]]] = [
    ("novelty", MEASURES),
    ("novelty", {**MEASURES, "objective": "mixed"}),
    ("novelty", {**MEASURES, "objective": "local_competition"}),
    ("novelty", {**MEASURES, "species": {}, "archive": {"kind": "threshold"}}),
    ("ga_species", {}),
    ("cuckoo_search", {}),
    ("nsga2", OBJECTIVES),
    ("nsga3", OBJECTIVES),
    ("map_elites", MEASURES),
    ("map_elites", {**MEASURES, "archive": {"kind": "cvt", "cells": 50}}),
    ("map_elites", {**MEASURES, "archive": UNSTRUCTURED}),
    ("map_elites", {**MEASURES, "archive": UNSTRUCTURED, "variation": "cma_me"}),
    ("map_elites", {**MEASURES, "variation": "cma_me"}),
    ("map_elites", {**MEASURES, "variation": "cma_mae", "threshold_min": -1e308}),
    ("map_elites", {**MEASURES, "reevaluate": 0.3}),
    ("neat", {}),
]
VALUES = {
    "equal": [1.0],
    "huge": [1e308, -1e308, 0.0],
    "failed": [np.nan],
    "nearly all failed": [1.0, *[np.nan] * 39],
    "infinite": [np.inf, -np.inf, np.nan],
    "mixed": [np.nan, np.inf, 1e308, -1e308, 0.0, 5e-324],
}


@pytest.mark.parametrize("values", VALUES.values(), ids=VALUES)
@pytest.mark.parametrize(("kind", "options"), CASES)
def test_extreme_fitness_and_metrics(kind: str, options: dict[str, Any], values: list[float]) -> None:
    rng = np.random.default_rng(1)
    subject = None
    if kind == "neat":
        networks = REPRESENTATIONS.get("neat")
        subject = networks(networks.options_model(), sensors=3, actuators=1)
    method = new(kind, subject=subject, **options)
    for _ in range(8):
        genomes = method.ask()
        assert np.isfinite(genomes).all()
        metrics = rng.choice(values, (len(genomes), len(method.options.needed_metrics)))
        method.tell(rng.choice(values, len(genomes)), metrics=metrics)
