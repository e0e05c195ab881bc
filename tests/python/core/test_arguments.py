"""Wrong arguments of public functions are refused with what is expected."""

from collections.abc import Callable
from typing import Any

import pytest

import swarmwright
from swarmwright import InputError, Run

library: Any = swarmwright  # mypy would refuse the calls
MINISIM = {"simulation": "minisim", "servers": "local"}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda _: library.compare("th_r"),
            r"^runs: must be a list of run folders, not 'th_r'; write \['th_r'\]$",
        ),
        (lambda _: library.compare(5), r"^runs: must be a list of run folders, not 5$"),
        (lambda _: library.compare([None]), r"^path: must be the path of a run folder, not "),
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
        (lambda _: library.optimize(None), r"^path: must be the path of an experiment file, not "),
        (
            lambda _: library.optimize(library.Experiment.from_mapping(MINISIM), out=7),
            r"^out: must be the path of a folder",
        ),
        (lambda _: library.resume(3), r"^run: must be the path of a run folder, not 3$"),
        (lambda run: library.resume(run, settings="a=1"), r"^settings: must be a list of settings"),
        (
            lambda _: library.evaluate("a.yaml", []),
            r"^experiment: .*not 'a.yaml'; write Experiment\.load\(file\)$",
        ),
        (lambda _: library.simulate(None), r"^experiment: must be of the class Experiment, not "),
        (
            lambda run: library.repeat(str(run.path)),
            r"^run: must be of the class Run, .*write Run\.open\(folder\)$",
        ),
        (
            lambda run: library.post_evaluate(run.path),
            r"^run: must be of the class Run, not an object of the class",
        ),
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
    ],
)
def test_wrong_arguments(call: Callable[[Run], Any], words: str, finished: Run) -> None:
    with pytest.raises(InputError, match=words):
        call(finished)
