"""The tab of genes."""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.applications import Starlette

from swarmwright import Run
from tests.python.ui.client import call


def test_genes_are_those_of_the_best_of_each_generation(
    finished: Run, open_app: Callable[[Path], Starlette]
) -> None:
    app = open_app(finished.path.parent)
    name = finished.path.name
    assert "genes" in call(app, "/api/tabs", run=name).values["tabs"]
    values = call(app, "/api/genes", run=name).values
    genes = np.frombuffer(base64.b64decode(values["values"]), "<f4").reshape(-1, values["genes"])
    assert values["generations"] == list(range(finished.generations))
    assert values["names"][0] == "hidden 0, bias"
    for generation, (candidate, row) in enumerate(zip(values["candidates"], genes, strict=True)):
        best = finished.evaluation(generation=generation)
        assert candidate == best.candidate
        assert (row == best.genome).all()


@pytest.mark.parametrize("of", ["mean", "spread"])
def test_genes_of_the_whole_generation(finished: Run, open_app: Callable[[Path], Starlette], of: str) -> None:
    values = call(open_app(finished.path.parent), "/api/genes", run=finished.path.name, of=of).values
    genes = np.frombuffer(base64.b64decode(values["values"]), "<f4").reshape(-1, values["genes"])
    of_first = finished.record.genomes[finished.record.generation == 0]
    expected = of_first.mean(axis=0) if of == "mean" else of_first.std(axis=0)
    np.testing.assert_allclose(genes[0], expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    ("query", "message"),
    [({"of": "<b>"}, "must be best, mean or spread, not '<b>'"), ({"run": "../x"}, "there is no such run")],
)
def test_wrong_requests_are_told_why(
    finished: Run, open_app: Callable[[Path], Starlette], query: dict[str, Any], message: str
) -> None:
    answer = call(open_app(finished.path.parent), "/api/genes", **({"run": finished.path.name} | query))
    assert answer.status == 422
    assert message in answer.values["error"]
