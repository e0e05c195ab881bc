"""NEAT's networks compute what FREVO's class computes, and get the fitness that FREVO gives its files."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, InputError, frevo, optimize
from swarmwright.common.xml import read
from swarmwright.controllers.kinds.neat import FrevoNeat, NeatOptions
from swarmwright.controllers.kinds.neat.code import prune
from swarmwright.interop.frevo._document import open_session
from swarmwright.interop.frevo._representations import read_neat
from swarmwright.interop.frevo._score import read_networks

Edited = Callable[..., Path]
READ_AGAIN = {0: -81.19803115654246, 1: -81.19803115654246, 6: -81.19803115654246}
"""What FREVO gives these three when it reads the file: their fitness is of what they were before mutations of
their children, which share their genes, changed them."""


def written(case: dict[str, Any], path: Path) -> Path:
    """Write a network as FREVO writes it."""
    nodes = [
        f'<NEATNodeGene id="{number}" innovationnumber="-1" sigmoidfactor="{factor!r}" type="{kind}" '
        f'bias="{bias!r}"/>'
        for number, kind, bias, factor in case["nodes"]
    ]
    links = [
        f'<NEATlinkGene innovationnumber="1" enabled="{str(enabled).lower()}" fromID="{start}" toID="{end}" '
        f'weight="{weight!r}" recurrent="false" selfrecurrent="false"/>'
        for start, end, weight, enabled in case["links"]
    ]
    sizes = f'input_nodes="{case["inputs"]}" output_nodes="{case["outputs"]}"'
    path.write_text(f"<NEAT {sizes}><genes>{''.join(nodes + links)}</genes></NEAT>")
    return path


def test_outputs_are_those_of_frevos_class_to_the_bit(data: Path, tmp_path: Path) -> None:
    loops, moved = 0, 0
    for case in json.loads((data / "neat.json").read_text(encoding="utf-8")):
        specification = read_neat(read(written(case, tmp_path / "neat.xml")))
        first = specification["sensors"]
        loops += sum(first + node <= one for node, row in enumerate(specification["sources"]) for one in row)
        controller, forgetful = Controller(specification), Controller(specification)
        for step in case["steps"]:
            if step["reset"]:
                controller.reset()
            forgetful.reset()
            sensors = np.array(step["inputs"], np.float32)
            expected = np.float32(2) * np.array(step["outputs"], np.float32) - np.float32(1)
            assert controller(sensors).tolist() == expected.tolist()
            moved += forgetful(sensors).tolist() != expected.tolist()
    assert loops > 20, "connections back, sideways and to themselves"
    assert moved > 50, "most steps depend on those before"


def test_fitness_is_what_frevo_gives_the_file(data: Path, edited: Edited) -> None:
    scores = frevo.score(data / "neat.zre")
    assert [READ_AGAIN.get(one.index, one.frevo) for one in scores] == [one.fitness for one in scores]
    assert len(scores) == 10
    assert any("share their genes" in note for note in scores.notes)
    text = (data / "neat.zre").read_text(encoding="utf-8")
    weights = re.findall(r'toID="11" weight="[^"]*"', text)
    changed = edited("neat.zre", (weights[0], 'toID="11" weight="-5"'))
    assert [one.fitness for one in frevo.score(changed)] != [one.fitness for one in scores]


def test_a_result_evolves_on_and_grows(data: Path, tmp_path: Path) -> None:
    imported = frevo.load(data / "neat.zre")
    options = imported.experiment.controller
    assert isinstance(options, NeatOptions)
    assert (options.add_node, options.add_connection) == (0.3, 0.5)
    assert any("those of the file's best network, and grow from there" in note for note in imported.notes)
    assert "  frevo: true  " in imported.yaml
    assert "max_perturbation = 0.5f: replaced by the severity" in imported.yaml
    best = frevo.score(data / "neat.zre").candidates[0].specification
    Controller(best).save(tmp_path / "best.json")
    experiment = imported.experiment.replace(
        method={"generations": 3}, servers="local", start_from=str(tmp_path / "best.json")
    )
    run = optimize(experiment, out=tmp_path / "run")
    assert run.fitness[0] == READ_AGAIN[0], "it is the first candidate"
    genomes = run.record.genomes
    subject = experiment.representation()
    weights = np.array(best["weights"], np.float32)
    assert isinstance(subject, FrevoNeat)
    start = subject.adopt({key: value for key, value in best.items() if key != "weights"}, weights)
    assert start is not None
    for other in frevo.score(data / "neat.zre"):
        adopted = subject.adopt(other.specification, np.array(other.specification["weights"], np.float32))
        assert adopted is not None, "all networks of the file can be among the first candidates"
    assert (np.count_nonzero(genomes, axis=1) > np.count_nonzero(start)).any(), "connections have been added"
    assert run.best.fitness >= READ_AGAIN[0]


def test_growing_networks_compute_what_their_results_compute(data: Path) -> None:
    """With room for more nodes and connections, to the bit."""
    readings = np.random.default_rng(1).uniform(-1, 1, (30, 10)).astype(np.float32)
    for network in read_networks(open_session(data / "neat.zre")):
        result = network.specification
        options = {"frevo": True, "max_nodes": 20, "sources": result["sources"]}
        subject = FrevoNeat(NeatOptions.model_validate(options), sensors=10, actuators=2)
        genome = subject.adopt(result, np.array(result["weights"], np.float32))
        assert genome is not None
        grown = Controller(subject.specification(genome))
        assert len(grown.specification["sources"]) == 22
        exported = prune(grown.specification)
        assert exported["sources"] == result["sources"]
        assert exported["weights"] == np.array(result["weights"], np.float32).tolist()
        before = Controller(result)
        assert [before(row).tolist() for row in readings] == [grown(row).tolist() for row in readings]


def test_other_controllers_do_not_become_growing_networks(data: Path) -> None:
    result = read_networks(open_session(data / "neat.zre"))[0].specification
    weights = np.array(result["weights"], np.float32)
    options = {"frevo": True, "sources": result["sources"]}
    subject = FrevoNeat(NeatOptions.model_validate(options), sensors=10, actuators=2)
    assert subject.adopt(result, weights) is not None
    assert subject.adopt({**result, "iterations": 2}, weights) is None
    backwards = [row[::-1] for row in result["sources"]]
    assert subject.adopt({**result, "sources": backwards}, weights) is None, (
        "sums would be rounded differently"
    )


def test_genes_that_do_not_count_are_left_out(data: Path, tmp_path: Path) -> None:
    """Disabled connections, nodes that are there twice, and genes that stand for features."""
    case = json.loads((data / "neat.json").read_text(encoding="utf-8"))[0]
    found = read_neat(read(written(case, tmp_path / "neat.xml")))
    assert sum(map(len, found["sources"])) == sum(enabled for *_, enabled in case["links"])
    text = (tmp_path / "neat.xml").read_text(encoding="utf-8")
    again = '<NEATNodeGene id="6" innovationnumber="9" sigmoidfactor="3" type="0" bias="3"/>'
    feature = '<NEATFeatureGene innovationnumber="9" featureValue="3"/>'
    (tmp_path / "neat.xml").write_text(text.replace("</genes>", f"{again}{feature}</genes>"))
    assert read_neat(read(tmp_path / "neat.xml")) == found


@pytest.mark.parametrize(
    ("before", "after", "answer"),
    [
        (
            'fromID="2" toID="5"',
            'fromID="22" toID="5"',
            "<NEATlinkGene>: fromID 22: no node has this id",
        ),
        ('output_nodes="2"', 'output_nodes="3"', "output_nodes 3 found, but 2 output genes"),
        (
            'input_nodes="3"',
            'input_nodes="4"',
            "input_nodes 4 found, but the ids of the input genes are not 1 to 4",
        ),
        ('id="2"', 'id="-2"', "<NEATNodeGene>: id '-2' found, expected a whole number"),
        ('weight="2.0"', 'weight="1e39"', "weight '1e39' found, expected a finite number"),
        ("<NEATlinkGene", "<NEATLinkGene", "<NEATLinkGene>: found among the genes; expected"),
        (' enabled="true"', "", "the attribute enabled is missing"),
    ],
)
def test_malformed_genes_are_refused(
    data: Path, tmp_path: Path, before: str, after: str, answer: str
) -> None:
    path = written(json.loads((data / "neat.json").read_text(encoding="utf-8"))[0], tmp_path / "neat.xml")
    text = path.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after, 1))
    with pytest.raises(InputError, match=re.escape(answer)):
        read_neat(read(path))
