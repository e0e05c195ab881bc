"""Controllers of runs, bundles and files as opponents; what is none, and what is hostile."""

import hashlib
import json
import os
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.common.untrusted import escape_line
from swarmwright.experiment.opponents import LARGEST_FILE_BYTES, Opponent, check_fits, load_opponent
from swarmwright.runs.store import StoreReader
from tests.python.simulations.pursuit import Pursuit

NETWORK = {"version": 1, "kind": "layered", "sensors": 2, "hidden": [], "actuators": 1, "activation": "tanh"}
WEIGHTS = [0.5, -1.0, 0.25]
CONTROLLER: dict[str, Any] = {**NETWORK, "output_range": [-1, 1], "weights": WEIGHTS}
TEAM = {
    "version": 1,
    "kind": "team",
    "groups": [
        {"name": "hunters", "agents": 2, "controller": NETWORK | {"output_range": [-1, 1]}},
        {"name": "prey", "agents": None, "controller": NETWORK | {"sensors": 1, "output_range": [-1, 1]}},
    ],
    "weights": [*WEIGHTS, 1.0, 2.0],
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    experiment = Experiment.from_mapping(
        {
            "simulation": Pursuit,
            "controller": {"hidden": [2]},
            "populations": {"hunters": {}, "prey": {}},
            "ranking": {"rounds": 1, "sides": {"hunters": "fitness", "prey": "-fitness"}},
            "method": {"population": 4, "generations": 2},
        }
    )
    return optimize(experiment, servers="in-process", out=tmp_path_factory.mktemp("here") / "chase")


def write(path: Path, values: Any) -> Path:
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def bundle(path: Path, controller: Any = None, **changes: Any) -> Path:
    """Write the parts of a bundle that are read; changes: of the manifest."""
    data = json.dumps(CONTROLLER if controller is None else controller).encode()
    manifest: dict[str, Any] = {
        "format": 1,
        "files": {"controller.json": {"sha256": hashlib.sha256(data).hexdigest()}},
        **changes,
    }
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("manifest.json", json.dumps(manifest))
        archive.writestr("controller.json", data)
        archive.writestr("evaluation.json", json.dumps({"experiment": {"simulation": "minisim"}}))
    return path


def test_the_best_and_any_candidate_of_a_run(run: Run) -> None:
    best = load_opponent(run.path)
    assert best.specification == run.best.specification
    assert best.simulation.endswith("pursuit.py:Pursuit")
    assert list(best.parts) == ["hunters", "prey"]
    hunters = best.playing("hunters")
    assert (hunters.sensors, hunters.actuators) == (1, 1)
    assert hunters.name == f"{run.path}, hunters"
    whole = np.concatenate([part.weights for part in best.parts.values()])
    assert whole.tobytes() == best.weights.tobytes()
    other = load_opponent(f"{run.path.name}:0:1", run.path.parent)
    assert other.weights.tobytes() == run.evaluation(1, 0).genome.tobytes()
    assert other.name == "chase:0:1"
    best_json = load_opponent("best.json", run.path)
    assert (best_json.digest, best_json.simulation) == (best.digest, "")


def test_a_bundle_as_archive_and_as_folder(tmp_path: Path) -> None:
    archive = bundle(tmp_path / "their.bundle")
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(tmp_path / "unpacked")
    opponents = [load_opponent(archive), load_opponent(tmp_path / "unpacked")]
    assert [opponent.weights.tolist() for opponent in opponents] == [WEIGHTS, WEIGHTS]
    assert {opponent.simulation for opponent in opponents} == {"minisim"}
    assert opponents[0].digest == opponents[1].digest


def test_a_controller_as_file_text_and_values(tmp_path: Path) -> None:
    file = write(tmp_path / "champion.json", CONTROLLER)
    sources: list[Any] = [
        file,
        str(file),
        json.dumps(CONTROLLER),
        CONTROLLER,
        load_opponent(file).to_mapping(),
    ]
    opponents = [load_opponent(source) for source in sources]
    assert len({opponent.digest for opponent in opponents}) == 1
    assert [opponent.name for opponent in opponents] == [
        str(file),
        str(file),
        "opponent",
        "opponent",
        str(file),
    ]
    assert not opponents[0].weights.flags.writeable


def test_a_side_is_played_by_its_part_of_a_team() -> None:
    team, alone = load_opponent(TEAM), load_opponent(CONTROLLER)
    assert [team.playing(side).sensors for side in ("hunters", "prey")] == [2, 1]
    assert (team.sensors, team.actuators) == (2, 1)
    assert alone.playing("prey") is alone
    with pytest.raises(InputError, match=r"^opponent: has no controller for left; it plays: hunters, prey$"):
        team.playing("left")


def test_the_genome_is_kept_where_weights_are_made_of_it() -> None:
    values = load_opponent(CONTROLLER).to_mapping()
    assert load_opponent({**values, "genome": WEIGHTS}).genome is None
    other = load_opponent({**values, "genome": [1, 2, 3]})
    assert other.genome is not None
    assert load_opponent(other.to_mapping()).genome is not None


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    opponent = load_opponent(bundle(tmp_path / "b.zip"))
    check_fits(opponent, 2, 1)
    check_fits(opponent, 2, 1, "MiniSim")
    check_fits(opponent, 2, 1, "file.py:Other", titles=("minisim",))
    check_fits(load_opponent(CONTROLLER), 2, 1, "arena")  # where it was evolved is unknown
    for sizes in ((3, 1), (2, 2)):
        with pytest.raises(InputError, match=r"b.zip: has 2 sensors and 1 actuators, but the agents have \d"):
            check_fits(opponent, *sizes)
    with pytest.raises(
        InputError, match=r"b.zip: was evolved in minisim, not in Soccer; if both are the same"
    ):
        check_fits(opponent, 2, 1, "elsewhere/soccer.py:Soccer")
    one, other = (f"pettingzoo:mpe2.simple_tag_v3?max_cycles={number}" for number in (5, 6))
    check_fits(load_opponent({**opponent.to_mapping(), "simulation": one}), 2, 1, other)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ("", "x.json: is not valid JSON"),
        ("[1]", r"x.json: \[1\] found; expected a run folder"),
        ("null", "x.json: nothing found"),
        ("{" * 200, "x.json: is not valid JSON"),
        ('{"a":' * 200 + "1" + "}" * 200, "x.json: is not valid JSON: it is nested more than 100 deep"),
        ({}, "x.json: controller:"),
        ({**CONTROLLER, "kind": "nothing"}, "x.json: controller:.*nothing"),
        ({**CONTROLLER, "weights": [1, 2]}, "x.json: controller:.*weights"),
        ({**CONTROLLER, "weights": ["1", 2, 3]}, "x.json: controller:"),
        ({**CONTROLLER, "weights": None}, "x.json: controller:"),
        (json.dumps(CONTROLLER).replace("0.5", "1e999"), "x.json: controller:"),
        (json.dumps(CONTROLLER).replace("0.5", "1e300"), "x.json: "),
        (json.dumps(CONTROLLER).replace("0.5", "NaN"), "x.json: controller:"),
        ({**CONTROLLER, "sensors": 10**30}, "x.json: controller:"),
        ({**CONTROLLER, "hidden": [2**31, 2**31]}, "x.json: controller:"),
        ({"kind": "python_modules"}, "x.json: has behaviours or conditions in Python, which cannot be part"),
        ({**TEAM, "groups": []}, "x.json: controller:"),
        ({**TEAM, "groups": [{"name": "a"}]}, "x.json: controller:"),
        ({"controller": CONTROLLER, "genome": ["\x1b"]}, "x.json: genome: are not numbers"),
        ({"controller": CONTROLLER, "genome": [[1]]}, "x.json: genome: are not a list of finite numbers"),
        ({"controller": CONTROLLER, "genome": [float("inf")]}, "x.json: genome: are not a list of finite"),
        ({**CONTROLLER, "\x1b[2J\n": 1}, "x.json: controller:"),
    ],
)
def test_files_that_are_no_controller(tmp_path: Path, values: Any, message: str) -> None:
    write(tmp_path / "x.json", values)
    with pytest.raises(InputError, match=message) as caught:
        load_opponent("x.json", tmp_path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


def test_a_parameter_set_is_no_opponent() -> None:
    values = {
        "version": 1,
        "kind": "parameter_set",
        "parameters": [{"name": "speed", "low": 0.0, "high": 1.0}],
        "weights": [0.5],
    }
    with pytest.raises(
        InputError, match=r"opponent: (is a parameter set, which steers no agents|controller:)"
    ):
        load_opponent(values)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 2}, "b.zip: has the format 2; this version reads 1"),
        ({"files": {}}, "b.zip: is not a valid bundle: its manifest names no controller.json"),
        ({"files": []}, "b.zip: is not a valid bundle"),
        (
            {"files": {"controller.json": {"sha256": "0"}}},
            "b.zip: controller.json was changed after the bund",
        ),
    ],
)
def test_bundles_that_are_damaged(tmp_path: Path, changes: Any, message: str) -> None:
    bundle(tmp_path / "b.zip", **changes)
    with pytest.raises(InputError, match=message):
        load_opponent("b.zip", tmp_path)


def test_archives_that_are_no_bundle(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("../manifest.json", "{}")
    with pytest.raises(InputError, match=r"manifest.json"):
        load_opponent("b.zip", tmp_path)
    (tmp_path / "c.zip").write_bytes(b"PK\x03\x04" + bytes(100))
    with pytest.raises(InputError, match=r"c.zip: is not a bundle, or is damaged"):
        load_opponent("c.zip", tmp_path)
    with zipfile.ZipFile(tmp_path / "d.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("manifest.json", bytes(1 << 29))
    with pytest.raises(InputError, match=r"d.zip: unpacks to 512 MiB"):
        load_opponent("d.zip", tmp_path)


def test_paths_that_lead_to_no_controller(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    os.mkfifo(tmp_path / "pipe.zip")
    (tmp_path / "empty").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    with (tmp_path / "huge.json").open("wb") as file:
        file.truncate(LARGEST_FILE_BYTES + 1)
    for name, message in [
        ("nothing.json", "^nothing.json: there is no such file; expected a run folder, RUN:GENERATION:CAND"),
        ("nothing:0:1", "nothing: does not exist"),
        ("nothing:0:" + "9" * 30, "there is no such file"),
        ("x\n\x1b[2J:0:1", r"x\\n\\x1b\[2J: does not exist"),
        ("pipe.json", "^pipe.json: is not a regular file"),
        ("pipe.zip", "^pipe.zip: is not a regular file"),
        ("/dev/zero", "^/dev/zero: is not a regular file"),
        ("huge.json", "huge.json: is larger than 64 MiB"),
        ("empty", r"^empty: is neither a run folder \(run.sqlite is missing\) nor an unpacked bundle"),
        ("loop", "^loop: cannot be read: Too many levels of symbolic links"),
        ("a\0b", r"^a\\x00b: cannot be read: .*null"),
        ("x" * 5000, r"^x{197}\.\.\.: cannot be read: File name too long"),
        ("\udcff", r"^\\udcff: there is no such file"),
        ("", "its name is empty"),
    ]:
        with pytest.raises(InputError, match=message) as caught:
            load_opponent(name, tmp_path)
        assert str(caught.value).isprintable(), name


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@given(
    st.sampled_from([CONTROLLER, TEAM, {"architecture": NETWORK, "weights": WEIGHTS, "from": "x"}]), st.data()
)
def test_any_change_is_refused_with_a_line_or_a_controller(
    values: dict[str, Any], data: st.DataObject
) -> None:
    key = data.draw(st.sampled_from([*values, "from", "genome", "simulation"]) | st.text(max_size=5))
    try:
        opponent = load_opponent({**values, key: data.draw(ANYTHING)})
    except InputError as error:
        assert escape_line(str(error)) == str(error)  # noqa: PT017 - nothing else may be raised
        return
    assert isinstance(opponent, Opponent)
    assert escape_line(opponent.name) == opponent.name
    assert np.isfinite(opponent.weights).all()


@pytest.mark.parametrize("source", [None, 1, [CONTROLLER], b"x.json"])
def test_other_types_are_refused(source: Any) -> None:
    with pytest.raises(InputError, match=r"^opponent: .* found; expected a run folder"):
        load_opponent(source)


@pytest.mark.parametrize(
    "changes",
    [
        {"controller": None},
        {"controller": []},
        {"controller": {}},
        {"controller": {"kind": "nothing"}},
        {"controller": {"kind": "\x1b[2J"}},
        {"controller": {"kind": "layered", "hidden": ["x"]}},
        {"controller": {"kind": "layered", "hidden": [1_000_000_000]}},
        {"controller": {"kind": "layered", "hidden": [3]}, "sensors": 10**9},
        {"controller": {"kind": "layered", "hidden": [3]}, "sensors": "many"},
        {"controller": {"kind": "layered", "hidden": [3]}, "sensors": -1},
        {"controller": {"kind": "layered", "hidden": [9]}, "sensors": 2, "actuators": 2},
        {"controller": {"kind": "team", "groups": {"a": {"kind": "team", "groups": {}}}}},
        {"controller": {"kind": "modules", "behaviours": ["/etc/passwd:X", "evil.py:Evil"]}},
    ],
)
def test_runs_of_other_people_are_not_trusted(
    changes: dict[str, Any], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their experiment may say anything: no code of it is imported."""
    values = {**run._store.experiment(), **changes}
    monkeypatch.setattr(StoreReader, "experiment", lambda _: values)
    with pytest.raises(InputError) as caught:
        load_opponent(run.path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


@given(st.one_of(ANYTHING, st.lists(ANYTHING | st.just(CONTROLLER), max_size=3)))
def test_anything_in_an_experiment_is_a_message(value: Any) -> None:
    values = {
        "simulation": "minisim",
        "parameters": {"numDefenders": 2, "defenderSteering": "controller"},
        "servers": "in-process",
        "ranking": {"kind": "tournament", "opponents": value},
    }
    choices: list[dict[str, Any]] = [{}, {"agents": {}}]
    for populations in choices:
        with suppress(InputError):
            Experiment.from_mapping({**values, "populations": populations})
