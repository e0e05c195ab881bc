"""Bundles: what is in them, and what their check notices."""

import csv
import hashlib
import io
import json
import shutil
import stat
import zipfile
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.common.revision import revision
from swarmwright.experiment.opponents import load_opponent
from swarmwright.export import EXPORTERS
from swarmwright.export.bundle import _strip_folders, export_bundle, parse_episodes, verify_bundle
from swarmwright.export.c import C
from swarmwright.export.subject import load_subject
from tests.python.simulations.pursuit import Pursuit

MINISIM: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "ranking": {"episodes": 2}, "validate": {"episodes": 12},
    "parameters": {"placement": "random", "numAgents": 2},
    "controller": {"kind": "fully_meshed", "hidden": 2, "activation": "tanh"},
    "method": {"kind": "nnga", "population": 20, "generations": 30},
}  # fmt: skip
RULE: dict[str, Any] = {
    **MINISIM, "parameters": {"steering": "rule", "placement": "random"},
    "controller": {"kind": "parameter_set", "parameters": {
        "avoidance": {"type": "real", "range": [0, 5]},
        "evasion": {"type": "categorical", "choices": ["left", "right"]},
    }},
}  # fmt: skip
Files = dict[str, bytes]


@pytest.fixture(scope="module")
def rule(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that evolved parameters, whose forms are verified fast."""
    out = tmp_path_factory.mktemp("runs") / "rule"
    return swarmwright.optimize(swarmwright.Experiment.from_mapping(RULE), out=out)


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("runs") / "robots"
    return swarmwright.optimize(swarmwright.Experiment.from_mapping(MINISIM), out=out)


@pytest.fixture(scope="module")
def bundle(network: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One whose forms are C alone, which takes less time."""
    file = tmp_path_factory.mktemp("bundles") / "robots.zip"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EXPORTERS, "names", lambda: ["c"])
        export_bundle(network, file)
    return file


def read(file: Path) -> Files:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write(file: Path, files: Files, *, sealed: bool) -> None:
    """Write an archive; sealed: with a manifest that fits it, as one who knows what it does would."""
    if sealed:
        manifest = json.loads(files["manifest.json"])
        manifest["files"] = {
            name: {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in files.items()
            if name != "manifest.json"
        }
        files = {**files, "manifest.json": json.dumps(manifest).encode()}
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)


@pytest.mark.slow
def test_the_program_writes_all_forms(program: Any, rule: Run, tmp_path: Path) -> None:
    (tmp_path / "topics.yaml").write_text("heading: cmd_vel\n")
    made = program("export", rule.path, "--bundle", "rule.zip", "--mapping", "topics.yaml", "--json")
    assert made.returncode == 0, made.stderr
    told = json.loads(made.stdout)
    assert all(found["ok"] for found in told["verified"].values())
    assert {"c", "cpp", "python"} <= told["verified"].keys()
    assert {*told["verified"], *told["unverified"], *told["without"]} == set(EXPORTERS.names())
    files = read(tmp_path / "rule.zip")
    assert hashlib.sha256(files["manifest.json"]).hexdigest() == told["digest"]
    assert files["mapping.yaml"] == b"heading: cmd_vel\n"
    assert b"Permission to use" in files["LICENSE.txt"]
    checked = program("verify", "rule.zip", "--json")
    assert checked.returncode == 0, checked.stderr
    found = json.loads(checked.stdout)
    assert found["digest"] == told["digest"]
    assert found["files"] == len(files) - 1
    assert found["forms"].keys() == told["verified"].keys()
    assert found["largest_difference"] == 0


@pytest.mark.slow
def test_fmus_hold_their_source_alone(network: Run, tmp_path: Path) -> None:
    """A library would be for one kind of machine; that of the receiver is compiled to verify them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EXPORTERS, "names", lambda: ["fmu", "fmu3"])
        made = export_bundle(network, tmp_path / "fmus.zip")
        checked = verify_bundle(made.file)
    assert made.verified.keys() == checked.forms.keys() == {"fmu", "fmu3"}
    assert checked.ok, checked.problems
    for form in made.verified:
        with zipfile.ZipFile(io.BytesIO(read(made.file)[f"{form}/controller.fmu"])) as archive:
            infos = archive.infolist()
        assert "sources/controller_fmu.c" in [one.filename for one in infos]
        assert not [one for one in infos if one.filename.startswith("binaries/")]
        # Whatever the version of zlib, these are the same bytes.
        assert {one.compress_type for one in infos} == {zipfile.ZIP_STORED}


def test_a_format_of_compiled_code_alone_is_left_out(network: Run, tmp_path: Path) -> None:
    class Compiled(C):
        form = "firmware"
        compiled = True

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EXPORTERS, "names", lambda: ["firmware"])
        patch.setattr(EXPORTERS, "get", lambda _: Compiled)
        made = export_bundle(network, tmp_path / "x.zip")
    assert made.without == {
        "firmware": "compiled for one kind of machine; export it on the target machine with --to firmware"
    }


@pytest.mark.journey
def test_the_program_verifies(program: Any, bundle: Path) -> None:
    result = program("verify", bundle)
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].startswith(f"{bundle}: SHA-256 of the manifest ")
    assert "Evaluated again in 14 episodes" in lines  # those with held-out seeds among them
    assert lines[-1] == "Verified: largest difference 0 (c)"


@pytest.mark.slow
def test_the_same_candidate_is_the_same_archive(network: Run, bundle: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EXPORTERS, "names", lambda: ["c"])
        export_bundle(network, tmp_path / "again.zip")
        other = export_bundle(network, tmp_path / "other.zip", generation=0, candidate=3)
    assert repr(other) == f"<Bundle {tmp_path / 'other.zip'}: c compared with the simulation>"
    assert deepcopy(other) == other
    assert (tmp_path / "again.zip").read_bytes() == bundle.read_bytes()
    assert json.loads(read(other.file)["evaluation.json"])["held_out"] is None  # these are of the best


def test_episodes_are_a_table_with_every_bit(network: Run, bundle: Path) -> None:
    files, episodes = read(bundle), load_subject(network).episodes
    assert episodes is not None
    text = files["episodes.csv"].decode()
    assert text.splitlines()[0] == "begins,goal x,goal y,defender x,defender y,heading"
    again = parse_episodes(text, 4, 1)
    for name in ("first", "sensors", "actuators", "accepted"):
        np.testing.assert_array_equal(getattr(again, name), getattr(episodes, name))


ODD = """
import numpy as np
from swarmwright import Simulation

class Odd(Simulation):
    title, sensors, actuators = "odd", 2, 1
    sensor_names, actuator_names = ["gr\u00f6\u00dfe", 'a\\\\, "b"'], ["heading"]
    sensor_units, sensor_ranges, actuator_ranges = ["m", "m"], [(0, 10), None], [(-30, 30, "rad/s")]

    def reset(self, parameters, seed):
        self.numbers, self.left = np.random.default_rng(seed), 4
        return self.numbers.uniform(-1, 1, (2, 2))

    def step(self, actions):
        self.left -= 1
        return self.numbers.uniform(-1, 1, (2, 2))

    def done(self):
        return self.left == 0

    def fitness(self):
        return 1.0
"""


@pytest.mark.slow
@pytest.mark.timeout(180)
def test_where_the_run_was_is_not_in_it(program: Any, tmp_path: Path) -> None:
    """With the code of a user, which the run has a copy of."""
    (tmp_path / "odd.py").write_text(ODD, encoding="utf-8")
    (tmp_path / "odd.yaml").write_text(
        "simulation: odd.py:Odd\nservers: in-process\ncontroller: {kind: layered, hidden: [1]}\n"
        "method: {kind: nnga, population: 6, generations: 1}\n"
    )
    (tmp_path / "one").mkdir()
    made = program("optimize", "odd.yaml", "--out", "one/run")
    assert made.returncode == 0, made.stderr
    shutil.copytree(tmp_path / "one" / "run", tmp_path / "another" / "run")
    for folder in ("one", "another"):
        exported = program("export", f"{folder}/run", "--bundle", f"{folder}.zip", "--trust")
        assert exported.returncode == 0, exported.stderr
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "another.zip").read_bytes()
    files = read(tmp_path / "one.zip")
    assert json.loads(files["evaluation.json"])["experiment"]["simulation"] == "odd.py:Odd"
    manifest = json.loads(files["manifest.json"])
    assert manifest.get("commit") == revision()
    assert manifest["sensors"][0]["range"] == {"low": 0, "high": 10, "unit": "m"}
    assert "range" not in manifest["sensors"][1]
    assert manifest["actuators"] == [
        {
            "name": "heading",
            "unit": "",
            "limits": "-1 to 1 for -30 to 30 rad/s",
            "range": {"low": -30, "high": 30, "unit": "rad/s"},
        }
    ]
    assert b"-1 to 1 for 0 to 10 m, scaled: " in files["c/controller.h"]
    assert not [name for name, data in files.items() if str(tmp_path).encode() in data]
    assert next(csv.reader(io.StringIO(files["episodes.csv"].decode()))) == [
        "begins", "gr\u00f6\u00dfe", 'a\\, "b"', "heading",
    ]  # fmt: skip
    checked = program("verify", "one.zip")
    assert checked.returncode == 0, checked.stdout
    assert str(tmp_path) not in checked.stdout
    assert "Not evaluated again: the simulation odd.py:Odd is not built in" in checked.stdout


def test_machines_and_folders_are_left_out() -> None:
    run = Path("/home/ada/runs/best")
    values = {
        "simulation": {
            "command": ["./sim", "--world=/home/ada/runs/best/code/1/w"],
            "folder": str(run / "code"),
        },
        "parameters": {"broker": "a parameter", "topic": "/scan", "from": "/home/ada/runs/best2/x"},
        "start_from": [{"from": "/home/ada/x, candidate 1 of generation 2", "weights": [1.0]}],
        "ranking": {"opponents": {"left": [{"from": "/home/ada/their.zip"}, {"from": "a/b.json"}]}},
        "controller": {"behaviours": ["/elsewhere/own.py:Wander", "stop"]},
        "servers": [{"launcher": "ssh", "hosts": ["ada@node1"]}],
        "broker": "mqtt://broker.lab",
        "validate": {"to": [{"name": "robots", "servers": {"launcher": "slurm"}, "broker": "mqtts://b"}]},
        "prefix": "",
    }
    assert _strip_folders(values, run) == {
        "simulation": {"command": ["./sim", "--world=code/1/w"], "folder": "code"},
        "parameters": values["parameters"],
        "controller": {"behaviours": ["own.py:Wander", "stop"]},
        "start_from": [{"from": "x, candidate 1 of generation 2", "weights": [1.0]}],
        "ranking": {"opponents": {"left": [{"from": "their.zip"}, {"from": "b.json"}]}},
        "validate": {"to": [{"name": "robots"}]},
        "prefix": "",
    }
    assert _strip_folders({"servers": "local", "folder": str(run)}, run) == {
        "servers": "local",
        "folder": ".",
    }


def _comment(files: Files) -> None:
    files["c/controller.c"] += b"/* harmless */\n"


def _weight(files: Files) -> None:
    controller = json.loads(files["controller.json"])
    controller["weights"][0] += 1.0
    files["controller.json"] = json.dumps(controller).encode()


def _fitness(files: Files) -> None:
    evaluation = json.loads(files["evaluation.json"])
    evaluation["episodes"][1] += 0.5
    files["evaluation.json"] = json.dumps(evaluation).encode()


def _mean(files: Files) -> None:
    evaluation = json.loads(files["evaluation.json"])
    evaluation["fitness"] += 800.0
    files["evaluation.json"] = json.dumps(evaluation).encode()


def _mean_everywhere(files: Files) -> None:
    """As one would who knows that the manifest and the forms say it, too."""
    fitness = json.loads(files["evaluation.json"])["fitness"]
    _mean(files)
    for name, data in files.items():
        said, wrong = (f"{value!r} (mean of".encode() for value in (fitness, fitness + 800.0))
        files[name] = data.replace(said, wrong)


def _held_out(files: Files) -> None:
    evaluation = json.loads(files["evaluation.json"])
    evaluation["held_out"]["episodes"][3] = -1.25
    files["evaluation.json"] = json.dumps(evaluation).encode()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_comment, "c: its files differ from an export of the controller"),
        (_weight, " actuators differ from those of the controller"),
        (_fitness, "evaluation.json: the fitness in the episode with seed 1 is "),
        (_mean, "manifest.json: the fitness is '"),
        (_mean_everywhere, "but its episodes give "),
        (_held_out, "evaluation.json: the fitness in the episode with seed 1000"),
    ],
)
def test_what_was_changed_is_noticed(
    bundle: Path, tmp_path: Path, change: Callable[[Files], None], words: str
) -> None:
    """Also where the manifest was changed with it; and changed code is not executed."""
    files = read(bundle)
    change(files)
    write(tmp_path / "changed.zip", files, sealed=False)
    found = verify_bundle(tmp_path / "changed.zip")
    assert repr(found) == f"<BundleVerification of {tmp_path / 'changed.zip'}: {found}>"
    assert not found.ok
    assert {problem.partition(": ")[2][:27] for problem in found.problems} == {"was changed; its SHA-256 di"}
    write(tmp_path / "sealed.zip", files, sealed=True)
    found = verify_bundle(tmp_path / "sealed.zip")
    assert not found.ok
    assert any(words in problem for problem in found.problems), found.problems
    assert change is not _comment or "c" not in found.forms


def bundled(others: dict[str, Any], place: Path) -> swarmwright.Run:
    """A run beside its bundle, which has the controller in Python alone."""
    experiment = swarmwright.Experiment.from_mapping({**MINISIM, **others})
    run = swarmwright.optimize(experiment, out=place.parent / "run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(EXPORTERS, "names", lambda: ["python"])
        export_bundle(run, place)
    return run


@pytest.mark.slow
@pytest.mark.parametrize(
    "others",
    [
        {"method": {"kind": "racing", "evaluations": 300, "survivors": 4}},
        {"ranking": {"episodes": 2, "seeds": "new", "reevaluate": True, "aggregate": "median"}},
    ],
)
def test_all_evaluations_of_a_fitness_are_in_it(others: dict[str, Any], tmp_path: Path) -> None:
    run = bundled(others, tmp_path / "all.zip")
    files = read(tmp_path / "all.zip")
    evaluation = json.loads(files["evaluation.json"])
    results = [*(part["episodes"] for part in evaluation["earlier"]), evaluation["episodes"]]
    assert len(results) > 2
    by_instance = [np.mean(part) for part in results]
    made = np.mean(by_instance) if "method" in others else np.median(np.concatenate(results))
    assert made == pytest.approx(run.best.fitness)
    facts = dict(json.loads(files["manifest.json"])["facts"])
    assert facts["Fitness"].startswith(f"{run.best.fitness!r} (me")
    found = verify_bundle(tmp_path / "all.zip")
    assert found.ok, found.problems
    assert found.episodes >= 2 * len(results)
    evaluation["earlier"][1]["episodes"][0] += 1.0
    files["evaluation.json"] = json.dumps(evaluation).encode()
    write(tmp_path / "sealed.zip", files, sealed=True)
    assert len(verify_bundle(tmp_path / "sealed.zip").problems) >= 1


@pytest.mark.slow
def test_a_fitness_that_other_candidates_decide_on_is_not_verified(tmp_path: Path) -> None:
    others = {"ranking": {"kind": "race", "episodes": 8}, "validate": {"episodes": 0}}
    bundled(others, tmp_path / "raced.zip")
    found = verify_bundle(tmp_path / "raced.zip")
    assert found.ok, found.problems
    reason = "its ranking uses more than these episodes"
    assert found.unverified == {"fitness": reason}
    assert str(found).endswith(f"(python); its fitness was not checked: {reason}")


@pytest.mark.slow
def test_files_more_or_less(bundle: Path, tmp_path: Path, program: Any) -> None:
    files = read(bundle)
    del files["c/controller.h"]
    files["c/more.c"] = b""
    write(tmp_path / "changed.zip", files, sealed=False)
    assert verify_bundle(tmp_path / "changed.zip").problems == [
        "c/controller.h: is missing",
        "c/more.c: is not in the manifest",
    ]
    result = program("verify", "changed.zip")
    assert result.returncode == 1
    assert result.stdout.splitlines()[-1] == "FAILED: 2 problems"


@pytest.mark.parametrize("name", ["install.sh", "python/__init__.py", "extra/more.c", "c"])
def test_files_that_no_bundle_has_are_a_problem(name: str, bundle: Path, tmp_path: Path) -> None:
    files = {**read(bundle), name: b"#!/bin/sh"}
    write(tmp_path / "more.zip", files, sealed=True)
    assert verify_bundle(tmp_path / "more.zip").problems == [
        f"{name}: is not a file of a bundle of this version"
    ]


def with_format(file: Path, form: str, more: Files, *, by: str | None = None) -> Files:
    """Return the files of a bundle with one more format, which an unknown sender may choose freely."""
    files = {**read(file), **more}
    manifest = json.loads(files["manifest.json"])
    manifest["forms"][form] = {}
    if by is not None:
        manifest["swarmwright"] = by
    files["manifest.json"] = json.dumps(manifest).encode()
    return files


@pytest.mark.slow
def test_a_format_that_is_not_here_is_not_checked_and_all_else_is(
    bundle: Path, tmp_path: Path, program: Any
) -> None:
    files = with_format(bundle, "rust", {"rust/lib.rs": b"", "rust/src/main.rs": b"fn main() {}"})
    write(tmp_path / "rust.zip", files, sealed=True)
    told = program("verify", "rust.zip")
    assert told.returncode == 0, told.stdout
    lines = told.stdout.splitlines()
    assert [line for line in lines if line.startswith("rust:")] == [
        "rust: not checked: not an export format of this installation; install the package that adds it"
    ]
    assert "Evaluated again in 14 episodes" in lines
    words = (
        "Controller code verified in part: c; not checked: rust (not an export format of this installation)"
    )
    assert lines[-1] == words
    asked = program("verify", "rust.zip", "--require-formats", "--json")
    assert asked.returncode == 1
    found = json.loads(asked.stdout)
    assert found["ok"]
    assert found["fitness_checked"]
    assert found["formats_not_checked"] == {"rust": "not an export format of this installation"}
    assert program("verify", "rust.zip", "--require-fitness").returncode == 0
    assert program("verify", bundle, "--require-formats").returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("form", ["C", ".", "c.", "a b", "a/b"])
def test_folders_that_no_format_has_are_a_problem(form: str, bundle: Path, tmp_path: Path) -> None:
    """Some would be unpacked to the folder of another format, or to none."""
    write(tmp_path / "x.zip", with_format(bundle, form, {f"{form}/install.sh": b""}), sealed=True)
    assert verify_bundle(tmp_path / "x.zip").problems == [
        f"{form}/install.sh: is not a file of a bundle of this version"
    ]
    write(tmp_path / "x.zip", with_format(bundle, form, {}), sealed=True)
    assert verify_bundle(tmp_path / "x.zip").problems == [f"manifest.json: invalid format {form!r}"]


@pytest.mark.slow
@pytest.mark.parametrize("by", [None, "9.9.9"])
@pytest.mark.parametrize(
    ("form", "reason"),
    [
        ("scxml", "controller: the kind 'fully_meshed' cannot be exported to scxml, only mealy_fsm"),
        ("machine", "controller: the kind 'fully_meshed' is not a machine of behaviours"),
    ],
)
def test_a_format_that_the_controller_is_not_exported_to_is_a_problem(
    form: str, reason: str, by: str | None, bundle: Path, tmp_path: Path
) -> None:
    files = with_format(bundle, form, {f"{form}/install.sh": b"#!/bin/sh"}, by=by)
    write(tmp_path / "x.zip", files, sealed=True)
    (problem,) = verify_bundle(tmp_path / "x.zip").problems
    assert problem.startswith(f"{form}: this controller cannot be exported to this format: {reason}")
    assert ("; verify it with Swarmwright 9.9.9, which wrote it" in problem) == (by is not None)


@pytest.mark.parametrize("by", [None, "9.9.9"])
def test_files_that_a_format_does_not_have_are_a_problem(
    by: str | None, bundle: Path, tmp_path: Path
) -> None:
    write(tmp_path / "x.zip", with_format(bundle, "c", {"c/install.sh": b"#!/bin/sh"}, by=by), sealed=True)
    (problem,) = verify_bundle(tmp_path / "x.zip").problems
    assert problem.startswith("c/install.sh: is not exported by this version")


@pytest.mark.slow
def test_a_format_whose_package_is_not_installed_is_not_checked(
    bundle: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = with_format(bundle, "onnx", {"onnx/controller.onnx": b""})
    write(tmp_path / "x.zip", files, sealed=True)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    found = verify_bundle(tmp_path / "x.zip")
    assert found.ok, found.problems
    assert found.unverified["onnx"] == "ONNX models need onnx: pip install 'swarmwright[onnx]'"
    assert found.formats_not_checked == {"onnx": "a package is not installed"}


def test_a_file_that_is_not_listed_is_one_problem(bundle: Path, tmp_path: Path) -> None:
    write(tmp_path / "more.zip", {**read(bundle), "install.sh": b"#!/bin/sh"}, sealed=False)
    assert verify_bundle(tmp_path / "more.zip").problems == ["install.sh: is not in the manifest"]


@pytest.mark.parametrize(
    "name", ["../more", "c/../../more", "/abs/more.sh", "c\\more.c", "C:/more.c", "C:more.c", "../", "x/.."]
)
def test_names_outside_the_folder_are_refused(name: str, bundle: Path, tmp_path: Path) -> None:
    write(tmp_path / "more.zip", {**read(bundle), name: b""}, sealed=True)
    with pytest.raises(InputError, match="is not a name inside a folder"):
        verify_bundle(tmp_path / "more.zip")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["manifest.json", "controller.json", "evaluation.json"])
@pytest.mark.parametrize("text", [b"[" * 100_000, b"[" * 900 + b"]" * 900])
def test_json_that_is_nested_deeply_is_refused(name: str, text: bytes, bundle: Path, tmp_path: Path) -> None:
    sealed = name != "manifest.json"
    write(tmp_path / "deep.zip", {**read(bundle), name: text}, sealed=sealed)
    with pytest.raises(InputError, match="nested more than 100 deep"):
        verify_bundle(tmp_path / "deep.zip")


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR])
def test_archived_links_and_devices_are_refused(kind: int, bundle: Path, tmp_path: Path) -> None:
    write(tmp_path / "more.zip", read(bundle), sealed=False)
    link = zipfile.ZipInfo("c/link")
    link.external_attr = (kind | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "more.zip", "a") as archive:
        archive.writestr(link, b"/etc/passwd")
    with pytest.raises(InputError, match="c/link: is not a regular file"):
        verify_bundle(tmp_path / "more.zip")


@pytest.mark.slow
def test_a_fitness_that_was_not_checked_is_said_last(bundle: Path, tmp_path: Path, program: Any) -> None:
    """Not every simulation is built in; scripts may ask for the fitness."""
    files = read(bundle)
    evaluation = json.loads(files["evaluation.json"])
    evaluation["experiment"]["simulation"] = "own.py:Own"
    files["evaluation.json"] = json.dumps(evaluation).encode()
    write(tmp_path / "own.zip", files, sealed=True)
    told = program("verify", "own.zip")
    assert told.returncode == 0, told.stderr
    assert told.stdout.splitlines()[-1] == (
        "Controller code verified: largest difference 0 (c); its fitness was not checked: the simulation "
        "own.py:Own is not built in"
    )
    asked = program("verify", "own.zip", "--require-fitness", "--json")
    assert asked.returncode == 1
    assert json.loads(asked.stdout)["fitness_checked"] is False
    checked = program("verify", bundle, "--require-fitness", "--json")
    assert checked.returncode == 0
    assert json.loads(checked.stdout)["fitness_checked"] is True


@pytest.mark.slow
def test_an_unpacked_bundle_and_one_packed_again(bundle: Path, tmp_path: Path, program: Any) -> None:
    """Other programs add entries for folders."""
    files = read(bundle)
    with zipfile.ZipFile(bundle) as archive:
        archive.extractall(tmp_path / "unpacked")
    write(tmp_path / "again.zip", {"c/": b"", **files}, sealed=False)
    for place in ("unpacked", "again.zip"):
        found = verify_bundle(tmp_path / place)
        assert found.ok, found.problems
        assert found.digest == hashlib.sha256(files["manifest.json"]).hexdigest()
    assert program("verify", "unpacked").returncode == 0
    (tmp_path / "unpacked" / "more").symlink_to(tmp_path)
    with pytest.raises(InputError, match="more: is not a regular file"):
        verify_bundle(tmp_path / "unpacked")


def test_another_version_wrote_it_otherwise(bundle: Path, tmp_path: Path) -> None:
    """Then it cannot be told from a change, so it is not executed; all else is checked."""
    files = read(bundle)
    _comment(files)
    manifest = json.loads(files["manifest.json"])
    manifest["swarmwright"] = "9.9.9"
    files["manifest.json"] = json.dumps(manifest).encode()
    write(tmp_path / "later.zip", files, sealed=True)
    found = verify_bundle(tmp_path / "later.zip")
    assert found.ok
    assert not found.forms
    assert found.unverified["c"].startswith("written by Swarmwright 9.9.9; this version, ")
    assert str(found) == (
        "Fitness verified; no exported code was run; not checked: c (written by Swarmwright 9.9.9)"
    )
    assert found.episodes == 14
    evaluation = json.loads(files["evaluation.json"])
    evaluation["experiment"]["simulation"] = "own.py:Own"
    files["evaluation.json"] = json.dumps(evaluation).encode()
    write(tmp_path / "later.zip", files, sealed=True)
    assert str(verify_bundle(tmp_path / "later.zip")) == (
        "Not verified; no exported code was run; not checked: c (written by Swarmwright 9.9.9), "
        "the fitness (the simulation own.py:Own is not built in)"
    )


@pytest.mark.slow
def test_the_formats_that_another_version_wrote_otherwise_are_said_last(bundle: Path, tmp_path: Path) -> None:
    files = with_format(bundle, "python", {"python/controller.py": b"", "python/controller_test.py": b""})
    manifest = json.loads(files["manifest.json"])
    manifest["forms"]["cpp"], manifest["swarmwright"] = {}, "9.9"
    files["manifest.json"] = json.dumps(manifest).encode()
    write(tmp_path / "later.zip", files, sealed=True)
    found = verify_bundle(tmp_path / "later.zip")
    assert str(found) == (
        "Controller code verified in part: c; not checked: python, cpp (written by Swarmwright 9.9)"
    )
    assert found.to_mapping()["formats_not_checked"].keys() == {"python", "cpp"}


def _not_a_bundle(file: Path) -> None:
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("readme.txt", "no manifest")


def _later(file: Path) -> None:
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("manifest.json", json.dumps({"format": 2, "swarmwright": "9.0"}))


def _wrong(file: Path) -> None:
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("manifest.json", json.dumps({"format": 1, "files": [1], "facts": []}))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda file: file.write_bytes(b"no archive"), "is not a bundle, or is damaged"),
        (_not_a_bundle, "is not a bundle, because manifest.json is missing"),
        (_later, "has the format 2, of Swarmwright 9.0; this version reads 1"),
        (_wrong, "manifest.json, or a file named in it, is invalid"),
        (lambda file: file.mkdir(), "manifest.json is missing"),
    ],
)
def test_what_is_no_bundle(tmp_path: Path, make: Callable[[Path], object], words: str) -> None:
    make(tmp_path / "x.zip")
    with pytest.raises(InputError, match=words):
        verify_bundle(tmp_path / "x.zip")


@pytest.mark.parametrize("key", ["step_size", "shown_seconds"])
@pytest.mark.parametrize("value", ["Infinity", "NaN", "-1", "1e305", "1" + "0" * 400])
def test_a_step_of_no_duration_is_refused(value: str, key: str, bundle: Path, tmp_path: Path) -> None:
    files = read(bundle)
    manifest = json.loads(files["manifest.json"])
    manifest[key] = json.loads(value)
    files["manifest.json"] = json.dumps(manifest).encode()
    write(tmp_path / "x.zip", files, sealed=True)
    with pytest.raises(InputError, match=r"manifest\.json, or a file named in it, is invalid"):
        verify_bundle(tmp_path / "x.zip")


def test_half_a_bundle_is_damaged(bundle: Path, tmp_path: Path) -> None:
    data = bundle.read_bytes()
    (tmp_path / "half.zip").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="is not a bundle, or is damaged"):
        verify_bundle(tmp_path / "half.zip")
    # A bit of the compressed data of a file.
    flipped = bytearray(data)
    flipped[len(data) // 3] ^= 1
    (tmp_path / "flipped.zip").write_bytes(flipped)
    try:
        assert not verify_bundle(tmp_path / "flipped.zip").ok
    except InputError as error:
        assert "is not a bundle, or is damaged" in str(error)  # noqa: PT017 - both are right


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bundle", "x.tar"], "x.tar: the name of a bundle must end with .zip"),
        (["--bundle", "no/x.zip"], "no/x.zip: the folder no does not exist"),
        (["--bundle", "there.zip"], "there.zip: already exists and is not a bundle"),
        (["--bundle", "x.zip", "--to", "c"], "--bundle and --to exclude each other"),
        (["--bundle", "x.zip", "--prefix", "int"], "'int' is a keyword of C, C++ or Python"),
        (["--bundle", "x.zip", "--candidate", "999:0"], "has generations 0 to 29, but no generation 999"),
        (["--to", "c", "--mapping", "there.zip"], "--mapping needs --bundle; add it"),
        ([], "name a format: --to c, cpp, "),
    ],
)
def test_mistakes_are_explained(
    program: Any, network: Run, tmp_path: Path, arguments: list[str], words: str
) -> None:
    (tmp_path / "there.zip").write_text("mine")
    result = program("export", network.path, *arguments)
    assert result.returncode == 2
    assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert (tmp_path / "there.zip").read_text() == "mine"
    assert not (tmp_path / "x.zip").exists()


@pytest.mark.slow
def test_a_bundle_of_one_group_of_a_team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EXPORTERS, "names", lambda: ["python"])
    groups = {"hunters": {"hidden": [2]}, "prey": {"hidden": [3]}}
    experiment = Experiment.from_mapping(
        {
            "simulation": Pursuit,
            "controller": {"kind": "team", "groups": groups},
            "method": {"population": 4, "generations": 1},
        }
    )
    run = optimize(experiment, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match=r"name a group, hunters, prey \(--group NAME\)"):
        export_bundle(run, tmp_path / "prey.zip")
    export_bundle(run, tmp_path / "prey.zip", group="prey")
    checked = verify_bundle(tmp_path / "prey.zip")
    assert checked.ok
    assert checked.fitness_not_checked == "it is that of all groups together, not of prey alone"
    opponent = load_opponent(tmp_path / "prey.zip")
    assert opponent.weights.tobytes() == load_opponent(run.path).playing("prey").weights.tobytes()
    assert opponent.simulation.endswith("Pursuit")
