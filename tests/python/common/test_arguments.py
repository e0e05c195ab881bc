"""Wrong arguments of public functions are refused with what is expected."""

from collections.abc import Callable
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import Experiment, InputError, Run

library: Any = swarmwright  # mypy would refuse the calls
MINISIM = {"simulation": "minisim", "servers": "local"}


def experiment() -> Experiment:
    return Experiment.from_mapping({**MINISIM, "method": {"population": 4, "generations": 2}})


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda _: library.compare("th_r"),
            r"^runs: must be a list of run folders, not 'th_r'; write \['th_r'\]$",
        ),
        (lambda _: library.compare(5), r"^runs: must be a list of run folders, not 5$"),
        (lambda _: library.compare([None]), r"^runs: must be the path of a run folder, not "),
        (
            lambda run: library.transfer(run.path, ["arena"]),
            r"^runs: must be a list of run folders, not an object of",
        ),
        (
            lambda run: library.transfer([run], "arena"),
            r"^to: must be a list of simulations .*write \['arena'\]$",
        ),
        (lambda _: library.Experiment.load(5), r"^path: must be the path of an experiment file, not 5$"),
        (
            lambda _: library.Experiment.load(b"a.yaml"),
            r"^path: must be the path of an experiment file, not an obj",
        ),
        (
            lambda _: library.Experiment.load("a.yaml", "seed=1"),
            r"^settings: must be a list .*write \['seed=1'\]$",
        ),
        (lambda _: library.optimize(None), r"^experiment: must be of the class Experiment, not nothing; "),
        (
            lambda _: library.optimize(library.Experiment.from_mapping(MINISIM), out=7),
            r"^out: must be the path of a folder",
        ),
        (lambda _: library.resume(3), r"^run: must be the path of a run folder, not 3$"),
        (lambda run: library.resume(run, settings="a=1"), r"^settings: must be a list of settings"),
        (lambda _: library.evaluate(3, []), r"^experiment: .*not 3; write Experiment\.load\(file\) or "),
        (lambda _: library.simulate(None), r"^experiment: must be of the class Experiment, not "),
        (lambda _: library.repeat(3), r"must be the path of a run folder, not 3$"),
        (lambda _: library.post_evaluate(None), r"must be the path of a run folder, not "),
        (
            lambda run: library.post_evaluate(run, metrics="steps"),
            r"^metrics: must be a list of names of metrics",
        ),
        (lambda _: library.Run.open(None), r"^path: must be the path of a run folder, not "),
        (
            lambda _: library.Controller.load(1),
            r"^path: must be the path of a controller or a run folder, not 1$",
        ),
        (lambda _: library.sweep(1), r"^source: must be the path of a file of a sweep, not 1$"),
        (lambda _: library.Experiment.from_mapping(None), r"^values: must be a mapping, not nothing; write "),
        (
            lambda _: library.Experiment.from_mapping([1]),
            r"^values: must be a mapping, not \[1\]; write \{'simul",
        ),
        (
            lambda _: library.Experiment.load("a\0b"),
            r"^path: a path cannot hold the character NUL, as 'a\\x00b",
        ),
        (lambda _: library.optimize(experiment(), out="a\0b"), r"^out: a path cannot hold the character NUL"),
        (
            lambda _: library.optimize(experiment(), 3),
            r"^on_generation: must be a function that takes \(generation\), not 3$",
        ),
        (
            lambda _: library.optimize(experiment(), lambda: None),
            r"^on_generation: must be a function that takes \(generation\); .*<lambda> takes \(\): too many",
        ),
        (
            lambda _: library.optimize(experiment(), wait="x"),
            r"^wait: is 'x', expected seconds: a finite number",
        ),
        (
            lambda _: library.optimize(experiment(), wait=-1),
            r"^wait: is -1, expected seconds: a finite number, ",
        ),
        (
            lambda _: library.optimize(experiment(), progress="x"),
            r"^progress: must be True or False, not 'x'$",
        ),
        (lambda _: library.optimize(experiment(), seed="x"), r"^seed: must be an integer, not 'x'$"),
        (
            lambda _: library.optimize(experiment(), servers=1.5),
            r"^servers: must be auto, local, in-process or a number from 1 on, not 1.5$",
        ),
        (
            lambda _: library.optimize(experiment(), servers=True),
            r"^servers: must be auto, local, in-process or a number from 1 on, not true$",
        ),
        (
            lambda _: library.evaluate(experiment(), [[0.0] * 49], servers=10**30),
            r"^servers: must be at least 1 and at most 1024, not 10{30}$",
        ),
        (
            lambda _: library.evaluate(experiment(), [[0.0] * 49], broker=1883),
            r"^broker: must be the URL of a broker such as mqtt://localhost:1883, not 1883$",
        ),
        (
            lambda _: library.evaluate(experiment(), [[0.0] * 49], on_progress=3),
            r"^on_progress: must be a function that takes \(done, total, waiting_for\), not 3$",
        ),
        (
            lambda _: library.simulate(experiment(), "folder"),
            r"^controller: must be of the class Controller, not 'folder'; write Controller\.load\(path\)$",
        ),
        (lambda _: library.simulate(experiment(), seed="a"), r"^seed: must be an integer, not 'a'$"),
        (lambda _: library.simulate(experiment(), visual="a"), r"^visual: must be True or False, not 'a'$"),
        (lambda run: library.resume(run, generations="5"), r"^generations: must be an integer, not '5'$"),
        (lambda run: library.resume(run, generations=-5), r"^generations: must be at least 1, not -5$"),
        (lambda run: library.resume(run, seconds="5"), r"^seconds: must be a finite number, not '5'$"),
        (
            lambda run: library.resume(run, settings=[5]),
            r"^settings: must be a list of texts such as .*, not 5$",
        ),
        (
            lambda run: library.resume(run, simulation=5),
            r"^simulation: must be a class, or 'FILE:Class', not 5$",
        ),
        (
            lambda run: library.repeat(run, experiment=5),
            r"^experiment: must be of the class Experiment, not 5; w",
        ),
        (lambda run: library.post_evaluate(run, episodes="3"), r"^episodes: must be an integer, not '3'$"),
        (lambda run: library.post_evaluate(run, episodes=True), r"^episodes: must be an integer, not true$"),
        (lambda run: library.post_evaluate(run, metrics=[5]), r"^metrics: must be a list of names, not 5$"),
        (
            lambda run: library.transfer([run], [5]),
            r"^to: must be a list of names of simulations, or .*, not 5$",
        ),
        (lambda run: library.transfer([run], vary=5), r"^vary: must be a mapping, not 5; write "),
        (
            lambda run: library.transfer([run], vary={"parameters.maxSteps": "ab"}),
            r"^vary: parameters.maxSteps: the lowest and highest value: must be a finite number, not 'a'$",
        ),
        (lambda run: library.compare([run], at="x"), r"^at: must be an integer, not 'x'$"),
        (lambda run: library.export_controller(run, to=5), r"^to: must be the name of an export "),
        (lambda run: library.export_bundle(run, None), r"^file: must be the path of a file, not nothing$"),
        (lambda run: run.plot(x="foo"), r"^x: must be one of evaluations, generations, not 'foo'$"),
        (lambda run: run.plot(x=["foo"]), r"^x: must be one of evaluations, generations, not \['foo'\]$"),
        (lambda run: run.export(None), r"^path: must be the path of a file, not nothing$"),
        (lambda run: run.evaluation(1.5, 0), r"^candidate: must be an integer, not 1.5$"),
        (lambda run: run.evaluation(10**30), r": has evaluations 0 to \d+, but no evaluation 10{30}$"),
        (lambda run: run.replay(speed=0), r"^speed: must be greater than 0, not 0$"),
        (lambda run: run.replay(seed=-1), r"^seed: must be from 0 to 2\*\*63 - 1, not -1$"),
        (lambda run: run.replay(episode=-1), r"^episode -1: the run has "),
        (lambda _: library.Controller(None), r"^controller: must be a mapping, not nothing; write "),
        (
            lambda _: library.callbacks.together(5),
            r"^callbacks: must be a function that takes \(generation\), n",
        ),
        (lambda _: library.templates.text(5), r"^name: must be a name, not 5$"),
        (lambda _: library.templates.arena(5), r"^mission: must be a name, not 5$"),
        (lambda _: library.sweep({}, jobs=0), r"^jobs: must be from 1 to 1024, not 0$"),
        (lambda _: library.frevo.score(5), r"^path: must be the path of a file, not 5$"),
    ],
)
def test_wrong_arguments(call: Callable[[Run], Any], words: str, finished: Run) -> None:
    with pytest.raises(InputError, match=words):
        call(finished)


def test_numbers_of_other_libraries_are_taken(finished: Run, tmp_path: Path) -> None:
    number = np.int64(1)
    assert finished.evaluation(number).number == 1
    assert len(library.post_evaluate(finished, episodes=number).episodes) == 1
    run = library.optimize(
        experiment(), seed=np.int64(3), wait=np.float32(3), progress=np.False_, out=tmp_path / "run"
    )
    assert run.experiment.seed == 3


def test_files_of_experiments_and_folders_of_runs_are_taken(finished: Run) -> None:
    file = finished.path / "experiment.yaml"
    genomes = [finished.evaluation().genome]
    assert library.evaluate(file, genomes) == library.evaluate(finished.experiment, genomes)
    assert library.evaluate_episodes(str(file), genomes).episodes.shape[0] == 1
    assert library.simulate(file) == library.simulate(finished.experiment)
    assert library.repeat(finished.path).same
    assert library.repeat(str(finished.path), experiment=file).same
    assert len(library.post_evaluate(finished.path, episodes=1, experiment=file).episodes) == 1


def test_missing_and_unknown_arguments_are_pythons_errors() -> None:
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'genomes'"):
        library.evaluate(experiment())
    with pytest.raises(TypeError, match="takes 2 positional arguments but 3 were given"):
        library.evaluate(experiment(), [], "mqtt://localhost")
    with pytest.raises(TypeError, match="unexpected keyword argument 'brokers'"):
        library.evaluate(experiment(), [], brokers=3)


def test_functions_written_in_c_are_taken() -> None:
    genomes = np.zeros((1, experiment().genome_size))
    assert library.evaluate(experiment(), genomes, on_progress=itemgetter)
