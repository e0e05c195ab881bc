"""Whatever stands in a file: it is read, or refused in words that name the file, without much memory."""

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Controller, Experiment, InputError, Run, RunError, frevo
from swarmwright.analysis.sweep import Sweep
from swarmwright.experiment.parameter_files import read_object
from swarmwright.interop.frevo import _document
from swarmwright.runs.store import FILE
from swarmwright.servers.broker.mosquitto import set_password
from tests.conftest import ROOT
from tests.python.fuzz.mutation import fuzz, mutated
from tests.python.interop.frevo.test_field_files import LIST, SER

# MuJoCo is left out: with it, GLFW is imported, which starts a process.
EXPERIMENTS = [
    path.read_bytes() for path in sorted(ROOT.glob("experiments/**/*.yaml")) if "mujoco" not in path.name
]
EVERYTHING = b"""\
simulation: minisim
requirements: {dimensions: 2, max_agents: 4}
parameters: {maxSteps: 15, agents: [[0.5, 3.5], [1, 2]], helloMessage: "h", goal: [12, 3]}
sensors: 4
actuators: 1
controller: {kind: fully_meshed, hidden: 2, activation: clamp, iterations: 2}
method: {kind: nnga, population: 50, generations: 100}
ranking: {kind: absolute, episodes: 3, aggregate: cvar, seeds: new, failed: stop}
fitness: "arrived - 0.01 * steps"
prefix: lab/a
mode: offloaded
servers: 2
seed: 1
broker: mqtt://localhost:1883/lab
timeouts: {discovery: 1, step: 2}
"""
SEARCHES = b"""\
controller: {kind: neat, max_nodes: 3, recurrent: true, activations: [tanh]}
method: {kind: neat, population: 20, species: 5, threshold: 2.5, severity: 1.0}
---
method: {kind: novelty, measures: {steps: {range: [0, 15], bins: 5}}, objective: mixed, weight: 0.3,
  neighbours: 4, criteria: {fitness: {at_least: -9}}, archive: {kind: threshold, size: 9}, species: {}}
---
method: {kind: map_elites, measures: {steps: {range: [0, 15]}, caught: {range: [0, 1]}}, population: 20,
  archive: {kind: cvt, cells: 9}, reevaluate: 0.5}
ranking: {seeds: new}
---
method: {kind: map_elites, measures: {steps: {range: [0, 15], bins: 3}}, variation: cma_mae,
  emitters: 5, population: 20, threshold_min: -9, learning_rate: 0.1, sigma: 0.2}
---
method: {kind: nsga3, objectives: {steps: minimize}, partitions: 9, population: 20}
---
method: {kind: ga_species, population: 20}
---
method: {kind: cuckoo_search, population: 20}
"""
YAML = rb""": |- |{|}|[|]|\n|  |\t|&a |*a|<<: *a|!!int |!x |null|~|true|.nan|.inf|-.inf|1e999|0x10|0o17|1_000
@|`|1:30|? |2024-01-01|18446744073709551616|--- |-1|0|'|"|#|%YAML 1.1|fitness: steps""".split(b"|")
YAML += [b"|\n", b">\n", b"\n", b"\n- ", b"\xff", b"\x00", "\u2028\x85\ufeff".encode()]
JSON = rb"{ } [ ] , : null true NaN Infinity -0 1e999 1.5 18446744073709551616 \ud800 \u0000".split()
JSON += [b'"', b"[" * 200, b'{"a":' * 200, b"\xff", b"\xef\xbb\xbf"]
XML = b"< > </ /> & &lt; &x; <!-- --> <? <![CDATA[ = NaN Infinity -1 1e999 0".split()
XML += [b"<!DOCTYPE a [<!ENTITY x 'y'>]>", b'"', b"", b"\xff", b"\x00", b"<a>" * 60]
JAVA = [
    b"\xac\xed\x00\x05",
    b"sr",
    b"ur",
    b"uq",
    b"t\xff\xff",
    b"q\x00~\x00\x00",
    b"p",
    b"x",
    b"\x7f\xff\xff\xff",
]
SWEEP = b"experiment: fuzzed-base.yaml\nseeds: 3\ngrid: {method.population: [4, 6], sensors: [4]}\n"
LARGEST = 64 << 20
"""Bytes that a small file may take while it is read."""


def refused(path: Path, read: Callable[[Path], Any], data: bytes) -> Any:
    """What is read of a file with these bytes; None when it is refused properly."""
    path.write_bytes(data)
    found = None
    tracemalloc.start()
    try:
        found = read(path)
        words = path.name
    except (InputError, RunError) as error:
        words = str(error)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < LARGEST, f"{peak >> 20} MiB for {len(data)} bytes"
    assert path.name in words, f"{words} does not name the file"
    assert len(words) < 20_000
    return found


def _searches() -> list[bytes]:
    return [b"simulation: minisim\n" + lines for lines in SEARCHES.split(b"---\n")]


@fuzz()
@given(data=mutated([*EXPERIMENTS, EVERYTHING, *_searches()], YAML))
def test_experiments(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "stadium.json").write_bytes((ROOT / "experiments" / "stadium.json").read_bytes())
    found: Experiment | None = refused(tmp_path / "fuzzed.yaml", Experiment.load, data)
    if found is not None:
        found.save(tmp_path / "saved.yaml")
        again = Experiment.load(tmp_path / "saved.yaml")
        assert json.dumps(again.to_mapping()) == json.dumps(found.to_mapping())


@fuzz()
@given(data=mutated([SWEEP], YAML))
def test_sweeps(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "fuzzed-base.yaml").write_bytes(EVERYTHING)
    refused(tmp_path / "fuzzed.yaml", Sweep.load, data)


def _controllers() -> list[bytes]:
    vectors = json.loads((ROOT / "protocol" / "vectors" / "controllers.json").read_text())
    found: list[bytes] = []

    def look(value: Any) -> None:
        if isinstance(value, dict):
            if {"version", "kind"} <= value.keys():
                found.append(json.dumps(value).encode())
            for inner in value.values():
                look(inner)
        elif isinstance(value, list):
            for inner in value:
                look(inner)

    look(vectors)
    return sorted({data for data in found if len(data) < 5000})


@fuzz()
@given(data=mutated(_controllers(), JSON))
def test_controllers(tmp_path: Path, data: bytes) -> None:
    found: Controller | None = refused(tmp_path / "fuzzed.json", Controller.load, data)
    if found is not None:
        found.save(tmp_path / "saved.json")
        assert Controller.load(tmp_path / "saved.json").specification == found.specification
        if found.sensors and found.sensors < 1000:
            found([0.0] * found.sensors)


@fuzz()
@given(data=mutated([(ROOT / "experiments" / "stadium.json").read_bytes()[:2000], b'{"width": 3}'], JSON))
def test_parameter_files(tmp_path: Path, data: bytes) -> None:
    found = refused(tmp_path / "fuzzed.json", read_object, data)
    assert found is None or isinstance(found, dict)


def _sessions() -> list[bytes]:
    data = ROOT / "tests" / "data" / "frevo"
    return [path.read_bytes()[:9000] for path in sorted(data.glob("*.zse"))]


@fuzz()
@given(data=mutated(_sessions(), XML))
def test_sessions_of_frevo(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "Stadium.json").write_bytes((ROOT / "experiments" / "stadium.json").read_bytes())
    refused(tmp_path / "fuzzed.zse", frevo.load, data)


def _results() -> list[bytes]:
    """FREVO's result files, the long ones with two of their fifty networks."""
    found = []
    for path in sorted((ROOT / "tests" / "data" / "frevo").glob("*.zre")):
        text = path.read_bytes()
        end = b"</FullyMeshedNet>"
        if text.count(end) > 2:
            second = text.index(end, text.index(end) + 1) + len(end)
            text = text[:second] + text[text.rindex(end) + len(end) :]
        found.append(text)
    return found


@fuzz(share=4)
@given(data=mutated(_results(), XML))
def test_results_of_frevo(tmp_path: Path, data: bytes) -> None:
    refused(
        tmp_path / "fuzzed.zre",
        lambda path: frevo.score(path, field=ROOT / "experiments" / "stadium.json"),
        data,
    )


@fuzz()
@given(data=mutated([SER, LIST], JAVA))
def test_fields_of_frevo(tmp_path: Path, data: bytes) -> None:
    refused(tmp_path / "fuzzed.ser", _document.read_field, data)


@fuzz(share=4)
@given(
    data=mutated(
        [b"# people\nada:$argon2id$v=19$m=19456,t=2,p=1$c2FsdHNhbHQ$aGFzaA\nbob:$7$1$aaaa$bbbb\n"],
        [b":", b"\n", b"\xff", b"#", b"$"],
    )
)
def test_password_files(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "fuzzed"
    if refused(path, lambda path: [set_password(path, "eve", "correct horse")], data) is not None:
        assert sum(line.lstrip().startswith("eve:$argon2id$") for line in path.read_text().splitlines()) >= 1


@fuzz()
@given(data=st.data())
def test_stores(finished: Run, tmp_path: Path, data: st.DataObject) -> None:
    """Pages of SQLite with other bytes in them, moved, missing."""
    whole = bytearray((finished.path / FILE).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(whole) - 1))
        piece = data.draw(st.binary(min_size=1, max_size=32))
        whole[at : at + len(piece)] = piece
    if data.draw(st.booleans()):
        del whole[data.draw(st.integers(0, len(whole))) :]
    folder = tmp_path / "damaged"
    folder.mkdir(exist_ok=True)
    (folder / FILE).write_bytes(whole)

    def look(_: Path) -> Any:
        run = Run.open(folder)
        facts = run.experiment, run.history, run.best, run.sessions, run.record, run.digest, run.state
        for number in range(min(3, run.generations)):
            run.evaluation(generation=number)
        return facts, list(run.attempts()), list(run.events())

    (folder / f"{FILE}-wal").unlink(missing_ok=True)
    refused_store(folder, look)


def refused_store(folder: Path, look: Callable[[Path], Any]) -> None:
    words = folder.name
    try:
        look(folder)
    except (InputError, RunError) as error:
        words = str(error)
    assert folder.name in words, words


def test_what_the_changes_start_from_is_read(tmp_path: Path) -> None:
    """Else no change would come far."""
    (tmp_path / "Stadium.json").write_bytes((ROOT / "experiments" / "stadium.json").read_bytes())
    (tmp_path / "fuzzed-base.yaml").write_bytes(EVERYTHING)
    for name, read, corpus in (
        ("all.yaml", Experiment.load, [EVERYTHING]),
        ("sweep.yaml", Sweep.load, [SWEEP]),
        ("one.json", Controller.load, _controllers()),
        ("one.zse", frevo.load, _sessions()),
    ):
        for data in corpus:
            assert refused(tmp_path / name, read, data) is not None
