"""A run keeps the code that it was computed with, and goes on with no other unless that is wanted."""

import json
import logging
import shutil
import sqlite3
import sys
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, evaluate, optimize, repeat, resume
from swarmwright.runs.code import describe_edits
from swarmwright.runs.replay import Replay
from swarmwright.runs.store import StoreWriter
from swarmwright.runs.store.database import seal_facts
from swarmwright.runs.store.verification import verify
from swarmwright.simulations.names import files
from tests.python.records import same_record, seal
from tests.python.simulations.user_code.conftest import edit

FACTOR = ("return -self", "return -100 * self")
COPY = "code/1/simulation"


@pytest.fixture
def run(project: Path) -> Run:
    return optimize("gather.yaml", out=project / "run")


@pytest.mark.slow
def test_a_copy_of_the_source_is_kept(run: Run, project: Path) -> None:
    for name in ("gather.py", "helper.py"):
        assert (run.path / COPY / name).read_bytes() == (project / name).read_bytes()
    assert 'simulation: "code/1/simulation/gather.py:Gather"' in (run.path / "experiment.yaml").read_text()
    assert [one.code for one in run.sessions] == [1]
    assert list(run.code) == [1]
    assert describe_edits(run) == []


@pytest.mark.slow
def test_runs_verify_finds_an_edited_copy(run: Run) -> None:
    assert verify(run.path).problems == []
    edit(run.path / COPY / "gather.py", *FACTOR)
    (problem,) = verify(run.path).problems
    assert "gather.py: this copy of the run's code was edited" in problem.message
    shutil.rmtree(run.path / "code")
    assert verify(run.path).problems == [], "the store is whole without it"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gather.py", "helper.py"])
def test_a_run_does_not_go_on_with_edited_code(name: str, run: Run, project: Path) -> None:
    files = {path: path.read_bytes() for path in (run.path / "experiment.yaml", run.path / "best.json")}
    edit(project / name, *{"gather.py": FACTOR, "helper.py": ("0.1", "0.25")}[name])
    with pytest.raises(InputError) as caught:
        resume(run, generations=5)
    words = str(caught.value)
    assert f"simulation gather.py:Gather has changed since the run began: {name} was edited" in words
    assert f"--- run/{COPY}/{name}\n+++ {name}\n@@" in words
    assert "--accept-changed-code" in words
    assert {path: path.read_bytes() for path in files} == files
    assert (Run.open(run.path).digest, Run.open(run.path).sessions) == (run.digest, run.sessions)
    assert describe_edits(run) == [f"simulation gather.py:Gather: {name} was edited"]
    # Nothing would be evaluated: a finished run is returned as it is.
    same_record(resume(run), run)


def killed_at_its_end(run: Run) -> Run:
    """The run as it was after its last generation, before its end was noted."""
    with StoreWriter.resume(run.path) as store, store._writing():
        store._store.connection.execute("UPDATE session SET outcome = NULL, seconds = NULL")
        store._store.connection.execute("DELETE FROM fact WHERE name = 'ended'")
        seal_facts(store._store.connection)
    killed = Run.open(run.path)
    assert killed.state == "killed"
    return killed


@pytest.mark.slow
@pytest.mark.parametrize("missing", [True, False])
def test_an_end_that_is_missing_needs_no_code(missing: bool, run: Run, project: Path) -> None:
    killed = killed_at_its_end(run)
    edit(project / "gather.py", *FACTOR)
    if missing:
        (project / "gather.py").unlink()
        shutil.rmtree(run.path / "code")
    with pytest.raises(InputError, match="gather"):
        resume(killed, generations=5)
    assert Run.open(run.path).state == "killed"
    ended = resume(killed)
    assert ended.state == "done"
    same_record(ended, run)


@pytest.mark.slow
def test_a_change_that_is_accepted_is_recorded(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    edit(project / "gather.py", *FACTOR)
    longer = resume(run, generations=5, accept_changed_code=True)
    assert [one.code for one in longer.sessions] == [1, 2]
    assert [event.text for event in longer.events() if event.kind == "changed"] == [
        "changed code accepted from generation 3 on: gather.py was edited"
    ]
    assert not caplog.messages
    assert longer.record.fitness[-1] < -50 < longer.record.fitness[0]
    # Each generation is repeated by the code that evaluated it.
    assert repeat(longer, generation=4).same
    assert not caplog.messages
    assert repeat(longer, generation=0).same
    assert len(caplog.messages) == 1
    assert (
        "gather.py was edited since the run; its copy in the run folder is used; use --simulation"
        in caplog.messages[0]
    )
    # From then on it is the run's own code: it goes on without another word.
    assert resume(longer, generations=6).generations == 6


@pytest.mark.slow
def test_what_repeats_an_evaluation_says_so_and_uses_the_copy(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    edit(project / "helper.py", "0.1", "0.25")
    found = repeat(run)
    assert found.same
    assert len(caplog.messages) == 1
    assert "run: helper.py was edited since the run; its copy in the run folder is used" in caplog.messages[0]
    other = repeat(run, simulation="gather.py:Gather")
    assert not other.same
    with pytest.raises(InputError, match="is not a Python class"):
        repeat(run, simulation="gather.py")
    # Servers use it, too.
    assert repeat(run, servers=1).same


@pytest.mark.slow
def test_an_episode_that_is_shown_is_of_the_copy(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    edit(project / "gather.py", *FACTOR)
    assert Replay.of(run).experiment.simulation == f"{run.path / COPY}/gather.py:Gather"
    assert "gather.py was edited since" in caplog.text
    named = Replay.of(run, simulation="gather.py:Gather")
    assert named.experiment.simulation == f"{project}/gather.py:Gather"


@pytest.mark.slow
def test_a_run_that_moved_uses_its_copy(run: Run, project: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = resume(run, generations=5)
    expected = whole.digest
    fresh = optimize("gather.yaml", out=project / "fresh")
    place = project.parent / "elsewhere" / "deeper" / "moved"
    place.parent.mkdir(parents=True)
    shutil.move(fresh.path, place)
    for name in ("gather.py", "helper.py"):
        (project / name).unlink()
    assert repeat(Run.open(place)).same
    assert repeat(Run.open(place), servers=1).same
    assert resume(place, generations=5).digest == expected
    # The experiment in it can be run again, and its objects can be used as any others.
    again = optimize(Experiment.load(place / "experiment.yaml"), out=project / "again")
    assert again.digest == expected
    genome = Run.open(place).evaluation().genome
    assert evaluate(Run.open(place).experiment, [genome])[0] == Run.open(place).best.fitness
    assert not caplog.messages


@pytest.mark.slow
def test_a_file_beside_a_run_that_was_copied_is_not_ignored(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    there = project.parent / "there"
    there.mkdir()
    shutil.copytree(run.path, there / "copied")
    for name in ("gather.py", "helper.py"):
        shutil.copy(project / name, there)
    edit(there / "gather.py", *FACTOR)
    assert repeat(Run.open(there / "copied")).same
    assert (
        f"{there}/copied: {there}/gather.py was edited since the run; its copy in the run folder is used"
        in caplog.text
    )


def test_a_copy_and_the_file_have_each_their_own_modules(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = "    def step(self, actions):\n        from helper import GAIN\n\n"
    edit(project / "gather.py", "    def step(self, actions):\n", late)
    edit(project / "gather.py", "from helper import GAIN\nfrom swarm", "from swarm")
    run = optimize("gather.yaml", out=project / "run", servers="in-process")
    edit(project / "helper.py", "0.1", "0.25")
    genomes = [run.evaluation().genome]
    for first in (True, False):
        for name in ("helper", *[name for name in sys.modules if name.startswith("swarmwright simulation")]):
            sys.modules.pop(name, None)
        files.clear()
        monkeypatch.setattr("sys.path", [place for place in sys.path if not place.startswith(str(project))])
        if first:
            assert repeat(run, servers="in-process").same
        edited = evaluate(Experiment.load("gather.yaml"), genomes, servers="in-process")[0]
        assert edited != run.best.fitness
        assert repeat(run, servers="in-process").same
        assert evaluate(Experiment.load("gather.yaml"), genomes, servers="in-process")[0] == edited
        assert sys.modules["helper"].__file__ == str(project / "helper.py")
    assert not list(run.path.rglob("__pycache__"))


@pytest.mark.slow
def test_what_a_deleted_copy_was_is_known(run: Run, project: Path, caplog: pytest.LogCaptureFixture) -> None:
    shutil.rmtree(run.path / "code")
    assert repeat(Run.open(run.path)).same
    assert (
        "has no copy of its simulation's code, which has not changed; using the present gather.py:Gather"
        in caplog.text
    )
    longer = resume(run.path, generations=4)
    assert (longer.path / COPY / "gather.py").exists()
    assert ([one.code for one in longer.sessions], list(longer.code)) == ([1, 1], [1])
    shutil.rmtree(run.path / "code")
    edit(project / "gather.py", *FACTOR)
    with pytest.raises(InputError, match="it is not executed"):
        repeat(Run.open(run.path))
    assert not repeat(Run.open(run.path, trust=True)).same
    assert "which HAS changed; using the present gather.py:Gather" in caplog.text
    with pytest.raises(InputError, match=r"has changed since(.|\n)*--accept-changed-code"):
        resume(run.path, generations=5)
    assert resume(run.path, generations=5, accept_changed_code=True).sessions[-1].code == 2


@pytest.mark.slow
def test_a_copy_is_never_edited(run: Run, project: Path) -> None:
    edit(run.path / COPY / "helper.py", "0.1", "0.25")
    assert repeat(run).same  # what it was copied from is still the same
    (project / "gather.py").rename(project / "gone.py")
    with pytest.raises(InputError, match=r"simulation/helper\.py: this copy of the run's code was edited"):
        repeat(run)
    assert repeat(run, simulation="gone.py:Gather").same
    edit(run.path / "code/1/manifest.json", "helper.py", "helpers.py")
    with pytest.raises(InputError, match="code/1: the run's copy of the code was changed"):
        repeat(run)
    assert repeat(run, simulation="gone.py:Gather").same


@pytest.mark.slow
@pytest.mark.parametrize("place", ["../../../../secret.py", "/etc/passwd"])
def test_a_manifest_leads_nowhere_else(place: str, run: Run, project: Path) -> None:
    (project.parent / "secret.py").write_text("")
    file = run.path / "code/1/manifest.json"
    values = json.loads(file.read_text())
    values["parts"]["simulation"]["sha256"][place] = "0" * 64
    file.write_text(json.dumps(values))
    with pytest.raises(InputError, match=r"manifest\.json: damaged manifest: .* is outside the copy"):
        repeat(run)
    from swarmwright.runs.folders import remove_run

    remove_run(run.path)
    assert (project.parent / "secret.py").exists()


@pytest.mark.slow
def test_a_deleted_run_leaves_what_is_not_its_own(run: Run) -> None:
    from swarmwright.runs.folders import remove_run

    (run.path / COPY / "notes.txt").write_text("mine")
    assert remove_run(run.path) == ["code"]
    assert [path.name for path in run.path.rglob("*") if path.is_file()] == ["notes.txt"]


@pytest.mark.slow
def test_code_that_does_not_fit_the_run_is_not_accepted(run: Run, project: Path) -> None:
    edit(project / "gather.py", '"gather", 2, 2', '"gather", 3, 2  # more')
    with pytest.raises(InputError, match=r"has 3 sensors, but the run's controllers need 2"):
        resume(run, generations=5, accept_changed_code=True)


@pytest.mark.slow
def test_another_class_is_another_code(run: Run, project: Path) -> None:
    with (project / "gather.py").open("a") as file:
        file.write("\n\nclass Other(Gather):\n    pass\n")
    shutil.copy(project / "gather.py", project / "named.py")
    with pytest.raises(InputError, match=r"class Other instead of Gather"):
        resume(run, generations=5, simulation="named.py:Other")
    longer = resume(run, generations=5, simulation="named.py:Other", accept_changed_code=True)
    assert longer.experiment.simulation == f"{run.path}/code/2/simulation/named.py:Other"
    assert repeat(longer).same


def without_copy(run: Run, project: Path) -> Path:
    """Make of a run one that keeps no copy of its code."""
    shutil.rmtree(run.path / "code")
    for name in ("code/1/simulation/gather.py",):
        edit(run.path / "experiment.yaml", name, str(project / "gather.py"))
    with sqlite3.connect(run.path / "run.sqlite") as store:
        store.execute("DELETE FROM fact WHERE name = 'code.1'")
        store.execute("UPDATE session SET code = NULL")
        store.execute(
            "UPDATE fact SET value = replace(value, ?, ?) WHERE name = 'experiment'",
            ("code/1/simulation/gather.py", str(project / "gather.py")),
        )
    store.close()
    seal(run.path)
    return run.path


@pytest.mark.slow
def test_a_run_without_a_copy_of_its_code_is_read_and_resumed(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = without_copy(run, project)
    assert repeat(Run.open(folder)).same
    assert caplog.messages == [
        f"{folder}: has no copy of its simulation's code; using the present gather.py:Gather"
    ]
    longer = resume(folder, generations=5)
    assert "changes since its start cannot be detected" in caplog.messages[-1]
    assert [one.code for one in longer.sessions] == [None, 1]
    assert (folder / COPY / "helper.py").exists()
    edit(project / "gather.py", *FACTOR)
    with pytest.raises(InputError, match="has changed since"):
        resume(folder, generations=6)
    caplog.clear()
    assert repeat(Run.open(folder), generation=0).same
    assert "generation 0 was evaluated before the run had a copy of its code" in caplog.messages[0]


@pytest.mark.slow
def test_a_run_of_an_earlier_version_whose_file_is_gone(
    run: Run, project: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = without_copy(run, project)
    (project / "gather.py").rename(project / "gone.py")
    for use in (repeat, Replay.of):
        with pytest.raises(
            InputError, match=r"code of its simulation.* is missing.*--simulation FILE:Gather"
        ):
            use(Run.open(folder))
    with pytest.raises(InputError, match=r"code of its simulation.* is missing.*--simulation FILE:Gather"):
        resume(folder, generations=5)
    assert repeat(Run.open(folder), simulation="gone.py:Gather").same
    # Whoever moves the folder and puts the file beside it means that one, wherever the old one is.
    shutil.copy(project / "gone.py", project / "gather.py")
    edit(project / "gather.py", *FACTOR)
    there = project.parent / "there"
    there.mkdir()
    shutil.copytree(folder, there / "copied")
    shutil.copy(project / "gone.py", there / "gather.py")
    shutil.copy(project / "helper.py", there / "helper.py")
    assert repeat(Run.open(there / "copied")).same
    assert f"using the present {there}/gather.py:Gather" in caplog.text


@pytest.mark.slow
def test_a_package_with_modules_of_its_own(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = project / "swarm_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    shutil.move(project / "helper.py", package / "helper.py")
    (package / "gather.py").write_text(
        (project / "gather.py").read_text().replace("from helper", "from .helper")
    )
    (project / "gather.yaml").write_text(
        (project / "gather.yaml").read_text().replace("gather.py:", "swarm_package.gather:")
    )
    monkeypatch.syspath_prepend(str(project))
    run = optimize("gather.yaml", out=project / "run")
    assert run.experiment.simulation.endswith("/code/1/simulation/swarm_package/gather.py:Gather")
    edit(package / "helper.py", "0.1", "0.25")
    with pytest.raises(InputError, match=r"swarm_package/helper\.py was edited"):
        resume(run, generations=4)
    assert repeat(run).same  # although the other one has been imported in this process
    shutil.rmtree(package)
    assert repeat(run, servers=1).same


@pytest.mark.slow
def test_an_edited_file_is_imported_anew(project: Path) -> None:
    experiment = Experiment.load("gather.yaml")
    genomes = [[0.1] * experiment.genome_size]
    before = evaluate(experiment, genomes)[0]
    edit(project / "helper.py", "0.1", "0.25")
    edit(project / "gather.py", *FACTOR)
    after = evaluate(experiment, genomes)[0]
    assert after < 50 * before
    (project / "helper.py").write_text("GAIN = 0.1\n\n")
    assert evaluate(experiment, genomes)[0] == 100 * before


@pytest.mark.parametrize("installed", [True, False])
def test_a_plug_in_that_was_edited(installed: bool, project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from swarmwright.common.registry import Registry
    from swarmwright.methods.plug_ins import REGISTRIES
    from swarmwright.methods.rankings import RANKINGS

    site = project / "site"
    source = site if installed else project / "source"
    information = site / "coded_ranking-1.0.dist-info"
    information.mkdir(parents=True)
    source.mkdir(exist_ok=True)
    (source / "coded_ranking.py").write_text(
        "from typing import Literal\n"
        "from swarmwright.methods.rankings.absolute import Absolute, AbsoluteOptions\n\n"
        "class Options(AbsoluteOptions):\n"
        '    """Absolute by another name."""\n\n'
        '    kind: Literal["coded"] = "coded"\n\n'
        "class Coded(Absolute):\n"
        '    kind = "coded"\n'
        "    options_model = Options\n"
    )
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: coded_ranking\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[swarmwright.rankings]\ncoded = coded_ranking:Coded\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.syspath_prepend(str(source))
    registry: Registry[Any] = Registry(
        "ranking", RANKINGS.group, RANKINGS.built_in, "swarmwright.methods.rankings:Ranking"
    )
    monkeypatch.setitem(REGISTRIES, "ranking", registry)
    values = {"simulation": "minisim", "ranking": {"kind": "coded"}, "servers": "local"}
    experiment = Experiment.from_mapping({**values, "method": {"population": 4, "generations": 2}})
    run = optimize(experiment, out=project / "run")
    assert (run.path / "code/1/ranking/coded_ranking.py").exists()
    assert resume(run, generations=3).generations == 3
    with (source / "coded_ranking.py").open("a") as file:
        file.write("\n# edited\n")
    with pytest.raises(InputError, match=r"ranking coded has changed since .*coded_ranking\.py was edited"):
        resume(run, generations=4)
    with pytest.MonkeyPatch.context() as patch:
        warned: list[str] = []
        patch.setattr(logging.getLogger("swarmwright"), "warning", lambda _, text: warned.append(text))
        assert repeat(run).same
    assert warned == [
        "run: ranking coded: site/coded_ranking.py was edited since; using the present version"
    ] or (not installed and "source/coded_ranking.py was edited since" in warned[0])
