"""Files of a drawn model become an experiment."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import InputError, evaluate
from swarmwright.interop import models
from swarmwright.interop.models._experiment import Model, Parameters
from swarmwright.interop.models._files import load as load_part
from swarmwright.interop.models._parts import SimulationParameters
from swarmwright.simulations.names import make_absolute
from tests.python.interop.models.conftest import Edited


def parameters_of(*paths: Path, **options: Any) -> dict[str, Any]:
    return models.load(paths, **options).experiment.parameters


def test_a_model_becomes_an_experiment(drawn: list[Path]) -> None:
    imported = models.load(drawn)
    experiment = imported.experiment
    assert experiment.simulation == "minisim"
    assert experiment.parameters == {
        "numAgents": 3,
        "numDefenders": 2,
        "speedDefenders": 0.4,
        "placement": "random",
        "steering": "rule",
    }
    controller = experiment.controller.model_dump()
    assert controller["kind"] == "parameter_set"
    assert {name: one["range"] for name, one in controller["parameters"].items()} == {
        "avoidance": [0.0, 5.0],
        "maxSteps": [15, 30],
    }
    assert controller["parameters"]["maxSteps"]["type"] == "integer"
    assert "rosPath = /opt/ros: minisim has no parameter" in imported.yaml
    assert "# command_line, parameters.json:3" in imported.yaml
    assert [note for note in imported.notes if "says 2, but the swarm has 3" in note]
    genomes = np.array([[0.4, 0.5], [0.0, 1.0]], dtype=np.float32)
    assert len(evaluate(experiment, genomes, servers="local")) == 2


def test_a_folder_is_a_model(drawn: list[Path]) -> None:
    assert models.load([drawn[0].parent]).experiment == models.load(drawn).experiment


def test_a_problem_alone_is_steered_by_a_network(edited: Edited) -> None:
    experiment = models.load([edited("problem.xml")]).experiment
    assert experiment.controller.kind == "layered"
    assert experiment.parameters["maxSteps"] == 25
    assert experiment.parameters["numAgents"] == 2


def test_another_controller_and_method(drawn: list[Path]) -> None:
    imported = models.load(drawn, controller="mealy_fsm", method="random_search")
    assert imported.experiment.controller.kind == "mealy_fsm"
    assert imported.experiment.method.model_dump()["kind"] == "random_search"
    assert any("avoidance, maxSteps are not evolved" in note for note in imported.notes)
    with pytest.raises(InputError, match="controller: unknown"):
        models.load(drawn, controller="mealy")


def test_a_simulation_that_is_not_built_in_gets_every_parameter(edited: Edited) -> None:
    problem = edited("problem.xml", ("minisim.Minisim", "coverage.Coverage"))
    swarm = edited("swarm.xml", ("</Swarm>", '<SwarmMember name="scouts" launchFile="scouts"/></Swarm>'))
    parameters = edited("parameters.json", ("maxSteps", "scouts"))
    imported = models.load([problem, swarm, parameters])
    experiment = imported.experiment
    assert experiment.simulation == "Coverage"
    assert (experiment.sensors, experiment.actuators) == (4, 1)
    assert experiment.parameters["rosPath"] == "/opt/ros"
    assert experiment.parameters["Agent"] == 3
    assert "scouts" not in experiment.parameters  # it is evolved
    assert experiment.requirements.max_agents == 33
    assert any(" is not a built-in simulation" in note for note in imported.notes)


def test_the_number_of_agents_may_be_evolved(edited: Edited) -> None:
    paths = [edited("problem.xml"), edited("swarm.xml"), edited("parameters.json", ("maxSteps", "agent"))]
    experiment = models.load(paths).experiment
    assert "numAgents" not in experiment.parameters
    assert experiment.controller.model_dump()["parameters"]["numAgents"]["range"] == [15, 30]


@pytest.mark.parametrize("scale", ['"1"', "1", "1.0"])
def test_a_scale_is_a_number_or_text(edited: Edited, scale: str) -> None:
    path = edited("parameters.json", ('"0.1"', scale))
    controller = models.load([path], simulation="minisim").experiment.controller.model_dump()
    assert controller["parameters"]["avoidance"]["range"] == [0, 50]
    assert controller["parameters"]["avoidance"]["type"] == "integer"


@pytest.mark.parametrize(
    ("name", "change", "answer"),
    [
        ("problem.xml", ('value="25"', 'value="2.5"'), "problem.xml:9: <propentry>: steps: '2.5' found"),
        ("problem.xml", ('value="0.4f"', 'value="NaN"'), "problem.xml:12: .*speedDefenders: 'NaN' found"),
        ("problem.xml", ('"FLOAT"', '"FLOATS"'), "problem.xml:12: .*unknown type 'FLOATS'; expected INT"),
        ("problem.xml", ('key="num_defenders"', 'key="steps"'), r"duplicate key 'steps' \(first in line 9\)"),
        ("problem.xml", ('key="steps" ', ""), "problem.xml:9: <propentry>: the attribute key is missing"),
        ("problem.xml", ("<config>", "<configs/><config>"), "<configs>: found inside <icomponent>"),
        ("problem.xml", ('"minisim.Minisim"', '""'), "has neither classname nor name"),
        ("problem.xml", ('value="4"', 'value="5"'), "has 5 sensors, but minisim has 4"),
        (
            "problem.xml",
            ('Candidates" type="INT" value="1"', 'Candidates" type="INT" value="2"'),
            "competing",
        ),
        ("problem.xml", ("<icomponent>", "<icomponent>&x;"), "entity x of a DTD"),
        ("problem.xml", ("</config>", ""), "is not valid XML: mismatched tag"),
        (
            "parameters.json",
            ('"maxSteps"', '"avoidance"'),
            r"3: .*duplicate name 'avoidance' \(first in line 2",
        ),
        ("parameters.json", ('"maxSteps"', '"maxStep"'), "no parameter 'maxStep'; did you mean 'maxSteps'"),
        ("parameters.json", (', "scale": 1', ""), r"parameters.json:3: parameters\[1\]: scale is missing"),
        ("parameters.json", ('"0.1"', '"ten"'), "2: parameters.*scale: expected a number above 0, .*'ten'"),
        ("parameters.json", ('"0.1"', "NaN"), "json:2: is not valid JSON: NaN is not a JSON number"),
        ("parameters.json", ('"max": 50', '"max": 0'), "2: .*max: 0 found, expected a number above min, 0"),
        ("parameters.json", ('"max": 50', '"max": "50"'), "expected a number within"),
        ("parameters.json", ("command_line", "command line"), "expected command_line or file:PACKAGE"),
        ("parameters.json", ('"min"', '"minimum"'), "unknown key; .*\n.*min is missing"),
        (
            "parameters.json",
            ('"min": 0', '"min": 0, "min": 1'),
            r"duplicate key in one object \(first in line 2",
        ),
        ("swarm.xml", (' launchFile="agent.launch"', ""), "swarm.xml:3: .*attribute launchFile is missing"),
        ("swarm.xml", ('"3"', '"three"'), "swarm.xml:3: <SwarmMember>: 'three' found"),
        ("swarm.xml", ('"3"', '"0"'), "has no agents"),
        ("swarm.xml", ("<SwarmMember", "<Member"), "<Member>: found inside <Swarm>; expected <SwarmMember>"),
        (
            "swarm.xml",
            ("Swarm name", "Swarms name"),
            "swarm.xml:2: <Swarms>: unknown root element.* did you mean 'Swarm'",
        ),
    ],
)
def test_what_is_wrong_is_named(edited: Edited, name: str, change: tuple[str, str], answer: str) -> None:
    paths = [edited(name, change)]
    if name != "problem.xml":
        paths.append(edited("problem.xml"))
    with pytest.raises(InputError, match=answer):
        models.load(paths)


def test_problems_of_all_files_are_reported_at_once(edited: Edited) -> None:
    paths = [
        edited("problem.xml", ('value="25"', 'value="x"'), ("0.4f", "y")),
        edited("parameters.json", ('"0.1"', '""')),
        edited("swarm.xml", ('"3"', '""')),
    ]
    with pytest.raises(InputError) as caught:
        models.load(paths)
    assert len(str(caught.value).splitlines()) == 4


def test_files_that_contradict_each_other(edited: Edited, tmp_path: Path) -> None:
    first = edited("swarm.xml")
    other = first.rename(tmp_path / "other.xml")
    with pytest.raises(InputError, match=r"the swarm is also described by .*other\.xml"):
        models.load([other, edited("swarm.xml"), edited("problem.xml")])


@pytest.mark.parametrize(
    ("name", "text", "answer"),
    [
        (
            "x.xml",
            "<experiment/>",
            "x.xml:1: <experiment>: unknown root element; expected a FREVO session",
        ),
        ("x.json", "{}", "unknown kind of JSON file; expected"),
        ("x.json", "[1, 2]", "unknown kind of JSON file"),
        ("x.json", '{"parameters": [}', "x.json:1: is not valid JSON"),
        ("x.json", "", "is empty; expected"),
        ("x.txt", "hello", "unknown kind of file; expected"),
        ("x.onnx", "\x08\x08", r"x\.onnx: ONNX models cannot be converted to controllers; expected"),
        ("x.zse", "<frevo/>", "is a FREVO session; import it without other files"),
    ],
)
def test_unknown_files_are_refused(tmp_path: Path, name: str, text: str, answer: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=answer):
        models.load([tmp_path / name])


def test_without_a_simulation_or_with_one_that_cannot_steer_itself(edited: Edited) -> None:
    with pytest.raises(InputError, match="the simulation is missing"):
        models.load([edited("parameters.json")])
    with pytest.raises(InputError, match="emergency_exit needs a controller"):
        models.load([edited("parameters.json")], simulation="emergency_exit")


@pytest.mark.slow
def test_the_command_line(program: Any, drawn: list[Path], tmp_path: Path) -> None:
    done = program("import", *drawn, "--output", "drawn.yaml")
    assert done.returncode == 0, done.stderr
    assert "the swarm has 3" in done.stderr
    assert program("import", *drawn, "--output", "drawn.yaml").returncode == 2
    wrong = program("import", *drawn, "--ranking", "absolute")
    assert wrong.returncode == 2
    assert "--ranking does not apply to a drawn model" in wrong.stderr
    run = program("optimize", "drawn.yaml", "--set", "method.generations=2", "--set", "servers=local")
    assert run.returncode == 0, run.stderr
    (tmp_path / "empty").mkdir()
    assert "contains no file with the suffix" in program("import", "empty").stderr


def test_letters_of_other_scripts_are_no_signs(edited: Edited) -> None:
    paths = [
        edited("problem.xml"),
        edited("parameters.json", ("maxSteps", "Απόσταση")),
        edited("swarm.xml", ("Agent", "Ρομπότ")),
    ]
    with pytest.raises(InputError, match="minisim has no parameter 'Απόσταση'"):
        models.load(paths)
    paths = [
        edited("problem.xml", ("minisim.Minisim", "lab.Lab")),
        edited("parameters.json", ("avoidance", "βάρος"), ("maxSteps", "ρυθμός")),
        edited("swarm.xml", ("Agent", "ρομπότ")),
    ]
    experiment = models.load(paths).experiment
    assert experiment.parameters["ρομπότ"] == 3
    assert list(vars(experiment.controller)["parameters"]) == ["βάρος", "ρυθμός"]
    assert experiment.requirements.max_agents == 3


def test_names_of_several_parameters_are_refused(edited: Edited, tmp_path: Path) -> None:
    (tmp_path / "lab.py").write_text(
        "from swarmwright import Simulation\n"
        "class Lab(Simulation):\n"
        "    sensors = actuators = 0\n"
        "    parameters = {'light+': 1.0, 'light-': 1.0, 'speed': 1.0}\n"
        "    def reset(self, parameters, seed): pass\n"
        "    def step(self, actuators): pass\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 0.0\n"
    )
    simulation = f"{tmp_path / 'lab.py'}:Lab"
    changes = ('"steps" type="INT" value="25"', '"light" type="INT" value="25"')
    words = "'light' is ambiguous in .*: 'light\\+' or 'light-'; write one of these names"
    known = SimulationParameters(make_absolute(simulation))
    assert [known.find(one) for one in ("light-", "Speed", "light", "+")] == ["light-", "speed", None, None]
    with pytest.raises(InputError, match=words):
        Parameters.from_model(
            Model.from_parts([load_part(edited("problem.xml", changes))]), known, evolved=False
        )
    part = load_part(edited("parameters.json", ("maxSteps", "light")))
    with pytest.raises(InputError, match=words):
        Parameters.from_model(Model.from_parts([part]), known, evolved=True)
    twice = ('number="3"/>', 'number="3"/><SwarmMember name="A-gent" launchFile="b" number="2"/>')
    files = edited("parameters.json", ("maxSteps", "a gent")), edited("swarm.xml", twice)
    parts = [load_part(file) for file in files]
    with pytest.raises(InputError, match="'a gent' is ambiguous: 'Agent' or 'A-gent'"):
        Parameters.from_model(Model.from_parts(parts), known, evolved=True)


def test_names_with_colons_and_line_breaks_stay_names(tmp_path: Path) -> None:
    """They do not become keys of the experiment, neither in its list nor in what is left out."""
    properties = '<propentry key="a: 1&#10;seed: 9" type="INT" value="1"/>'
    entry = '<entry key="classname" value="NAME"/>'
    for name, parameters in (("Elsewhere", {"a: 1\nseed: 9": 1}), ("minisim.Minisim", {})):
        path = tmp_path / "problem.xml"
        path.write_text(
            f"<icomponent><config>{entry.replace('NAME', name)}</config><properties>{properties}</properties>"
            "</icomponent>"
        )
        imported = models.load([path])
        assert imported.experiment.seed == 1
        assert imported.experiment.parameters == parameters
        assert ("not imported: a: 1\\nseed: 9 = 1" in imported.yaml) == (not parameters)
    path = tmp_path / "escape.sysml"
    path.write_text(
        "package P { attribute 'a: b\\nseed: 9' = 1; action 'c\\nseed: 9'; part def A { in x; out y; } "
        "part agents : A[3]; }"
    )
    imported = models.load([path], simulation="elsewhere")
    assert imported.experiment.seed == 1
    assert imported.experiment.parameters == {"a: b\\nseed: 9": 1, "agents": 3}
