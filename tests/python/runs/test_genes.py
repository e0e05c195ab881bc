"""Genes over the generations of a run."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.runs import genes
from swarmwright.runs.genes import gene_history
from tests.python.records import EXPERIMENT


def test_many_genes_share_rows_and_many_generations_are_thinned(
    finished: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = gene_history(finished, generations=2, groups=7)
    assert history.generations.tolist() == [0, finished.generations - 1]
    genome = finished.evaluation(generation=0).genome
    ends = [*history.first_genes[1:].tolist(), history.genes]
    expected = [genome[begin:end].mean() for begin, end in zip(history.first_genes, ends, strict=True)]
    np.testing.assert_allclose(history.values[0], expected, rtol=1e-5)
    monkeypatch.setattr(genes, "_MOST_BYTES", 1)
    assert gene_history(finished).generations.tolist() == [0, finished.generations - 1]


def test_genes_that_are_made_from_samples(tmp_path: Path) -> None:
    method = {"kind": "openai_es", "population": 6, "generations": 3}
    run = optimize(EXPERIMENT.replace(method=method, servers="in-process"), out=tmp_path / "run")
    for generation, row in enumerate(gene_history(run).values):
        assert (row == run.evaluation(generation=generation).genome).all()


@pytest.mark.parametrize(
    ("controller", "first", "last"),
    [
        ({"kind": "layered", "hidden": []}, "actuator 0, bias", "actuator 0, sensor 3"),
        ({"kind": "layered", "hidden": [2, 3]}, "layer 0 node 0, bias", "actuator 0, layer 1 node 2"),
        ({"kind": "fully_meshed", "hidden": 1}, "hidden 0, bias", "actuator 0, actuator 0"),
        ({"kind": "evostick"}, "actuator 0, sensor 0", "actuator 0, bias"),
    ],
)
def test_names_of_genes(controller: dict[str, Any], first: str, last: str) -> None:
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "controller": controller, "servers": "in-process"}
    )
    representation = experiment.representation()
    names = representation.gene_names
    assert (names[0], names[-1]) == (first, last)
    assert len(set(names)) == representation.genome_size


@pytest.mark.parametrize("options", [{"of": "worst"}, {"generations": 1}, {"groups": 0}, {"groups": 5000}])
def test_numbers_out_of_range_are_refused(finished: Run, options: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        gene_history(finished, **options)
