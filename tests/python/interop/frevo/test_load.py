"""FREVO's sessions become experiments."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, frevo, optimize
from swarmwright.methods.cea2d import Cea2dOptions
from swarmwright.methods.nnga import NngaOptions

Edited = Callable[..., Path]
ENTRY = '<problementry key="steps" type="INT" value="50"/>'
METHOD = '<methodentry key="populationsize" type="INT" value="50"/>'
NODES = '<representationentry key="hiddenNodes" type="INT" value="2"/>'


def test_the_stadium_session(data: Path) -> None:
    experiment = frevo.load(data / "emergency_exit_stadium.zse").experiment
    assert experiment.simulation == "emergency_exit"
    assert experiment.seed == 12345
    parameters = dict(experiment.parameters)
    field = parameters.pop("field")
    assert parameters == {"steps": 50, "stepSize": 200}
    assert len(field["agents"]) == 72
    controller = experiment.controller.model_dump()
    assert controller["kind"] == "fully_meshed"
    assert [controller[key] for key in ("hidden", "activation", "iterations")] == [2, "clamp", 2]
    assert experiment.method.model_dump() == {
        "kind": "nnga",
        "population": 50,
        "islands": 1,
        "exchange_interval": 10,
        "exchange": 1.0,
        "generations": 300,
        "evaluations": None,
        "seconds": None,
        "elite": 0.15,
        "random": 0.1,
        "mutate": 0.4,
        "crossover": 0.3,
        "renew": 0.05,
        "severity": 0.3,
        "probability": 1.0,
        "partners": 11,
        "target": None,
        "operation": "generational",
        "in_flight": 16,
    }
    assert experiment.ranking.model_dump(exclude_defaults=True) == {}
    assert experiment.genome_size == 60


def test_the_random_session(data: Path) -> None:
    imported = frevo.load(data / "emergency_exit_random.zse")
    assert imported.experiment.parameters == {
        "steps": 50,
        "stepSize": 200,
        "width": 20,
        "height": 20,
        "numAgents": 10,
        "numExits": 5,
        "numBlockades": 20,
        "seed": 0,
    }
    assert imported.experiment.ranking.model_dump(exclude_defaults=True) == {
        "episodes": 10,
        "aggregate": "sum",
    }


@pytest.mark.parametrize(
    "name",
    ["emergency_exit_stadium.zse", "emergency_exit_random.zse", "emergency_exit_stadium.zre"],
)
def test_every_entry_is_mentioned(data: Path, name: str) -> None:
    text = (data / name).read_text(encoding="utf-8")
    keys = [part.split('"')[1] for part in text.split("entry ")[1:]]
    assert len(keys) >= 11
    yaml = frevo.load(data / name).yaml
    assert [key for key in keys if key not in yaml] == []
    assert all(len(line) < 130 for line in yaml.splitlines())


def test_entries_become_keys(edited: Edited) -> None:
    path = edited(
        "emergency_exit_random.zse",
        (ENTRY, '<problementry key="steps" value="7"/><problementry key="seedforEmergencyExits" value="3"/>'),
        (
            METHOD,
            METHOD.replace("50", "20") + '<methodentry key="percentage_mutate" value="0.20f"/>',
        ),
        (
            NODES,
            NODES.replace('"2"', '"4"')
            + '<representationentry key="activationFunction" value="SIGMOID"/>'
            + '<representationentry key="weight_range" value="1.5F"/>',
        ),
        ('value="12345"', 'value="77"'),
    )
    experiment = frevo.load(path).experiment
    assert (experiment.parameters["steps"], experiment.parameters["seed"], experiment.seed) == (7, 3, 77)
    method: Any = experiment.method
    # FREVO gives the elite what the other shares leave.
    assert (method.population, method.mutate, method.elite) == (20, 0.2, 0.35)
    controller: Any = experiment.controller
    assert (controller.hidden, controller.activation, controller.weight_range) == (4, "sigmoid", 1.5)


def test_too_many_agents_are_as_many_as_frevo_takes(edited: Edited) -> None:
    path = edited("emergency_exit_random.zse", (ENTRY, '<problementry key="NumberofAgents" value="100"/>'))
    imported = frevo.load(path)
    assert imported.experiment.parameters["numAgents"] == 20
    assert "NumberofAgents = 100, limited by FREVO to the larger of width and height" in imported.yaml


def test_what_differs_is_said(edited: Edited, data: Path) -> None:
    path = edited(
        "emergency_exit_stadium.zse",
        ('key="width" type="INT" value="20"', 'key="width" type="INT" value="30"'),
        (ENTRY, '<problementry key="wallColour" value="#fff"/>'),
        (
            METHOD,
            '<methodentry key="mutationMethod" value="2"/>',
        ),
        (NODES, '<representationentry key="variable_mutation_rate" value="true"/>'),
    )
    imported = frevo.load(path, field=data / "stadium.json")
    for start in (
        "problem.width, problem.height: FREVO puts a wall around 30 x 20",
        "problem.wallColour = #fff: unknown to FREVO 1.5",
        "method.mutationMethod = 2",
        "representation.variable_mutation_rate = true",
        "sessionconfig.NumberofRuns = 10",
    ):
        assert any(note.startswith(start) for note in imported.notes), start
    assert vars(imported.experiment.controller)["mutation"] == "proportional"


def test_several_populations_are_taken_over(edited: Edited) -> None:
    path = edited(
        "emergency_exit_random.zse",
        (METHOD, f'{METHOD}<methodentry key="populationnumber" value="3"/>'),
        (METHOD, f'{METHOD}<methodentry key="interXover_frequency" value="5"/>'),
    )
    imported = frevo.load(path)
    method = imported.experiment.method
    assert isinstance(method, NngaOptions)
    assert (method.islands, method.exchange_interval, method.exchange) == (3, 5, 1.0)
    assert not any("population" in note for note in imported.notes)


def cea2d(edited: Edited, *entries: tuple[str, object]) -> Path:
    """A session with CEA2D and these entries instead of NNGA's."""
    path = edited("emergency_exit_random.zse", ('class="nnga.NNGA"', 'class="CEA2D.CEA2D"'))
    kept = [line for line in path.read_text().splitlines() if "<methodentry" not in line]
    end = next(index for index, line in enumerate(kept) if "</method>" in line)
    kept[end:end] = [f'<methodentry key="{key}" type="INT" value="{value}"/>' for key, value in entries]
    path.write_text("\n".join(kept))
    return path


def test_cea2d_has_the_defaults_of_frevo(edited: Edited) -> None:
    imported = frevo.load(cea2d(edited))
    assert imported.experiment.method == Cea2dOptions()
    assert vars(imported.experiment.controller)["mutation"] == "uniform"
    assert re.search("  kind: cea2d +# CEA2D.CEA2D", imported.yaml)


def test_entries_of_cea2d_become_keys(edited: Edited) -> None:
    path = cea2d(
        edited,
        ("generations", 7),
        ("populationsize_width", 6),
        ("populationsize_height", 4),
        ("neighbourhoodmode", 2),
        ("random obstacles", 3),
        ("obstacle-pattern", 4),
        ("percentelite", 20),
        ("percentmutateelite", 50),
        ("percentxoverelite", 10),
        ("mutationseverity", "0.1f"),
        ("mutationprobability", 0.5),
        ("saveinterval", 10),
    )
    imported = frevo.load(path)
    assert imported.experiment.method == Cea2dOptions(
        generations=7, width=6, height=4, neighbourhood="random", obstacles=3, elite=0.2, mutate=0.5,
        crossover=0.1, renew=0.2, severity=0.1, probability=0.5,
    )  # fmt: skip
    assert "saveinterval = 10: the record" in imported.yaml


def test_shares_of_cea2d_above_a_hundred_are_cut_as_in_frevo(edited: Edited) -> None:
    imported = frevo.load(cea2d(edited, ("percentmutateelite", 80), ("percentxoverelite", 30)))
    shares = imported.experiment.method.model_dump()
    assert [shares[name] for name in ("elite", "mutate", "crossover", "renew")] == [0.11, 0.8, 0.09, 0.0]
    assert "percentxoverelite = 30, limited by FREVO to the remainder of 100" in imported.yaml


def test_fixed_obstacles_of_cea2d_are_refused_where_frevo_has_them(edited: Edited) -> None:
    with pytest.raises(InputError, match=r"method\.obstacle-pattern: 2 found; obstacles here are random"):
        frevo.load(cea2d(edited, ("obstacle-pattern", 2)))
    small = cea2d(edited, ("obstacle-pattern", 2), ("populationsize_width", 9), ("random obstacles", 5))
    assert frevo.load(small).experiment.method.model_dump()["obstacles"] == 0


def test_an_imported_experiment_evolves(edited: Edited, tmp_path: Path) -> None:
    path = edited(
        "emergency_exit_random.zse",
        ('key="generations" type="INT" value="300"', 'key="generations" value="4"'),
    )
    experiment = frevo.load(path).experiment.replace(servers="local")
    run = optimize(experiment, out=tmp_path / "run")
    assert run.best.fitness > -400


@pytest.mark.slow
def test_import_command_writes_an_experiment_that_loads(program: Any, data: Path, tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    target = tmp_path / "deep" / "stadium.yaml"
    shown = program("import", data / "emergency_exit_stadium.zse", "-o", target)
    assert shown.returncode == 0
    assert shown.stdout == f"The experiment is in {target}\n"
    assert "not as in FREVO: sessionconfig.NumberofRuns = 10" in shown.stderr
    assert Experiment.load(target).parameters["field"]["width"] == 20

    before = target.read_text()
    again = program("import", data / "emergency_exit_random.zse", "-o", target)
    assert again.returncode == 2
    assert "already exists; choose another file" in again.stderr
    assert target.read_text() == before
    printed = program("import", data / "emergency_exit_random.zse")
    assert printed.stdout.startswith("# Converted from the FREVO session emergency_exit_random.zse")


@pytest.mark.slow
def test_commands_take_sessions_as_import_makes_them(program: Any, data: Path, tmp_path: Path) -> None:
    session = data / "emergency_exit_stadium.zse"
    few = ("--set", "method.generations=3", "--servers", "local", "--seed", "7")
    run = program("optimize", session, *few, "--out", tmp_path / "session")
    assert run.returncode == 0
    assert "not as in FREVO: sessionconfig.NumberofRuns = 10" in run.stderr
    program("import", session, "-o", tmp_path / "stadium.yaml")
    program("optimize", tmp_path / "stadium.yaml", *few, "--out", tmp_path / "imported")
    same = program("runs", "diff", tmp_path / "session", tmp_path / "imported")
    assert (same.returncode, same.stderr) == (0, "")
    assert program("simulate", session, "--seed", "7").returncode == 0


@pytest.mark.slow
def test_a_session_that_is_taken_for_an_experiment(edited: Edited, program: Any, tmp_path: Path) -> None:
    other = edited("emergency_exit_random.zse", ('class="emergencyexit.EmergencyExit"', 'class="XOR.XOR"'))
    refused = program("optimize", other)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "use emergencyexit.EmergencyExit" in refused.stderr
    assert "'swarmwright import' has options for the field and for unsupported components" in refused.stderr
    shutil.copy(other, tmp_path / "session.yaml")
    again = program("optimize", tmp_path / "session.yaml")
    assert again.stderr == refused.stderr.replace(other.name, "session.yaml")
    (tmp_path / "model.xml").write_text("<icomponent/>")
    assert "with 'swarmwright import'" in program("optimize", "model.xml").stderr
    with pytest.raises(InputError, match="convert a FREVO session"):
        Experiment.load(tmp_path / "session.yaml")


def test_the_field_is_found_beside_the_session(edited: Edited, data: Path, tmp_path: Path) -> None:
    path = edited("emergency_exit_stadium.zse")
    with pytest.raises(InputError) as caught:
        frevo.load(path)
    for part in (
        ":14: problem.Filename: the field",
        "Stadium.ser or Stadium.json",
        "--field FILE",
        '"blockades"',
    ):
        assert part in str(caught.value)
    # On a disk that tells capitals apart the name may still be written in another way.
    shutil.copy(data / "stadium.json", tmp_path / "STADIUM.json")
    imported = frevo.load(path, folder=tmp_path)
    assert 'field: "STADIUM.json"  # Filename' in imported.yaml
    assert len(imported.experiment.parameters["field"]["exits"]) == 4


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        (
            ('class="nnga.NNGA"', 'class="PSO.PSO"'),
            "the class 'PSO.PSO' has no counterpart in Swarmwright; did you mean 'pso.PSO'?",
        ),
        (
            ('class="emergencyexit.EmergencyExit"', 'class="XOR.XOR"'),
            "use emergencyexit.EmergencyExit",
        ),
        (('class="nnga.NNGA"', ""), ":16: <method>: the attribute class is missing"),
        (('key="steps"', 'kee="steps"'), ":11: <problementry>: the attribute key is missing"),
        (('key="steps" type="INT" value="50"', 'key="steps" type="INT"'), "the attribute value is missing"),
        (
            ('key="steps" type="INT" value="50"', 'key="steps" value="many"'),
            ":11: problem.steps: 'many' found",
        ),
        (
            ('key="steps" type="INT" value="50"', 'key="steps" value="0"'),
            "problem.steps: 0 found, expected a whole",
        ),
        (
            ('key="height"', 'key="width"'),
            ":13: <problementry>: duplicate key width (first in line 12)",
        ),
        (("RANDOM_FIELD", "RANDOMFIELD"), "did you mean 'RANDOM_FIELD'"),
        (
            ('value="12345"', 'value="-5"'),
            "sessionconfig.StartingSeed: -5 found, expected a whole number of at least 0",
        ),
        (
            (NODES, '<representationentry key="activationFunction" value="TANH"/>'),
            "representation.activationFunction: 'TANH' found, expected one of LINEAR, SIGMOID, RELU",
        ),
        ((NODES, '<representationentry key="random_source" value="true"/>'), "random numbers"),
        (
            (METHOD, '<methodentry key="percentage_elite" value="15%"/>'),
            "'15%' found, expected a number such as 0.15f",
        ),
        ((METHOD, '<methodentry key="xoverMethod" value="2"/>'), "method.xoverMethod: 2 found"),
        (
            (METHOD, '<methodentry key="percentage_mutate" value="0.9f"/>'),
            "does not result in a valid experiment",
        ),
        ((METHOD, "<representationentry/>"), "found inside <method>; expected <methodentry>"),
        (("<ranking", "<rankings><ranking"), "not valid XML"),
    ],
)
def test_a_malformed_session_is_refused(edited: Edited, change: tuple[str, str], answer: str) -> None:
    path = edited("emergency_exit_random.zse", change)
    with pytest.raises(InputError) as caught:
        frevo.load(path)
    assert answer in str(caught.value)
    assert str(caught.value).startswith(f"{path}:")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["import", "score"])
def test_mistakes_on_the_command_line(program: Any, data: Path, tmp_path: Path, command: str) -> None:
    (tmp_path / "page.html").write_text("<html><body/></html>")
    (tmp_path / "list.json").write_text("[1, 2]")
    name = "emergency_exit_stadium." + ("zse" if command == "import" else "zre")
    shutil.copy(data / name, tmp_path)
    for arguments, answer in [
        (["emergency_exit_stadium.z"], "does not exist; did you mean 'emergency_exit_stadium"),
        (["page.html"], "page.html:1: <html>: unknown root element; expected"),
        ([name, "--field", "list.json"], "list.json: holds a list; expected an object"),
        ([name, "--field", "page.html"], "page.html:1: is not valid JSON"),
        ([name], "problem.Filename: the field"),
    ]:
        shown = program(command, *arguments)
        assert shown.returncode == 2, arguments
        assert answer in shown.stderr
        assert shown.stdout == ""


MEALY = """<representation class="fsm.MealyFSM">
    <representationentry key="num_of_states" type="INT" value="3"/>
    <representationentry key="state_num_change_allowed" type="BOOLEAN" value="true"/>
    <representationentry key="min_input_values" type="INTARRAY" value="-20,-20,0,0,0,0,0,0,0,0"/>
    <representationentry key="max_input_values" type="INTARRAY" value="20,20,1,1,1,1,1,1,1,1"/>
    <representationentry key="unit_input_values" type="INTARRAY" value="40,40,1,1,1,1,1,1,1,1"/>
    <representationentry key="threshold_units" type="INTARRAY" value="40,40,1,1,1,1,1,1,1,1"/>
    <representationentry key="nthresholds_for_inputs" type="INTARRAY" value="1,3,0,0,1,1,1,1,1,1"/>
    <representationentry key="output_units" type="INT" value="2"/>
    <representationentry key="mutate_del_tr_prob" type="FLOAT" value="0.01f"/>
  </representation>"""
NETWORK = """<representation class="fullyMeshedNet.FullyMeshedNet">
    <representationentry key="hiddenNodes" type="INT" value="2"/>
  </representation>"""


def test_a_mealy_machine(edited: Edited, tmp_path: Path) -> None:
    imported = frevo.load(edited("emergency_exit_random.zse", (NETWORK, MEALY)))
    experiment = imported.experiment
    assert experiment.controller.model_dump() == {
        "kind": "mealy_fsm",
        "states": 3,
        # FREVO counts a whole number that equals a threshold as above it.
        "levels": [[-0.5], [-10.5, -0.5, 9.5], *[[0.5]] * 8],
        "output_levels": 3,
    }
    assert experiment.genome_size == 3 * 2 * 4 * 2**8 * 3
    assert len(imported.notes) == 4
    assert "state_num_change_allowed = true: the number of states is fixed" in imported.notes[3]
    assert "# not imported: mutate_del_tr_prob = 0.01f:" in imported.yaml
    short = experiment.replace(method={"population": 10, "generations": 1}, servers="local")
    assert optimize(short, out=tmp_path / "run").evaluations == 10


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"1,3,0,0,1,1,1,1,1,1"', '"1,3"', "nthresholds_for_inputs: '1,3' found, expected 10 whole numbers"),
        ('"1,3,0,0,1,1,1,1,1,1"', '"1,3,0,0,1,1,1,1,1,-1"', "nthresholds_for_inputs: .* one for each input"),
        (
            '"20,20,1,',
            '"20,-20,1,',
            "max_input_values: -20 found for input 1, expected more than the minimum",
        ),
        ('value="3"', 'value="0"', "num_of_states: 0 found, expected a whole number of at least 1"),
        ('"20,20,1,', '"x,20,1,', "max_input_values: 'x,20,.* found"),
    ],
)
def test_a_mealy_machine_that_cannot_be_taken_over(edited: Edited, old: str, new: str, words: str) -> None:
    path = edited("emergency_exit_random.zse", (NETWORK, MEALY.replace(old, new)))
    with pytest.raises(InputError, match=rf"\.zse:\d+: representation\.{words}"):
        frevo.load(path)


def test_machines_are_not_scored(edited: Edited) -> None:
    classes = ('class="fullyMeshedNet.FullyMeshedNet"', 'class="fsm.MealyFSM"')
    path = edited("emergency_exit_random.zre", classes)
    with pytest.raises(InputError, match=r"machines of fsm\.MealyFSM cannot be scored again"):
        frevo.score(path)
