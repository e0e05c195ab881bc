"""Models in SysML v2's textual notation."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import InputError, Run, optimize
from swarmwright.interop import models
from tests.python.interop.models.test_behaviour import WALK

MODEL = """/* A swarm
   for Minisim. */
package Escape {
    private import ScalarValues::*;
    metadata def Optimize { attribute min : Real; attribute max : Real; }
    port def Sensing {
        in item goal_x : Real;
        in item goal_y : Real;
        in item defender_x : Real;
        in item defender_y : Real;
    }
    part def Agent {
        doc /* Gets past the defenders. */
        port sensing : Sensing;
        port driving { out item heading : Real; }
        attribute speedAgents : Real = 1.5 [m];
    }
    part mission {
        attribute simulation : String = "minisim";
        attribute placement = "random";
        attribute numDefenders : Integer = 2; // guards
        attribute avoidance : Real { @Optimize { min = 0; max = 5; } }
        attribute maxSteps : Integer = 15 { @Optimize { min = 15; max = 30; scale = "1"; } }
        part agents : Agent[3];
    }
    state def Behaviour { state idle; }
}
"""


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    text = MODEL
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "escape.sysml"
    path.write_text(text)
    return path


def test_a_model_becomes_an_experiment(tmp_path: Path) -> None:
    imported = models.load([written(tmp_path)])
    experiment = imported.experiment
    assert experiment.simulation == "minisim"
    assert experiment.parameters == {
        "speedAgents": 1.5,
        "placement": "random",
        "numDefenders": 2,
        "numAgents": 3,
        "steering": "rule",
    }
    options = experiment.controller.model_dump()["parameters"]
    assert {name: (one["type"], one["range"]) for name, one in options.items()} == {
        "avoidance": ("real", [0.0, 5.0]),
        "maxSteps": ("integer", [15, 30]),
    }
    assert any("state def Behaviour in line 26" in note for note in imported.notes)


def test_values_are_written_into_the_same_text(tmp_path: Path) -> None:
    path = written(tmp_path, ("Agent[3];", "Agent[3] { @Optimize { min = 1; max = 6; } }"))
    experiment = models.load([path]).experiment
    small = experiment.replace(servers="local", method={"population": 8, "generations": 2})
    run = Run.open(optimize(small, out=tmp_path / "run").path)
    values = run.best.controller.parameters
    models.write_back(run, [path], output=tmp_path / "back")
    expected = path.read_text()
    expected = expected.replace("avoidance : Real {", f"avoidance : Real = {values['avoidance']} {{")
    expected = expected.replace("Integer = 15 {", f"Integer = {values['maxSteps']} {{")
    expected = expected.replace("Agent[3]", f"Agent[{values['numAgents']}]")
    assert (tmp_path / "back" / "escape.sysml").read_text() == expected
    assert models.load([tmp_path / "back" / "escape.sysml"]).experiment.controller == experiment.controller


def test_a_behaviour_beside_it(tmp_path: Path) -> None:
    (tmp_path / "walk.scxml").write_text(WALK)
    paths = [written(tmp_path, ('"minisim"', '"elsewhere"')), tmp_path / "walk.scxml"]
    experiment = models.load(paths, target=tmp_path / "x.yaml", controller="mealy_fsm").experiment
    assert (experiment.simulation, experiment.sensors, experiment.actuators) == ("elsewhere", 4, 1)
    assert experiment.start_from is not None


@pytest.mark.parametrize(
    ("changes", "sensors", "actuators"),
    [
        ([("port sensing : Sensing;", "port sensing : ~Sensing;")], 0, 5),
        ([("in item goal_x : Real;", "in item goal_x : Real[8];")], 11, 1),
        ([("port sensing : Sensing;", "in attribute x : Real; in y;")], 2, 1),
        ([("part agents : Agent[3]", "part agents[3] : Agent")], 4, 1),
        (
            [("Agent[3];", "Scout[3];"), ("part mission", "part def Scout :> Agent { out z; } part mission")],
            4,
            2,
        ),
    ],
)
def test_ports_and_directions(
    tmp_path: Path, changes: list[tuple[str, str]], sensors: int, actuators: int
) -> None:
    path = written(tmp_path, *changes, ('"minisim"', '"elsewhere"'))
    experiment = models.load([path]).experiment
    assert (experiment.sensors or 0, experiment.actuators or 0) == (sensors, actuators)


@pytest.mark.parametrize(
    ("base", "reference", "sensors"),
    [
        ("library package Base { part def Robot { in x; } }", "Base::Robot", 5),
        ("standard library package Base { part def Robot { in x; } }", "Robot", 5),
        ("package A { part def R { in x; } } package B { part def R { in x; in y; } }", "A::R", 5),
        ("package A { part def R { in x; } } package B { part def R { in x; in y; } }", "B::R", 6),
        (
            "package A { part def R { in x; } } package B { part def R { in x; in y; } } import B::*;",
            "R",
            6,
        ),
        (
            "package A { part def R { in x; } } package B { part def R { in x; in y; } } import A::R;",
            "R",
            5,
        ),
        ("package A { package B { part def R { in x; } } part def R; } import A::B::**;", "R", 5),
        ("package A { part def <'R-1'> R { in x; } }", "'R-1'", 5),
        ("package A { part def R { in x; } } alias S for A::R;", "S", 5),
        ("part def D { in x; } part def B1 :> D; part def B2 :> D;", "B1, B2", 5),
        ("part def R :> Q { in x; } part def Q :> R { in y; }", "R", 6),
        ("", "Parts::Part", 4),
    ],
)
def test_types_in_packages(tmp_path: Path, base: str, reference: str, sensors: int) -> None:
    path = written(
        tmp_path,
        ("port def Sensing", f"{base} port def Sensing"),
        ("part def Agent {", f"part def Agent :> {reference} {{"),
        ('"minisim"', '"elsewhere"'),
    )
    assert models.load([path]).experiment.sensors == sensors


def test_a_name_that_may_be_several_types(tmp_path: Path) -> None:
    two = "package A { part def R { in x; } } package B { part def R; } port def Sensing"
    path = written(tmp_path, ("port def Sensing", two), ("part def Agent {", "part def Agent :> R { "))
    with pytest.raises(
        InputError, match=r"R is ambiguous: Escape::A::R \(line 6\), Escape::B::R \(line 6\); write the"
    ):
        models.load([path])


@pytest.mark.parametrize(
    ("own", "sensors"),
    [
        ("port :>> sensing : Better;", 5),  # Better has those of Sensing, too
        ("port :>> sensing { in y; }", 5),
        ("port :>> sensing { in item :>> goal_x : Real[3]; }", 6),
        ("port other : Sensing;", 8),
        ("port others : Sensing[2];", 12),
    ],
)
def test_redefined_and_repeated_ports(tmp_path: Path, own: str, sensors: int) -> None:
    path = written(
        tmp_path,
        ("part mission", f"part def Scout :> Agent {{ {own} }} part mission"),
        ("port def Sensing", "port def Better :> Sensing { in y; } port def Sensing"),
        ("Agent[3];", "Scout[3];"),
        ('"minisim"', '"elsewhere"'),
    )
    assert models.load([path]).experiment.sensors == sensors


def test_usages_that_subset_others(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        ("Agent[3];", "Agent[3]; part scouts[2] :> mission.agents;"),
        ('"minisim"', '"elsewhere"'),
    )
    assert models.load([path]).experiment.sensors == 4


def test_metadata_about_something_else(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        (
            "Real { @Optimize { min = 0; max = 5; } }",
            "Real;\n @Optimize about avoidance { :>> min = 1; max = 2; }",
        ),
    )
    options = models.load([path]).experiment.controller.model_dump()["parameters"]
    assert options["avoidance"]["range"] == [1.0, 2.0]


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        (
            (" part agents : Agent[3];", ""),
            "escape.sysml: has no agents; add a part with a multiplicity",
        ),
        (
            ("Agent[3]", "Agent[1..3]"),
            r"sysml:24: part agents: its multiplicity \[1\.\.3\] is a range; write one number, such as \[3\]",
        ),
        (("Agent[3]", "Agent[*]"), r"sysml:24: part agents: its multiplicity \[\*\] is a range"),
        (("Agent[3]", "Agent[0]"), "its multiplicity is 0, expected a number from 1 to 1000000"),
        (("Agent[3]", "Agent[n]"), "its multiplicity is n, expected a number from 1 to 1000000"),
        (
            ("goal_x : Real", "goal_x : Real[1..3]"),
            r"item goal_x: its multiplicity \[1\.\.3\] is a range.*\[3\]$",
        ),
        (("Agent[3]", "Agnt[3]"), "24: part agents: Agnt is not defined in this file; did you mean 'Agent'"),
        (
            (": Sensing;", ": Sense;"),
            "14: port sensing: Sense is not defined in this file; did you mean 'Sensing'",
        ),
        (
            ("part def Agent", "part def Agent :> Far::Robot"),
            "Far::Robot is not defined in this file; add its",
        ),
        (
            ("part agents", "part def Other { out z; } part others : Other[2]; part agents"),
            "24: part others: its sensors or actuators differ from those of other agents, but minisim has",
        ),
        (("min = 0; ", ""), "sysml:22: attribute avoidance: @Optimize: min is missing or not a number"),
        (("max = 5", "max = -5"), "sysml:22: .* max is -5, expected a number above min, 0"),
        (('"1"', '"one"'), "scale: expected a number above 0"),
        (("max = 5", "maximum = 5"), "unknown key 'maximum'; expected min, max, scale"),
        (
            ("attribute avoidance", "#Optimize attribute avoid : Real; attribute avoidance"),
            "avoid: @Optimize: min",
        ),
        (
            ("= 2;", "= 2 + 3;"),
            r"numDefenders: its value must be a finite number .*, a string, true or false$",
        ),
        (('= "random";', '= "random"; attribute placement = "fixed";'), "is fixed, but random in line 20"),
        (("in item goal_x", "inout item goal_x"), "inout is not supported"),
        (('= "random";', '= "random"'), "';' is missing|its value must"),
        (("state idle; }", "state idle; "), r"sysml:3:16: is not valid SysML: '{' is not closed"),
        (
            ("state idle; }", "state idle; } } }"),
            r"sysml:26:43: is not valid SysML: '}' has no opening bracket",
        ),
        (("// guards", "`"), r"sysml:21:47: is not valid SysML: '`' is unexpected"),
        (("part def Agent", "part def Agent; part def Agent"), r"duplicate definition \(first in line 12\)"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: tuple[str, str], answer: str) -> None:
    path = written(tmp_path, change)
    with pytest.raises(InputError, match=answer):
        models.load([path])


def test_an_open_comment(tmp_path: Path) -> None:
    path = tmp_path / "x.sysml"
    path.write_text("package A {\n /* part")
    with pytest.raises(InputError, match=r"x\.sysml:2:2: is not valid SysML: a comment is not closed"):
        models.load([path])
    path.write_text("package A { " * 60 + "}" * 60)
    with pytest.raises(InputError, match="nesting is deeper than 50 levels"):
        models.load([path])


@pytest.mark.slow
def test_the_command_line(program: Any, tmp_path: Path) -> None:
    written(tmp_path)
    done = program("import", "escape.sysml", "-o", "escape.yaml")
    assert done.returncode == 0, done.stderr
    assert "not imported, including their content: state def Behaviour in line 26" in done.stderr


def test_values_that_the_simulation_refuses_are_not_blamed_on_a_file_that_is_not_there(
    tmp_path: Path,
) -> None:
    path = tmp_path / "swarm.sysml"
    path.write_text(MODEL.replace('placement = "random"', 'placement = "randm"'))
    with pytest.raises(InputError) as caught:
        models.load([path])
    first, *problems = str(caught.value).splitlines()
    assert first == f"{path}: does not result in a valid experiment:"
    assert problems
    assert all(line.startswith("parameters.placement: ") for line in problems)
