"""Files that a simulation reads are kept with a run, compared with it, and travel with the code."""

import json
import shutil
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pytest

from swarmwright import InputError, Run, optimize, post_evaluate, repeat, resume
from swarmwright.runs.store.verification import verify
from swarmwright.servers.evaluation.launched.starting import pack_code
from swarmwright.servers.launchers import LAUNCHERS, Health, Launcher, LauncherOptions
from swarmwright.servers.launchers._slot import End, Slot
from tests.python.records import same_record
from tests.python.simulations.user_code.conftest import edit

COPY = "code/1/simulation"


class AwayOptions(LauncherOptions):
    """None of its own."""

    launcher: Literal["away"] = "away"


class Away(Launcher):
    """Servers that have what was packed, and nothing else: as those on other machines."""

    kind = "away"
    options_model = AwayOptions
    interval = 0.2

    def __init__(self, options: Any, specification: Any) -> None:
        super().__init__(options, specification)
        self.slots: dict[int, Slot] = {}
        self.threads: dict[int, threading.Thread] = {}
        self.ends: dict[int, End] = {}

    def start(self, servers: Sequence[int]) -> None:
        for server in servers:
            slot = self.slots[server] = Slot(self.specification, server, self.options.code)
            self.threads[server] = threading.Thread(
                target=lambda server=server, slot=slot: self.ends.update({server: slot.run()})
            )
            self.threads[server].start()

    def health(self) -> Mapping[int, Health]:
        return {
            server: Health("ended", self.ends[server].words) if server in self.ends else Health("running")
            for server in self.slots
        }

    def logs(self, server: int, lines: int = 20) -> Sequence[str]:
        return self.slots[server].tail(lines) if server in self.slots else ()

    def stop(self, servers: Sequence[int]) -> None:
        for server in servers:
            slot = self.slots.pop(server, None)
            if slot is not None:
                slot.stop()
                self.threads[server].join()

    def close(self) -> None:
        self.stop(list(self.slots))


@pytest.fixture(autouse=True)
def reading(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulation reads a map beside it."""
    monkeypatch.setitem(LAUNCHERS._loaded, "away", Away)
    (project / "maps").mkdir()
    (project / "maps" / "a.json").write_text(json.dumps({"gain": 100.0}))
    edit(project / "gather.py", "return -self", "return -GAIN_OF_MAP * self")
    edit(
        project / "gather.py",
        "class Gather",
        "import json, pathlib\n"
        'FILE = pathlib.Path(__file__).parent / "maps" / "a.json"\n'
        'GAIN_OF_MAP = json.loads(FILE.read_text())["gain"]\n\n\nclass Gather',
    )
    files = "servers: {launcher: away, files: [maps/*.json], broker_host: 127.0.0.1}"
    edit(project / "gather.yaml", "servers: local", files)


@pytest.fixture
def run(project: Path) -> Run:
    return optimize("gather.yaml", out=project / "run", servers="in-process", progress=False)


def without_original(run: Run, project: Path) -> Run:
    """As when only the run folder was copied to another machine."""
    for name in ("gather.py", "helper.py"):
        (project / name).unlink()
    shutil.rmtree(project / "maps")
    return Run.open(run.path, trust=True)


def test_a_run_keeps_the_files(run: Run, project: Path) -> None:
    assert (run.path / COPY / "maps" / "a.json").read_bytes() == (project / "maps" / "a.json").read_bytes()
    assert verify(run.path).problems == []
    edit(run.path / COPY / "maps" / "a.json", "100.0", "7")
    (problem,) = verify(run.path).problems
    assert "a.json: this copy of the run" in problem.message


@pytest.mark.slow
@pytest.mark.timeout(120)
@pytest.mark.parametrize("is_there", [True, False])
def test_a_launcher_goes_on_with_a_run(run: Run, project: Path, is_there: bool) -> None:
    if not is_there:
        run = without_original(run, project)
    other = shutil.copytree(run.path, project / "other")
    longer = resume(run, generations=4, progress=False)
    assert "1 by away" in longer.sessions[-1].place
    same_record(longer, resume(other, generations=4, servers="in-process", progress=False))
    assert repeat(longer, servers="away:1").same
    here, away = (post_evaluate(longer, episodes=2, servers=one) for one in ("in-process", "away:1"))
    assert here.fitness == away.fitness


@pytest.mark.parametrize("is_there", [True, False])
def test_a_module_is_called_as_before(project: Path, monkeypatch: pytest.MonkeyPatch, is_there: bool) -> None:
    (project / "swarms").mkdir()
    (project / "swarms" / "__init__.py").write_text("")
    (project / "gather.py").rename(project / "swarms" / "gather.py")
    edit(project / "swarms" / "gather.py", "parent /", "parent.parent /")
    edit(project / "gather.yaml", "gather.py:Gather", "swarms.gather:Gather")
    monkeypatch.syspath_prepend(project)
    run = optimize("gather.yaml", out=project / "run", servers="in-process", progress=False)
    before = pack_code("swarms.gather:Gather", [], AwayOptions(files=["maps/*.json"]))
    assert before[0] == "swarms.gather:Gather"
    if not is_there:
        run = Run.open(shutil.copytree(run.path, project.parent / "elsewhere" / "run"), trust=True)
        shutil.rmtree(project / "maps")
    assert pack_code(run.experiment.simulation, [], AwayOptions(files=["maps/*.json"])) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda maps: edit(maps / "a.json", "100.0", "7"), "maps/a.json was edited"),
        (lambda maps: (maps / "b.json").write_text("{}"), "maps/b.json is new"),
        (lambda maps: (maps / "a.json").rename(maps / "a.txt"), "maps/a.json was deleted"),
    ],
)
def test_a_run_does_not_go_on_with_other_files(run: Run, project: Path, change: Any, words: str) -> None:
    change(project / "maps")
    with pytest.raises(InputError, match=f"has changed since the run began: {words}"):
        resume(run, generations=4, progress=False)
    # What is repeated is repeated with the files of the run.
    assert repeat(Run.open(run.path), generation=0, servers="in-process").same
    if (project / "maps" / "a.json").exists():
        accepted = resume(run, generations=4, servers="local", accept_changed_code=True, progress=False)
        assert [one.code for one in accepted.sessions] == [1, 2]
        assert any(words in event.text for event in accepted.events() if event.kind == "changed")


@pytest.mark.slow
def test_files_that_other_entries_name_change_nothing(run: Run) -> None:
    longer = resume(run, generations=4, settings=["servers=2"], progress=False)
    assert [one.code for one in longer.sessions] == [1, 1]


def test_missing_files_are_named_before_anything_is_started(project: Path) -> None:
    edit(project / "gather.yaml", "maps/*.json", "map/*.json")
    with pytest.raises(InputError, match=r"servers: files: there is no file map/\*\.json in .*project"):
        optimize("gather.yaml", out=project / "run", servers="in-process", progress=False)
    assert not (project / "run").exists()


def test_runs_beside_the_simulation_are_none_of_its_files(project: Path) -> None:
    edit(project / "gather.yaml", "[maps/*.json]", "[ '**/*.json' ]")
    for name in (".tool", "__pycache__"):
        (project / name).mkdir(exist_ok=True)
        (project / name / "state.json").write_text("{}")
    for name in ("one", "two"):
        run = optimize("gather.yaml", out=project / "runs" / name, servers="in-process", progress=False)
        (copied,) = (run.path / COPY).rglob("*.json")
        assert copied == run.path / COPY / "maps" / "a.json"
    longer = resume(run, generations=4, servers="in-process", progress=False)
    assert [one.code for one in longer.sessions] == [1, 1]
    # A folder that is named is meant.
    home = project / "gather.py"
    options = AwayOptions(files=[".tool/*.json", "runs/one/best.json"])
    _, _, code = pack_code(f"{home}:Gather", [], options)
    assert code is not None
    code.unpack(project / "new")
    found = {path.relative_to(project / "new").as_posix() for path in (project / "new").rglob("*.json")}
    assert found == {".tool/state.json", "runs/one/best.json"}
    with pytest.raises(InputError, match=r"there is no file runs/.*; wildcards skip run folders"):
        pack_code(f"{home}:Gather", [], AwayOptions(files=["runs/*/best.json"]))


@pytest.mark.parametrize("pattern", ["link/*.txt", "maps/secret.*"])
def test_patterns_do_not_follow_links_out_of_the_folder(run: Run, project: Path, pattern: str) -> None:
    outside = project.parent / "elsewhere"
    outside.mkdir()
    (outside / "secret.txt").write_text("secret")
    (project / "link").symlink_to(outside)
    (project / "maps" / "secret.txt").symlink_to(outside / "secret.txt")
    with pytest.raises(InputError, match=r"servers: files: .*secret\.txt is a link to"):
        pack_code(f"{project}/gather.py:Gather", [], AwayOptions(files=[pattern]))
    with_patterns(run, [pattern, "maps/*.json"])
    assert resume(run, generations=4, servers="in-process", progress=False).generations == 4


def test_links_within_the_folder_are_followed(project: Path) -> None:
    (project / "link").symlink_to(project / "maps")
    _, _, code = pack_code(f"{project}/gather.py:Gather", [], AwayOptions(files=["link/*.json"]))
    assert code is not None
    code.unpack(project / "new")
    assert (project / "new" / "link" / "a.json").read_bytes() == (project / "maps/a.json").read_bytes()


def test_what_is_no_pattern_is_an_error_of_the_experiment_alone(run: Run, project: Path) -> None:
    edit(project / "gather.yaml", "maps/*.json", "a**b")
    with pytest.raises(InputError, match=r"servers: files: .*a\*\*b"):
        optimize("gather.yaml", out=project / "other", servers="in-process", progress=False)
    with_patterns(run, ["a**b", "maps/*.json"])
    assert resume(run, generations=4, servers="in-process", progress=False).generations == 4


def with_patterns(run: Run, patterns: list[str]) -> None:
    """Write other patterns into the manifest of a run's copy."""
    manifest = run.path / "code" / "1" / "manifest.json"
    values = json.loads(manifest.read_text())
    values["parts"]["simulation"]["patterns"] = patterns
    manifest.write_text(json.dumps(values))


def test_patterns_of_a_manifest_do_not_lead_out_of_the_folder(run: Run, project: Path) -> None:
    (project.parent / "secret.txt").write_text("secret")
    with_patterns(run, ["../*.txt", f"{project.parent}/*.txt", ""])
    with pytest.raises(InputError, match=r"maps/a\.json was deleted") as caught:
        resume(run, generations=4, progress=False)
    assert "secret" not in str(caught.value)
