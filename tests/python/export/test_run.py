"""Candidates of runs, exported: what is written, what users are told."""

import json
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import InputError, Run
from swarmwright.controllers.source.text import make_identifiers, plain
from swarmwright.export.golden import Golden
from swarmwright.export.subject import Subject, load_subject
from swarmwright.runs.store.database import seal_facts

MINISIM: dict[str, Any] = {
    "simulation": "minisim", "servers": "local", "ranking": {"episodes": 3},
    "parameters": {"placement": "random", "numAgents": 2},
    "controller": {"kind": "fully_meshed", "hidden": 2, "activation": "tanh"},
    "method": {"kind": "nnga", "population": 8, "generations": 3},
}  # fmt: skip
RULE: dict[str, Any] = {
    **MINISIM, "parameters": {"steering": "rule"},
    "controller": {"kind": "parameter_set", "parameters": {
        "avoidance": {"type": "real", "range": [0, 5]}, "maxSteps": {"type": "integer", "range": [15, 30]},
        "evasion": {"type": "categorical", "choices": ["left", "right"]},
    }},
}  # fmt: skip


@pytest.fixture(scope="module")
def minisim(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of Minisim with two agents, three episodes, and controllers that have a state."""
    out = tmp_path_factory.mktemp("runs") / "robots"
    return swarmwright.optimize(swarmwright.Experiment.from_mapping(MINISIM), out=out)


@pytest.fixture(scope="module")
def rule(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run that evolved parameters."""
    out = tmp_path_factory.mktemp("runs") / "rule"
    return swarmwright.optimize(swarmwright.Experiment.from_mapping(RULE), out=out)


def test_episodes_are_recorded_agent_by_agent(minisim: Run) -> None:
    subject = load_subject(minisim)
    episodes = subject.episodes
    assert episodes is not None
    assert subject.episode_count == 3
    assert episodes.count == 6  # two agents in each
    again = type(episodes).compute(subject.specification, episodes.first, episodes.sensors)
    # What the agents did is what a controller does that is reset where an agent's episode begins.
    np.testing.assert_array_equal(again.actuators.view(np.uint32), episodes.actuators.view(np.uint32))
    assert [channel.name for channel in subject.sensors] == ["goal x", "goal y", "defender x", "defender y"]


def test_names_are_those_with_the_parameters_of_the_run(tmp_path: Path) -> None:
    values = {
        "simulation": "arena",
        "parameters": {"robot": "kilobot", "robots": 3, "duration": 1},
        "method": {"kind": "random_search", "population": 2, "generations": 1},
    }
    run = swarmwright.optimize(swarmwright.Experiment.from_mapping(values), servers="local", out=tmp_path)
    assert [channel.name for channel in load_subject(run).actuators] == [
        "left wheel",
        "right wheel",
        "message 0",
    ]


def test_the_duration_of_a_step_is_not_that_of_a_frame(minisim: Run, tmp_path: Path) -> None:
    """`stepSize` is for how long a step is shown: the arena's lasts 0.1 s, Minisim's has no duration."""
    values = {
        "simulation": "arena", "parameters": {"robots": 2, "duration": 1, "stepSize": 500},
        "servers": "in-process", "method": {"kind": "random_search", "population": 2, "generations": 1},
    }  # fmt: skip
    run = swarmwright.optimize(swarmwright.Experiment.from_mapping(values), out=tmp_path / "run")
    swarmwright.export_controller(run, to="ros2", output=tmp_path / "arena")
    swarmwright.export_controller(minisim, to="ros2", output=tmp_path / "minisim")
    rates = [
        next(tmp_path.glob(f"{name}/**/mapping.template.yaml")).read_text() for name in ("arena", "minisim")
    ]
    assert "rate: 10" in rates[0]
    assert "as many as in the simulation" in rates[0]
    assert "10 is a guess" in rates[1]


def test_golden_vectors_are_whole_episodes(minisim: Run) -> None:
    subject = load_subject(minisim)
    golden, episodes = Golden.from_subject(subject).sequences, subject.episodes
    assert episodes is not None
    assert len(golden) == len(episodes) <= 4000 // 5
    first = episodes.take_first(0)
    assert first.count == 1
    assert len(first) == int(np.flatnonzero(episodes.first)[1])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["c", "cpp", "fmu", "fmu3", "python", "onnx"])
def test_the_program_exports_and_verifies(program: Any, minisim: Run, tmp_path: Path, form: str) -> None:
    result = program("export", minisim.path, "--to", form, "--output", "out", "--verify", "--prefix", "robot")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].startswith(f"Candidate {minisim.best.candidate} of generation {minisim.best.generation} ")
    assert lines[-1].startswith("Verified: largest difference 0, bit-identical in 10,000 random sequences (")
    assert " and 3 episodes of the simulation (" in lines[-1]
    names = {"c": "robot.h", "cpp": "robot.hpp", "python": "robot.py", "onnx": "robot.onnx"}
    assert (tmp_path / "out" / names.get(form, "robot.fmu")).is_file()


def test_the_header_says_what_it_is(minisim: Run, tmp_path: Path) -> None:
    exported = swarmwright.export_controller(minisim, to="c", output=tmp_path / "out")
    assert {file.name for file in exported.files} >= {"controller.c", "controller.h", "CMakeLists.txt"}
    text = (tmp_path / "out" / "controller.h").read_text()
    for part in (
        minisim.digest,
        f"{minisim.best.candidate} of generation {minisim.best.generation} ",
        f"{minisim.best.fitness!r} (mean of 3 episodes)",
        "Simulation  minisim",
        "fully_meshed, 4-2-1, tanh",
        "CONTROLLER_SENSOR_DEFENDER_X = 2, /* defender x in map widths, ",
        " in the recorded episodes */",
        "CONTROLLER_ACTUATOR_HEADING = 0 /* heading in half turns, -1 to 1 */",
        "void controller_reset(controller_t *controller);",
        "bool controller_step(controller_t *controller, const float *sensors, float *actuators);",
    ):
        assert part in text


@pytest.mark.slow
def test_any_candidate_and_the_same_bytes(program: Any, minisim: Run, tmp_path: Path) -> None:
    for folder, options in (
        ("a", ["--candidate", "0:5"]),
        ("b", ["--generation", "0", "--candidate", "5"]),
        ("c", ["--candidate", "5"]),
        ("d", ["--candidate", "2:1"]),
        ("e", ["--generation", "2"]),
    ):
        result = program("export", minisim.path, "--to", "c", "--output", folder, *options)
        assert result.returncode == 0, result.stderr
    texts = [(tmp_path / folder / "controller.c").read_bytes() for folder in "abcde"]
    assert texts[0] == texts[1] == texts[2] != texts[3]
    assert b" %d of generation 2 " % minisim.evaluation(None, 2).candidate in texts[4]
    assert b"5 of generation 0" in texts[0]
    weights = minisim.evaluation(5, 0).genome
    assert all(f"{weight!s}f".encode() in texts[0] for weight in weights)


@pytest.mark.slow
def test_the_folder_may_be_given_as_for_optimize(program: Any, minisim: Run, tmp_path: Path) -> None:
    result = program("export", minisim.path, "--to", "python", "--out", "exported")
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "exported" / "controller.py").is_file()


@pytest.mark.slow
def test_json(program: Any, minisim: Run) -> None:
    result = program("export", minisim.path, "--to", "c", "--verify", "--json")
    (line,) = result.stdout.splitlines()
    said = json.loads(line)
    assert said["largest_difference"] == 0
    assert said["verification"]["ok"] is True
    assert said["verification"]["random_sequences"] == 10_000
    assert "controller/controller.c" in said["files"]


@pytest.mark.slow
def test_parameters(program: Any, rule: Run, tmp_path: Path) -> None:
    values = rule.best.controller.parameters
    for form in ("c", "cpp", "python"):
        result = program("export", rule.path, "--to", form, "--output", "out", "--verify", "--prefix", "rule")
        assert result.returncode == 0, result.stderr
        assert result.stdout.splitlines()[-1] == (
            "Verified: largest difference 0, bit-identical: all parameters are correct"
        )
    text = (tmp_path / "out" / "rule.h").read_text()
    assert "float avoidance; /* avoidance, 0 to 5 */" in text
    source = (tmp_path / "out" / "rule.c").read_text()
    assert f"{np.float32(values['avoidance'])!s}f" in source
    assert f'"{values["evasion"]}"' in source


@pytest.mark.slow
def test_verification_fails_where_bits_differ(
    program: Any, minisim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compiler that gives other results is found out."""
    compiler = tmp_path / "cc"
    compiler.write_text(
        '#!/bin/sh\nsed -i "s/y \\* p;/y * p; product = product * 1.0000001f;/" controller.c\nexec gcc "$@"\n'
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    result = program("export", minisim.path, "--to", "c", "--verify")
    assert result.returncode == 1
    assert "the actuators differ from those of the simulation" in result.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--to", "cc"], "unknown export format 'cc'; did you mean 'c'? available: c, "),
        ([], "name a format: --to "),
        (["--to", "c", "--candidate", "9:0"], "has generations 0 to 2, but no generation 9"),
        (["--to", "c", "--candidate", "0:8"], "generation 0 has candidates 0 to 7, but no candidate 8"),
        (["--to", "c", "--candidate", "best"], "'best' is not G:N, such as 19:3"),
        (["--to", "c", "--candidate", "1:"], "'1:' is not G:N, such as 19:3"),
        (["--to", "c", "--candidate", "1:0", "--generation", "2"], "leave out --generation"),
        (["--to", "c", "--prefix", "2wheels"], "prefix: '2wheels' found, expected a letter"),
        (["--to", "c", "--prefix", "class"], "prefix: 'class' is a keyword of C, C++ or Python"),
        (["--to", "c", "--prefix", "a_test"], "prefix: 'a_test' ends with _test"),
        (["--to", "c", "--prefix", "size"], "prefix: size_t is a type of C or POSIX"),
        (["--to", "fmu", "--prefix", "off"], "prefix: off_t is a type of C or POSIX"),
        (["--to", "ros2", "--prefix", "uint8"], "prefix: uint8_t is a type of C or POSIX"),
        (["--to", "cpp", "--prefix", "String"], "prefix: String.h is a C or system header"),
        (["--to", "micropython", "--prefix", "array"], "prefix: 'array' is a Python module"),
        (["--to", "c", "--output", "taken"], "taken: is a file, not a folder"),
        (
            ["--to", "c", "--output", "full"],
            "controller.h: already exists and was not exported by Swarmwright",
        ),
    ],
)
def test_mistakes(program: Any, minisim: Run, tmp_path: Path, options: list[str], said: str) -> None:
    (tmp_path / "taken").write_text("x")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "controller.h").write_text("/* of a person */")
    result = program("export", minisim.path, *options)
    assert result.returncode == 2
    assert said in result.stderr
    assert len(result.stderr.splitlines()) <= 2  # a usage error has a hint
    assert (tmp_path / "full" / "controller.h").read_text() == "/* of a person */"
    assert len(list((tmp_path / "full").iterdir())) == 1


@pytest.mark.slow
def test_what_was_exported_is_written_over(program: Any, minisim: Run, tmp_path: Path) -> None:
    (tmp_path / "controller").mkdir()
    (tmp_path / "controller" / "controller.h").write_text("mine")
    assert program("export", minisim.path, "--to", "c", "--force").returncode == 0
    assert program("export", minisim.path, "--to", "c", "--candidate", "0:0").returncode == 0
    assert "0 of generation 0" in (tmp_path / "controller" / "controller.h").read_text()


@pytest.mark.slow
def test_prefixes_that_differ_in_case_only_are_refused(program: Any, minisim: Run, tmp_path: Path) -> None:
    """Guards and enumerations are in capitals: a program could not have both headers."""
    export = ("export", str(minisim.path), "--output", str(tmp_path / "robot"), "--to")
    assert program(*export, "c", "--prefix", "leader").returncode == 0
    before = sorted((tmp_path / "robot").rglob("*"))
    refused = program(*export, "c", "--prefix", "Leader")
    assert refused.returncode == 2
    assert "prefix: 'Leader' differs from 'leader' of " in refused.stderr
    assert "overwrite those files with the prefix leader" in refused.stderr
    assert sorted((tmp_path / "robot").rglob("*")) == before
    for prefix in ("leader", "leaders"):
        assert program(*export, "c", "--prefix", prefix).returncode == 0
    (tmp_path / "robot" / "follower.h").write_text("/* of a person */")
    assert program(*export, "c", "--prefix", "Follower").returncode == 0


@pytest.mark.slow
def test_both_dialects_of_python_need_names_of_their_own(program: Any, minisim: Run, tmp_path: Path) -> None:
    export = ("export", str(minisim.path), "--output", str(tmp_path / "robot"), "--to")
    assert program(*export, "python").returncode == 0
    before = (tmp_path / "robot/controller.py").read_text()
    refused = program(*export, "micropython")
    assert refused.returncode == 2
    assert "controller.py: was exported to the other dialect" in refused.stderr
    assert (tmp_path / "robot/controller.py").read_text() == before
    assert program(*export, "python", "--candidate", "0:1").returncode == 0
    assert program(*export, "micropython", "--force").returncode == 0
    assert program(*export, "micropython", "--prefix", "other").returncode == 0


@pytest.mark.slow
def test_no_compiler(program: Any, minisim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "nocc -O2")
    result = program("export", minisim.path, "--to", "c", "--verify")
    assert result.returncode == 2
    assert result.stderr == "swarmwright: CC=nocc -O2: program not found\n"
    assert not (tmp_path / "controller").exists()
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match="verification needs cc, which is not installed: apt install gcc"):
        swarmwright.export_controller(minisim, to="c", output=tmp_path / "out", verify=True)


@pytest.mark.slow
def test_a_failed_candidate(tmp_path: Path) -> None:
    source = tmp_path / "half.py"
    source.write_text(
        "from swarmwright import Simulation\n\n\nclass Half(Simulation):\n    sensors = actuators = 1\n"
        "    def reset(self, parameters, seed):\n        self.left = 2\n        return [[0.5]]\n"
        "    def step(self, actuators):\n        self.left -= 1\n        self.at = actuators[0][0]\n"
        "        if self.at > 0:\n            raise ValueError('fell over')\n"
        "        return [[0.5]]\n    def done(self):\n        return self.left == 0\n"
        "    def fitness(self):\n        return 1.0\n"
    )
    experiment = swarmwright.Experiment.from_mapping(
        {
            "simulation": f"{source}:Half", "servers": "in-process", "faults": {"attempts": 1},
            "method": {"kind": "random_search", "population": 8, "generations": 1},
        }
    )  # fmt: skip
    run = swarmwright.optimize(experiment, out=tmp_path / "run")
    failed = int(np.flatnonzero(np.isnan(run.record["fitness"]))[0])
    with pytest.raises(InputError, match=f"candidate {failed} of generation 0 failed; name another"):
        swarmwright.export_controller(run, to="c", candidate=failed, output=tmp_path / "out")
    assert swarmwright.export_controller(run, to="c", output=tmp_path / "out", verify=True).verification.ok  # type: ignore[union-attr] # asked for
    shutil.rmtree(run.path / "code")
    source.unlink()
    exported = swarmwright.export_controller(run, to="c", output=tmp_path / "out", verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    assert exported.verification.episodes == 0
    assert "half.py" in exported.verification.without_episodes
    assert "random sequences" in (tmp_path / "out" / "controller_test.c").read_text()


def test_names_and_ranges_are_stored_with_the_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """They are in what is exported where the simulation is not; of an older run a warning says so."""
    source = tmp_path / "scaled.py"
    source.write_text(
        "from swarmwright import Simulation\n\n\nclass Scaled(Simulation):\n    sensors, actuators = 3, 1\n"
        "    sensor_names, actuator_names = ['range', 'count', ''], ['force']\n"
        "    sensor_ranges = [(0, 10, 'm'), None, None]\n    step_seconds = 0.05\n"
        "    def reset(self, parameters, seed):\n        self.left = 2\n        return [[0.5, 1.0, 0.0]]\n"
        "    def step(self, actuators):\n        self.left -= 1\n        return [[0.5, 1.0, 0.0]]\n"
        "    def done(self):\n        return self.left == 0\n    def fitness(self):\n        return 1.0\n"
    )
    values = {
        "simulation": f"{source}:Scaled", "servers": "in-process",
        "method": {"kind": "random_search", "population": 2, "generations": 1},
    }  # fmt: skip
    run = swarmwright.optimize(swarmwright.Experiment.from_mapping(values), out=tmp_path / "run")
    here = load_subject(run)
    shutil.rmtree(run.path / "code")
    source.unlink()
    subject = load_subject(run)
    assert subject.episodes is None
    assert subject.description == here.description
    assert subject.step_size == here.step_size == 0.05
    assert [one.name for one in subject.sensors] == ["range", "count", "sensor 2"]
    assert [one.limits for one in subject.sensors] == ["-1 to 1 for 0 to 10 m", *["any finite number"] * 2]
    swarmwright.export_controller(run, to="c", output=tmp_path / "out")
    assert "CONTROLLER_SENSOR_COUNT_1 = 1" in (tmp_path / "out" / "controller.h").read_text()
    assert "not known" not in caplog.text
    with sqlite3.connect(run.path / "run.sqlite") as store:
        store.execute("DELETE FROM fact WHERE name = 'channels'")
        seal_facts(store)
    old = load_subject(Run.open(run.path))
    assert old.sensors[0].limits == "range and scale not known"
    assert "names, units and ranges of sensors and actuators are unknown: " in caplog.text


def test_an_edited_sketch_is_kept(minisim: Run, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def export(candidate: int, *, force: bool = False) -> None:
        swarmwright.export_controller(
            minisim, to="c", output=tmp_path, generation=0, candidate=candidate, force=force
        )

    sketch = tmp_path / "controller_arduino" / "controller_arduino.ino"
    export(0)
    first = sketch.read_text()
    sketch.write_text(first.replace("\n", "\r\n"), newline="")  # as some editors do
    export(1)
    assert sketch.read_text() != first
    assert not caplog.text
    edited = sketch.read_text().replace("= 0.0f;", "= analogRead(A1);", 1)
    sketch.write_text(edited)
    export(0)
    assert sketch.read_text() == edited
    assert sketch.with_name("controller_arduino.ino.new").read_text() == first
    assert "was edited after the export and is kept" in caplog.text
    export(0, force=True)
    assert sketch.read_text() == first


@pytest.mark.slow
def test_a_simulation_that_only_servers_have(
    minisim: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("swarmwright.simulations.catalogue.is_local", lambda _: False)
    exported = swarmwright.export_controller(minisim, to="python", output=tmp_path, verify=True)
    assert exported.verification is not None
    assert exported.verification.ok
    assert exported.verification.without_episodes == (
        "the simulation 'minisim' is not available in this process"
    )
    assert exported.verification.words.endswith(" steps), without episodes of the simulation")
    assert "20 random sequences" in (tmp_path / "controller_test.py").read_text()


def test_names_and_units_are_spelled_in_ascii() -> None:
    """In comments and identifiers of C; what has no spelling is a question mark."""
    for text, expected in {
        "m/s²": "m/s^2", "m·s⁻¹": "m.s^-1", "kΩ": "kohm", "µT": "uT", "℃": "degrees C", "größe": "grosse",
        "état": "etat", "Łódź": "Lodz", "Δx": "deltax", "日": "?", "＊／": "* /",
    }.items():  # fmt: skip
        assert plain(text) == expected
        assert plain(plain(text)) == expected


def test_a_name_that_is_an_identifier_keeps_it() -> None:
    assert make_identifiers(["goal x", "goal_x", "goal-x", "größe", ""], "SENSOR") == [
        "GOAL_X_0",
        "GOAL_X",
        "GOAL_X_2",
        "GROSSE",
        "SENSOR_4",
    ]


@pytest.mark.slow
def test_names_of_many_sensors_are_made_different_in_time() -> None:
    """Simulations have up to 1,000,000 sensors: comparing each name with each takes minutes."""
    count = 200_000
    description = {"sensor_names": ["ray"] * (count - 2) + ["", "ray 0"]}
    sensors = Subject({"sensors": count, "actuators": 1}, description=description).sensors
    assert len({one.name for one in sensors}) == count
    assert [one.name for one in sensors[:2]] == ["ray 0", "ray 1"]
    assert [one.name for one in sensors[-2:]] == [f"sensor {count - 2}", f"ray 0 {count - 1}"]
