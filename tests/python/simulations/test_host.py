"""What a class says of itself, and how it is found."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Episodes, Experiment, InputError, Parameter, Simulation
from swarmwright.common.simulation_names import is_python
from swarmwright.simulations import catalogue
from swarmwright.simulations.host import describe, find_misspelt_attributes
from swarmwright.simulations.loading import load
from swarmwright.simulations.names import make_absolute, name_of
from swarmwright.simulations.parameters import fill_parameters, parse_parameters
from tests.python.simulations import troubled
from tests.python.simulations.troubled import Walk


def test_what_is_announced() -> None:
    plain = describe(Walk()).plain()
    steps = {"type": "integer", "default": 4, "description": ""}
    trouble = {"type": "string", "default": "", "description": ""}
    assert plain == {
        "title": "walk",
        "dimensions": 1,
        "max_agents": None,
        "sensors": 2,
        "actuators": 1,
        "sensor_names": [],
        "actuator_names": [],
        "sensor_units": [],
        "actuator_units": [],
        "parameters": {"steps": steps, "trouble": trouble},
        "metrics": {"steps": {"unit": "", "description": "Steps done."}},
        "determinism": None,
    }


def test_properties_serve_as_well_and_the_class_gives_the_title() -> None:
    class Wide(Walk):
        title = ""

        @property
        def sensors(self) -> int:  # type: ignore[override]
            return 7

    described = describe(Wide())
    assert (described.title, described.sensors) == ("wide", 7)


def test_a_step_lasts_as_long_as_the_class_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time of a frame stands for it only where the class sets it."""
    assert describe(Walk()).step_seconds is None
    monkeypatch.setattr(Walk, "frame_seconds", 0.2, raising=False)
    assert describe(Walk()).step_seconds == 0.2
    monkeypatch.setattr(Walk, "frame_seconds", 0)
    assert describe(Walk()).step_seconds is None
    monkeypatch.setattr(Walk, "step_seconds", 0.01)
    assert describe(Walk()).step_seconds == 0.01


def test_integers_of_numpy_serve_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Walk, "sensors", np.int64(2))
    described = describe(Walk())
    assert (described.sensors, type(described.sensors)) == (2, int)
    assert Experiment.from_mapping({"simulation": Walk}).sensors == 2


def test_an_object_in_the_place_of_a_class() -> None:
    with pytest.raises(InputError, match=r"^simulation: is an object of the class Walk; pass the class "):
        Experiment.from_mapping({"simulation": Walk()})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("sensors", -1, "Walk.sensors: -1 found, expected an integer from 0"),
        ("sensors", 0, "Walk.sensors: 0 found, expected at least 1; .* set actuators to 0, too"),
        ("actuators", 0, "Walk.actuators: 0 found, expected at least 1; .* set sensors to 0, too"),
        ("sensors", 2.0, "Walk.sensors: 2.0 found"),
        ("actuators", None, "Walk.actuators: None found"),
        ("sensor_names", ["x"], "Walk.sensor_names: 1 names found, expected 2"),
        ("sensor_units", ["m"], "Walk.sensor_units: 1 units found, expected 2"),
        ("sensor_names", "xy", "Walk.sensor_names: 'xy' found, expected a list of 2 names"),
        ("sensor_ranges", [(0, 1)], "Walk.sensor_ranges: 1 ranges found, expected 2"),
        ("actuator_ranges", [(1, 1)], r"Walk.actuator_ranges: \(1, 1\) found, expected \(low, high\)"),
        ("actuator_names", [1], r"Walk.actuator_names: \[1\] found, expected text only"),
        (
            "determinism",
            "exact",
            "Walk.determinism: 'exact' found, expected one of bitwise, statistical, none",
        ),
        ("tolerance", float("nan"), "Walk.tolerance: nan found, expected a number, 0 or more"),
        ("step_seconds", 0, "Walk.step_seconds: 0 found, expected seconds above 0, or None"),
        ("step_seconds", "1", "Walk.step_seconds: '1' found, expected a number"),
        ("dimensions", -1, "Walk.dimensions: -1 found, expected an integer from 0"),
        ("max_agents", "many", "Walk.max_agents: 'many' found"),
        ("title", 7, "Walk.title: 7 found, expected text"),
        ("metrics", 7, "Walk.metrics: 7 found, expected names"),
        ("metrics", ["a-b"], "Walk.metrics: 'a-b' found, expected a letter .A-Z, a-z. or _"),
        ("metrics", ["ñandú_λ"], "letters, digits and _$"),
        ("metrics", ["fitness"], "Walk.metrics: 'fitness' is the name of the fitness"),
        ("metrics", {"a": 1}, r"Walk.metrics\['a'\]: 1 found, expected a description"),
        ("parameters", ["a"], r"Walk.parameters: \['a'\] found, expected a mapping"),
        ("parameters", {"seed": 1}, "Walk.parameters: leave out 'seed'"),
        (
            "parameters",
            {"a": Parameter(1, maximum=0)},
            r"Walk.parameters\['a'\]: default: 1 found, expected at most 0",
        ),
        ("parameters", {"a": object()}, r"Walk.parameters\['a'\]: default: .* expected a JSON value"),
    ],
)
def test_what_cannot_be(name: str, value: Any, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Walk, name, value)
    with pytest.raises(InputError, match=words):
        describe(Walk())


KNOWN = parse_parameters(
    {
        "count": Parameter(3, minimum=1),
        "speed": 0.5,
        "on": True,
        "kind": Parameter("a", choices=["a", "b"]),
        "where": [0.0, 1.0],
        "any": None,
    },
    "Test",
)


def test_parameters_are_filled_in() -> None:
    values = fill_parameters(KNOWN, {"count": 4.0, "speed": 2, "any": {"x": 1}, "other": "o"})
    assert values == {
        "count": 4, "speed": 2.0, "on": True, "kind": "a", "where": [0.0, 1.0], "any": {"x": 1}, "other": "o"
    }  # fmt: skip
    assert [type(values[name]) for name in ("count", "speed")] == [int, float]
    values["where"].append(2.0)
    assert fill_parameters(KNOWN, {})["where"] == [0.0, 1.0]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"count": 0}, "count: 0 found, expected at least 1"),
        ({"count": 1.5}, "count: 1.5 found, expected an integer"),
        ({"count": 10**400}, "count: 10+ found, expected an integer"),
        ({"speed": -(10**400)}, "speed: -10+ found, expected a number"),
        ({"count": True}, "count: True found, expected an integer"),
        ({"speed": "fast"}, "speed: 'fast' found, expected a number"),
        ({"on": 1}, "on: 1 found, expected a boolean"),
        ({"kind": "c"}, "kind: 'c' found, expected one of 'a', 'b'"),
        ({"where": 1}, "where: 1 found, expected a list"),
    ],
)
def test_parameters_that_do_not_fit(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"^{words}$"):
        fill_parameters(KNOWN, given)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"step": 4}, "parameters.step: unknown parameter of walk; did you mean 'steps'?"),
        ({"steps": 0}, "parameters.steps: 0 found, expected at least 1"),
    ],
)
def test_an_experiment_is_checked_against_the_class(parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping({"simulation": Walk, "parameters": parameters})
    assert str(caught.value) == words


def test_names() -> None:
    assert all(map(is_python, ("a.py:B", "/a b/c.py:D", "a:B", "a.b.c:D")))
    assert not any(
        map(is_python, ("minisim", "a:b c", "gazebo: stadium", "a.py", "a.b", "9:B", "http://a:b"))
    )
    assert make_absolute("../a.py:B", Path("/x/y")) == "/x/a.py:B"
    assert make_absolute("a.b:C") == "a.b:C"


def test_a_class_is_found_by_its_name(tmp_path: Path) -> None:
    name = f"{troubled.__file__}:Walk"
    kind = load(name)
    assert kind is load(name)
    assert name_of(kind) == name
    assert load(name_of(Walk)) is Walk

    class Within(Walk):
        pass

    with pytest.raises(InputError, match="Within is not defined at the top level of a module"):
        name_of(Within)
    before = list(sys.path)
    (tmp_path / "json.py").write_text("raise RuntimeError('hides a module')\n")
    (tmp_path / "beside.py").write_text("sensors = 3\n")
    (tmp_path / "mine.py").write_text(
        "import json, beside\nfrom swarmwright import Simulation\n"
        "class Mine(Simulation):\n    sensors = beside.sensors\n"
    )
    assert getattr(load("mine.py:Mine", tmp_path), "sensors") == 3  # noqa: B009 - of no base class
    sys.path[:] = before


@pytest.mark.parametrize(
    ("text", "name", "words"),
    [
        ("", "there.py:A", "there.py: has no class 'A'; it has no subclass of swarmwright.Simulation"),
        ("class A: pass", "there.py:A", "there.py: A is not a subclass of swarmwright.Simulation"),
        (
            "from swarmwright import Simulation as S\nclass Gather(S): pass",
            "there.py:Gathre",
            "did you mean 'Gather'",
        ),
        ("", "away.py:A", "away.py: there is no such file"),
        (
            "",
            "no.such.module:A",
            f"there is no module 'no.such.module' in the working folder, {Path.cwd()}, ",
        ),
        ("x = 1\ny = x /", "there.py:A", "there.py:2: invalid syntax"),
        (
            "x = 1\n\ny = x / 0",
            "there.py:A",
            "there.py:3: ZeroDivisionError while it is imported: division by zero",
        ),
        (
            "from swarmwright import Simulation as S\nclass A(S):\n def reset(self, parameters, seed): pass",
            "there.py:A",
            "A: has no method done, fitness, step; a simulation needs reset, step, done and fitness",
        ),
        (
            "from swarmwright import Experiment\nExperiment.from_mapping({'simulation': f'{__file__}:A'})",
            "there.py:A",
            "there.py:2: ImportError while it is imported: the file starts a run of itself while it is",
        ),
        ("import no_such_thing", "there.py:A", "there.py:1: ModuleNotFoundError while it is imported"),
        ("from .parts import A", "there.py:A", "there.py:1: a relative import needs a package"),
    ],
)
def test_what_cannot_be_loaded(text: str, name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "there.py").write_text(text)
    file = tmp_path / "x.yaml"
    file.write_text(f"simulation: {name}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"{file}:1: simulation: ")


def test_a_relative_import_is_answered_with_the_name_of_the_module(tmp_path: Path) -> None:
    package = tmp_path / "mysim"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "world.py").write_text("from .parts import A")
    with pytest.raises(InputError) as caught:
        load(f"{package}/world.py:A")
    assert f"by its module, mysim.world:Class, and start in {tmp_path}, or" in str(caught.value)
    assert "swarmwright simulation" not in str(caught.value)


def test_the_class_cannot_be_made_without_its_methods() -> None:
    with pytest.raises(TypeError, match="abstract"):
        Simulation()  # type: ignore[abstract]


def test_the_arena_is_stepped_as_often_as_it_is_shown() -> None:
    # The catalogue repeats TICK of engine/worlds/arena; the engine tells the default of `stepSize`, which
    # shows a step for as long as it takes.
    assert catalogue.step_seconds("arena") == Episodes("arena", {"mission": "aggregation"}).step_seconds
    assert catalogue.step_seconds("minisim") is None


def test_an_attribute_that_is_probably_misspelt_is_named() -> None:
    class Typing(Walk):
        sensor_name = ("left", "right")
        most_step = 5

        def measures(self) -> dict[str, float]:
            return {}

    # Walk has a method measure itself.
    found = find_misspelt_attributes(Typing)
    assert [text.partition(":")[0] for text in found] == ["Typing.sensor_name", "Typing.most_step"]
    assert found[0].endswith("has no effect; did you mean 'sensor_names'?")


def test_attributes_of_ones_own_are_not() -> None:
    class Own(Walk):
        sensor_range = 0.5  # not `sensor_ranges`, which has a value for each sensor
        step_size = 0.1
        noise, speed, agents = 0.1, 2, 3
        sensor_names, sensor_name = ("left", "right"), ("x", "y")

        def look(self) -> None: ...

    assert find_misspelt_attributes(Own) == []
    assert find_misspelt_attributes(Walk) == []


def test_metrics_without_measure_are_refused_in_new_runs(tmp_path: Path) -> None:
    (tmp_path / "walk.py").write_text(
        "from swarmwright import Simulation\n\n"
        "class Walk(Simulation):\n"
        "    sensors = actuators = 1\n"
        "    metrics = {'collisions': ''}\n"
        "    def reset(self, parameters, seed): return [[0.0]]\n"
        "    def step(self, actions): return [[0.0]]\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 1.0\n"
    )
    (tmp_path / "walk.yaml").write_text("simulation: walk.py:Walk\n")
    words = r"Walk\.metrics declares collisions, but the class has no method measure\(\)"
    with pytest.raises(InputError, match=rf"walk\.yaml:1: simulation: {words}"):
        Experiment.load(tmp_path / "walk.yaml")
    with pytest.raises(InputError, match=rf"^simulation: {words}"):
        Experiment.from_mapping({"simulation": f"{tmp_path}/walk.py:Walk"})
