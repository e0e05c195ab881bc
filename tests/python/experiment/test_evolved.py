"""Parameters that are evolved: checked before the run, and the same record however they are evaluated."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Controller, Experiment, InputError, Run, RunError, evaluate, optimize, simulate
from tests.python.records import same_record

PARAMETERS: dict[str, dict[str, Any]] = {
    "avoidance": {"type": "real", "range": [0, 5]},
    "avoidanceRadius": {"type": "real", "range": [0.5, 8], "scale": "log"},
    "evasion": {"type": "categorical", "choices": ["away", "left", "right"]},
    "maxSteps": {"type": "integer", "range": [10, 30]},
}
RULE = {"steering": "rule", "placement": "random", "numAgents": 3, "numDefenders": 3}


def experiment(parameters: dict[str, Any] | None = None, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": RULE,
            "controller": {"kind": "parameter_set", "parameters": PARAMETERS | (parameters or {})},
            "method": {"population": 12, "generations": 3},
            "ranking": {"episodes": 3},
            **changes,
        }
    )


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return optimize(experiment(), servers="local", out=tmp_path_factory.mktemp("evolved") / "run")


@pytest.mark.slow
@pytest.mark.parametrize("servers", [1, 3])
@pytest.mark.parametrize("mode", ["stepwise", "batched", "offloaded"])
def test_the_record_is_the_same_bytes(mode: str, servers: int, expected: Run, tmp_path: Path) -> None:
    run = optimize(experiment(mode=mode), servers=servers, out=tmp_path / "run")
    same_record(run, expected)
    assert {attempt.mode for attempt in run.attempts()} == {mode}


@pytest.mark.slow
def test_the_best_controller_is_its_values(expected: Run) -> None:
    best = expected.best
    values = best.controller.parameters
    assert list(values) == list(PARAMETERS)
    assert 0 <= values["avoidance"] <= 5
    assert values["evasion"] in PARAMETERS["evasion"]["choices"]
    assert isinstance(values["maxSteps"], int)
    one = expected.experiment.replace(controller={"kind": "layered"}, ranking={"episodes": 1})
    again = one.replace(parameters=values)
    # Put among the parameters by hand they give the same; so does the controller, which counts more.
    by_hand = simulate(again, servers="local")
    assert simulate(one, best.controller, servers="local") == by_hand
    assert simulate(again.replace(parameters={"maxSteps": 1}), best.controller, servers=1) == by_hand


def test_it_learns(tmp_path: Path) -> None:
    run = optimize(
        experiment(method={"population": 30, "generations": 10}), servers="local", out=tmp_path / "run"
    )
    assert run.history[-1].best_so_far > run.history[0].mean + 0.3


@pytest.mark.slow
def test_the_run_can_be_watched(expected: Run, program: Callable[..., Any], tmp_path: Path) -> None:
    shown = program("replay", expected.path, "--save", tmp_path / "best.gif")
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "best.gif").stat().st_size > 1000
    scenes = program("replay", expected.path, "--json").stdout.splitlines()
    assert json.loads(scenes[-1])["fitness"] == expected.best.fitness or len(scenes) > 2
    file = expected.path / "experiment.yaml"
    simulated = program("simulate", file, "--controller", expected.path, "--json")
    assert simulated.returncode == 0, simulated.stderr
    assert json.loads(simulated.stdout)["fitness"] == json.loads(scenes[-1])["fitness"]
    assert json.loads(simulated.stdout)["parameters"] == expected.best.controller.parameters
    random = program("simulate", file).stdout.splitlines()
    assert random[0].endswith(" with random values.")
    assert [pair.split()[0] for pair in random[1].split(", ")] == list(expected.best.controller.parameters)


MISTAKES = [
    (
        "parameters: {steering: rule, avoidance: 2}",
        "avoidance: {type: real, range: [0, 5]}",
        "6: controller.parameters.avoidance: is also one of the experiment's parameters; remove it",
    ),
    (
        "parameters: {steering: rule}",
        "avoidence: {type: real, range: [0, 5]}",
        "6: controller.parameters.avoidence: unknown parameter of minisim; did you mean 'avoidance'?",
    ),
    (
        "parameters: {steering: rule}",
        "avoidance: {type: real, range: [-1, 5]}",
        "6: controller.parameters.avoidance: minisim refuses -1.0: -1.0 found, expected a finite number",
    ),
    (
        "parameters: {steering: rule}",
        "evasion: {type: categorical, choices: [left, up]}",
        "6: controller.parameters.evasion: minisim refuses 'up': \"up\" (a string) found, expected one of ",
    ),
    (
        "parameters: {maxSteps: 9}",
        "avoidance: {type: real, range: [0, 5]}",
        "4: controller.kind: parameter_set controls no agents, but agents of minisim must be controlled; set",
    ),
    (
        "parameters: {}",
        "steering: {type: categorical, choices: [rule, controller]}",
        "4: controller.kind: parameter_set controls no agents",
    ),
]


@pytest.mark.parametrize(("fixed", "evolved", "words"), MISTAKES)
def test_what_does_not_fit_is_told_with_its_line(
    fixed: str, evolved: str, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "e.yaml"
    file.write_text(
        f"simulation: minisim\n{fixed}\ncontroller:\n  kind: parameter_set\n  parameters:\n    {evolved}\n"
    )
    with pytest.raises(InputError) as caught:
        Experiment.load(file)
    assert str(caught.value).startswith(f"{file}:{words}"), str(caught.value)


def test_a_simulation_without_a_rule_needs_another_controller() -> None:
    with pytest.raises(InputError, match="of emergency_exit must be controlled; use a controller of"):
        Experiment.from_mapping(
            {
                "simulation": "emergency_exit",
                "controller": {
                    "kind": "parameter_set",
                    "parameters": {"steps": {"type": "integer", "range": [5, 9]}},
                },
            }
        )


def test_a_controller_with_unknown_parameters_is_refused() -> None:
    controller = Controller(
        {
            "version": 1,
            "kind": "parameter_set",
            "parameters": [{"name": "avoid", "type": "real"}],
            "weights": [1],
        }
    )
    with pytest.raises(InputError, match="controller: avoid: unknown parameter of minisim; did you mean"):
        simulate(experiment(), controller, servers="local")


PLAIN = Experiment.from_mapping(
    {
        "simulation": "line",
        "requirements": {"dimensions": 1},
        "parameters": {"length": 3},
        "controller": {
            "kind": "parameter_set",
            "parameters": {
                "speed": {"type": "real", "range": [-2, 2]},
                "steps": {"type": "integer", "range": [1, 4]},
                "turn": {"type": "categorical", "choices": ["left", "right"]},
            },
        },
        "method": {"population": 12, "generations": 3},
        "timeouts": {"discovery": 3, "step": 2},
    }
)


@pytest.mark.slow
def test_a_server_that_knows_d61_alone_runs_by_itself(
    foreign: Callable[..., Any], any_broker: str, tmp_path: Path
) -> None:
    with foreign(any_broker, "line", runs_itself=True) as server:
        run = optimize(PLAIN, broker=any_broker, out=tmp_path / "run")
        assert run.audit is not None
        assert server.episodes == run.evaluations + run.audit["episodes"]
    sent = server.parameters
    assert all(message["length"] == 3 and message["steps"] in {1, 2, 3, 4} for message in sent)
    assert {message["turn"] for message in sent} == {"left", "right"}
    assert len({message["simulation_hash"] for message in sent}) == len(sent)
    best = run.best.controller.parameters
    way = 1 if best["turn"] == "right" else -1
    assert run.best.fitness == -abs(best["speed"] * best["steps"] * way - 1)
    assert (run.experiment.sensors, run.experiment.actuators) == (None, None)
    with foreign(any_broker, "line", runs_itself=True):
        assert simulate(PLAIN, run.best.controller, broker=any_broker) == run.best.fitness


def test_a_server_that_asks_for_steering_ends_the_run_with_the_cure(
    foreign: Callable[..., Any], embedded_broker: str, tmp_path: Path
) -> None:
    with (
        foreign(embedded_broker, "line"),
        pytest.raises(RunError, match="a parameter set steers no agents; use a controller of another kind"),
    ):
        optimize(PLAIN, broker=embedded_broker, out=tmp_path / "run")


def test_a_server_that_is_silent_for_too_long_is_named(
    foreign: Callable[..., Any], embedded_broker: str, tmp_path: Path
) -> None:
    def silent(topic: str, message: dict[str, Any]) -> dict[str, Any] | None:
        return None if topic == "fitness" else message

    patient = PLAIN.replace(timeouts={"step": 0.2}, method={"kind": "random_search", "population": 1})
    with (
        foreign(embedded_broker, "line", runs_itself=True, trouble=silent),
        pytest.raises(RunError, match=r"server 77 has not sent the fitness of its episode for 0\.2 s"),
    ):
        optimize(patient, broker=embedded_broker, out=tmp_path / "run")


def test_a_real_number_for_a_parameter_of_integers(tmp_path: Path) -> None:
    file = tmp_path / "evolved.yaml"
    file.write_text(
        "simulation: minisim\n"
        "parameters: {steering: rule}\n"
        "controller:\n"
        "  kind: parameter_set\n"
        "  parameters:\n"
        "    avoidance: {type: real, range: [0, 5]}\n"
        "    maxSteps: {type: real, range: [10, 30]}\n"
    )
    with pytest.raises(InputError) as raised:
        Experiment.load(file)
    found = str(raised.value)
    assert found.startswith(f"{file}:7: controller.parameters.maxSteps: minisim refuses 18.7"), found
    assert found.endswith("; for an integer parameter, write type: integer"), found
    assert "\n" not in found


def test_the_parameter_that_is_wrong_is_named(tmp_path: Path) -> None:
    """Once, also where it is wrong beside each value of the others."""
    (tmp_path / "world.py").write_text(
        "from swarmwright import Simulation\n"
        "class World(Simulation):\n"
        "    sensors = actuators = 0\n"
        "    parameters = {'big': False, 'k': 2, 'level': 1}\n"
        "    metrics = ['score']\n"
        "    def measure(self): return {'score': 0.0}\n"
        "    def reset(self, parameters, seed): pass\n"
        "    def step(self, actuators): pass\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 0.0\n"
    )
    file = tmp_path / "evolved.yaml"
    file.write_text(
        "simulation: world.py:World\n"
        "fitness: score\n"
        "controller:\n"
        "  kind: parameter_set\n"
        "  parameters:\n"
        "    k: {type: integer, range: [1, 9]}\n"
        "    big: {type: integer, range: [0, 1]}\n"
        "    level: {type: real, range: [0, 5]}\n"
    )
    with pytest.raises(InputError) as raised:
        Experiment.load(file)
    found = str(raised.value).replace(f"{file}:", "").splitlines()
    assert [line.partition(" refuses ")[0] for line in found] == ["7: controller.parameters.big: world"] * 2
    assert [line.partition(" refuses ")[2] for line in found] == [
        f"{value}: {value} found, expected a boolean; for a boolean, write {{type: categorical, choices: "
        "[true, false]}"
        for value in (0, 1)
    ]


def test_integers_are_proposed_only_where_both_limits_are_accepted() -> None:
    with pytest.raises(InputError) as raised:
        experiment({"maxSteps": {"type": "real", "range": [0, 30]}})
    found = str(raised.value).splitlines()
    assert [line.partition("refuses ")[2].partition(":")[0] for line in found][:1] == ["0.0"]
    assert "write type: integer" not in str(raised.value)


STEERED = """
from swarmwright import Parameter, Simulation


class Steered(Simulation):
    title, sensors, actuators = "steered", 0, 0
    parameters = {"gear": Parameter(1, choices=[1, 2, 4]), "share": 0.5, "walls": True}

    def reset(self, parameters, seed):
        assert type(parameters["gear"]) is int
        assert type(parameters["share"]) is float
        assert type(parameters["walls"]) is bool
        self.value = parameters["gear"] + parameters["share"] + 10 * parameters["walls"]

    def step(self, actions):
        pass

    def done(self):
        return True

    def fitness(self):
        return self.value
"""


def test_choices_that_are_numbers_or_booleans(tmp_path: Path) -> None:
    (tmp_path / "steered.py").write_text(STEERED)
    evolved = {
        "gear": {"type": "categorical", "choices": [1, 2, 4]},
        "share": {"type": "categorical", "choices": [0.25, 0.5]},
        "walls": {"type": "categorical", "choices": [True, False]},
    }
    values = {
        "simulation": f"{tmp_path}/steered.py:Steered",
        "controller": {"kind": "parameter_set", "parameters": evolved},
    }
    experiment = Experiment.from_mapping(values)
    genomes = np.array([[0, 0, 0], [0.5, 1, 1], [1, 0, 1]], dtype=np.float32)
    assert evaluate(experiment, genomes, servers="in-process").tolist() == [11.25, 2.5, 4.25]
    again = Experiment.from_mapping(experiment.to_mapping())
    assert again.to_mapping() == experiment.to_mapping()
    evolved["gear"]["choices"] = [1, 3]
    with pytest.raises(InputError, match=r"gear: .* refuses 3: 3 found, expected one of 1, 2, 4"):
        Experiment.from_mapping(values)


@pytest.mark.parametrize(
    ("simulation", "name"),
    [
        ("minisim", "hops"),
        ({"command": "python3 -V", "log": "stdout"}, "walls"),
        ("steered.py:Steered", "gear"),
    ],
)
def test_booleans_need_a_class_that_declares_them(
    simulation: Any, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("steered.py").write_text(STEERED)
    evolved = {name: {"type": "categorical", "choices": [True, False]}}
    controller = {"kind": "parameter_set", "parameters": evolved}
    with pytest.raises(
        InputError, match=rf"controller\.parameters\.{name}\.choices: booleans need a Python class"
    ):
        Experiment.from_mapping({"simulation": simulation, "controller": controller, "fitness": "m"})
