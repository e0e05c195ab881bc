"""Methods and rankings that an experiment names by their files: copied and trusted as simulations."""

import json
import logging
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, RunError, compare, optimize, post_evaluate, resume, sweep
from swarmwright.common import warn_once
from swarmwright.runs.store.database import seal_facts
from swarmwright.simulations.user_code import trust
from swarmwright.testing import check_method, check_ranking
from tests.python.records import same_record
from tests.python.simulations.user_code.conftest import edit

SOURCE = '''
from typing import Literal

import numpy as np
from pydantic import Field
from scale_of_tests import SCALE

from swarmwright.methods import Method, MethodOptions
from swarmwright.methods.rankings import Ranking


class HillOptions(MethodOptions):
    """Mutated copies of the best genome so far."""

    kind: Literal["hill"] = "hill"
    population: int = Field(default=5, ge=1)
    """Copies in each generation."""


class Hill(Method):
    options_model = HillOptions

    def __init__(self, options, representation, *, seed):
        super().__init__(options, representation, seed=seed)
        self._best, self._value, self._fitness = None, -np.inf, np.empty(0)

    @property
    def budget(self):
        return self.options.population * self.options.generations

    @property
    def population_fitness(self):
        return self._fitness

    def _ask(self):
        candidates = range(self.options.population)
        if self._best is None:
            return self.initials(candidates)
        parents = np.tile(self._best, (len(candidates), 1))
        streams = self.streams("hill.mutate", candidates)
        return self.representation.mutations(parents, streams, severity=SCALE, probability=1.0)

    def _tell(self, genomes, fitness):
        self._fitness = fitness
        if not np.isnan(fitness).all() and fitness[np.nanargmax(fitness)] > self._value:
            self._best, self._value = genomes[np.nanargmax(fitness)], np.nanmax(fitness)


class Lowest(Ranking):
    def _score(self, episodes):
        return np.array([min(row) for row in episodes])


class Unfinished(Method):
    pass


class Unrelated:
    pass


def function():
    pass
'''
EXPERIMENT = """simulation: minisim
parameters: {placement: random}
controller: {kind: layered, hidden: []}
method: {kind: ../code/search.py:Hill, population: 4, generations: 3}
ranking: ../code/search.py:Lowest
validate: {episodes: 10, candidates: 1}
servers: local
"""
MARK = "import pathlib\npathlib.Path({!r}).touch()\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An experiment in a folder, its method and ranking in another one; the test works in a third."""
    for name in ("code", "experiments", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "code" / "search.py").write_text(SOURCE)
    (tmp_path / "code" / "scale_of_tests.py").write_text("SCALE = 0.25\n")
    (tmp_path / "experiments" / "e.yaml").write_text(EXPERIMENT)
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path


def load(folder: Path, *settings: str) -> Experiment:
    return Experiment.load(folder / "experiments" / "e.yaml", settings=settings)


def test_a_run_keeps_the_code_and_goes_on_with_it(folder: Path, tmp_path: Path) -> None:
    whole = optimize(load(folder, "method.generations=4"), out=tmp_path / "whole")
    run = optimize(load(folder, "method.generations=2"), out=tmp_path / "run")
    recorded = Experiment.load(run.path / "experiment.yaml")
    assert recorded.method.kind == f"{run.path.resolve()}/code/1/method/search.py:Hill"
    assert "code/1/ranking/search.py:Lowest" in (run.path / "experiment.yaml").read_text()
    for section in ("method", "ranking"):
        kept = sorted(path.name for path in (run.path / "code" / "1" / section).iterdir())
        assert kept == ["scale_of_tests.py", "search.py"]
    assert np.array_equal(run.record.fitness, run.record.episodes.min(axis=1))
    assert resume(run.path, generations=3).generations == 3
    # An edit is refused, also of what the class's file imports, and what is gone is not needed.
    edit(folder / "code" / "scale_of_tests.py", "0.25", "0.125")
    with pytest.raises(
        InputError, match=r"method search\.py:Hill has changed .*/scale_of_tests\.py was edited"
    ):
        resume(run.path, generations=4)
    shutil.rmtree(folder / "code")
    same_record(resume(run.path, generations=4), whole)


def test_an_accepted_change_is_used_and_kept(folder: Path, tmp_path: Path) -> None:
    run = optimize(load(folder), out=tmp_path / "run")
    edit(folder / "code" / "scale_of_tests.py", "0.25", "0.5")
    with pytest.raises(RunError, match=r"generation 1 is not reproducible .*/scale_of_tests\.py was"):
        resume(run.path, generations=4, accept_changed_code=True)
    edit(folder / "code" / "scale_of_tests.py", "0.5", "0.25  # as it was")
    run = resume(run.path, generations=4, accept_changed_code=True)
    assert sorted(run.code) == [1, 2]
    assert "code/2/method/search.py:Hill" in (run.path / "experiment.yaml").read_text()


def received(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a run that another user made, whose code notes that it is executed."""
    mark = MARK.format(str(tmp_path / "executed"))
    (folder / "code" / "search.py").write_text(mark + SOURCE)
    run = optimize(load(folder), out=tmp_path / "run").path
    shutil.rmtree(folder / "code")
    (tmp_path / "executed").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_granted", set())
    monkeypatch.setattr(warn_once, "_given", set())
    return run


def test_a_received_run_is_read_without_its_code(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = received(folder, tmp_path, monkeypatch)
    run = Run.open(path)
    assert len(run.record.fitness) == 12
    assert run.best.fitness == run.record.fitness.max()
    changed = run.experiment.replace(method={"generations": 5})
    assert changed.generations == 5
    with caplog.at_level(logging.WARNING, "swarmwright"):
        assert run.validation is None
    assert "held-out fitness is unavailable: it is computed by the ranking search.py:Lowest" in caplog.text
    uses: list[Any] = [
        lambda: resume(path, generations=4),
        lambda: post_evaluate(Run.open(path), episodes=2),
        run.experiment.new_method,
        run.experiment.new_ranking,
        lambda: Experiment.load(path / "experiment.yaml"),
    ]
    for use in uses:
        with pytest.raises(InputError, match=r"code/1/(method|ranking)/search\.py .* so it is not executed"):
            use()
    assert not (tmp_path / "executed").exists()
    assert Run.open(path, trust=True).validation is not None
    assert resume(path, generations=4).generations == 4


@pytest.mark.parametrize("section", ["method", "ranking"])
@pytest.mark.parametrize("name", ["../evil.py:Hill", "{}/evil.py:Hill", "code/1/evil.py:Hill"])
def test_other_code_that_a_store_names_is_not_executed(
    section: str, name: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = received(folder, tmp_path, monkeypatch)
    for place in (tmp_path, path / "code" / "1"):
        (place / "evil.py").write_text(MARK.format(str(tmp_path / "executed")) + SOURCE)
    store = sqlite3.connect(path / "run.sqlite")
    with store:
        (text,) = store.execute("SELECT value FROM fact WHERE name = 'experiment'").fetchone()
        values = json.loads(text)
        values[section]["kind"] = name.format(tmp_path)
        store.execute("UPDATE fact SET value = ? WHERE name = 'experiment'", [json.dumps(values)])
        seal_facts(store)
    store.close()
    run = Run.open(path)
    use = run.experiment.new_method if section == "method" else run.experiment.new_ranking
    with pytest.raises(InputError, match=r"evil\.py .*is code named by a run folder"):
        use()
    with pytest.raises(InputError):
        resume(path, generations=4)
    assert not (tmp_path / "executed").exists()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("method=search.py:Unfinished", r"search\.py:\d+: Unfinished lacks _ask, _tell, budget"),
        ("method=search.py:Unrelated", r"search\.py:\d+: Unrelated is not a subclass of .*methods\.Method"),
        ("method=search.py:function", r"search\.py:\d+: function is not a subclass of"),
        ("method=search.py:Hil", r"search\.py: has no class 'Hil'; did you mean 'Hill'\? available: Hill"),
        ("ranking=search.py:Hill", r"search\.py:\d+: Hill is not a subclass of .*rankings\.Ranking"),
        ("method=none.py:Hill", r"none\.py: there is no such file"),
        ("method=broken.py:Hill", r"broken\.py:2: "),
        (
            "method=failing.py:Hill",
            r"failing\.py:3: ZeroDivisionError while it is imported: division by zero",
        ),
        ("method={kind: search.py:Hill, popul: 3}", r"method\.popul: unknown key"),
        ("method={kind: search.py:Hill, population: 0}", r"method\.population: must be at least 1, not 0"),
        (
            "method=search.py",
            r"method=search\.py: .*; for a class in a file, write search\.py:Class",
        ),
        ("controller.kind=search.py:Hill", r"unknown controller"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(
    setting: str, words: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder / "code")
    Path("broken.py").write_text("import numpy\nclass Hill(:\n")
    Path("failing.py").write_text("import numpy\n\n1 / 0\n")
    with pytest.raises(InputError, match=words):
        load(folder, setting)


@pytest.mark.slow
def test_how_they_are_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "code")
    one = load(folder)
    assert one.method.kind == f"{folder.resolve()}/code/search.py:Hill"
    assert one.ranking.kind == f"{folder.resolve()}/code/search.py:Lowest"
    values = {"simulation": "minisim", "method": "search.py:Hill", "ranking": {"kind": "search.py:Lowest"}}
    assert Experiment.from_mapping(values).new_method().options.kind == one.method.kind
    assert load(folder, "method.kind=search.py:Hill").generations == 3
    assert Experiment.from_mapping(one.to_mapping()) == one
    jsonschema.validate(values, Experiment.json_schema())
    jsonschema.validate(one.to_mapping(), Experiment.json_schema())
    check_ranking("search.py:Lowest")


def test_an_edited_file_is_imported_anew(folder: Path) -> None:
    assert load(folder).method.model_dump()["population"] == 4
    edit(folder / "code" / "search.py", "Field(default=5", "Field(default=55")
    edit(folder / "experiments" / "e.yaml", "population: 4, ", "")
    assert load(folder).method.model_dump()["population"] == 55


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_it_passes_the_checks_of_methods(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder / "code")
    check_method("search.py:Hill")


@pytest.mark.slow
def test_sweeps_and_comparisons(folder: Path, tmp_path: Path) -> None:
    (folder / "code" / "sweep.yaml").write_text(
        "experiment: ../experiments/e.yaml\nseeds: [1]\n"
        "grid: {method.kind: [random_search, search.py:Hill]}\n"
    )
    found = sweep(folder / "code" / "sweep.yaml", out=tmp_path / "sweep")
    again = sweep(folder / "code" / "sweep.yaml", out=tmp_path / "sweep")
    assert [run.digest for run in again.runs] == [run.digest for run in found.runs]
    # The same code in copies of two runs is one group.
    runs = [optimize(load(folder, f"seed={seed}"), out=tmp_path / f"run-{seed}") for seed in (1, 2)]
    assert [len(group.runs) for group in compare(runs).groups] == [2]
