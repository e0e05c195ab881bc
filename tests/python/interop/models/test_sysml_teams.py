"""Models in SysML v2 with several kinds of agents."""

from pathlib import Path

import pytest

from swarmwright import InputError, optimize
from swarmwright.interop import models
from tests.python.interop.models.test_behaviour import WALK
from tests.python.simulations import pursuit

TEAM = """package Rescue {
    part def Scout { port eyes { in item light : Real[4]; in item floor; } out item heading; }
    part def Carrier { in item load; out item left; out item right; }
    part mission {
        attribute size = 10;
        part scouts : Scout[3];
        part carriers : Carrier[2];
    }
}
"""
MINISIM = """package Minisim {
    part def Agent { in item goal_x; in item goal_y; in item defender_x; in item defender_y; out heading; }
    part def Guard { in item agent_x; in item agent_y; in item goal_x; in item goal_y; out heading; }
    part mission {
        attribute defenderSteering = "controller";
        part agents : Agent[3];
        part defenders : Guard[2];
    }
}
"""
WITHOUT_CONTROLLER = (' attribute defenderSteering = "controller";', "")
PURSUIT = """package Pursuit {
    part mission {
        part hunters[4] { in prey; out way; }
        part prey { in item hunters : Real[3]; out left; out right; }
    }
}
"""
PURSUIT_CLASS = f"{pursuit.__file__}:Pursuit"


def saved(folder: Path, text: str, *changes: tuple[str, str]) -> Path:
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "team.sysml"
    path.write_text(text)
    return path


def test_several_kinds_of_agents_are_the_groups_of_a_team(tmp_path: Path) -> None:
    experiment = models.load([saved(tmp_path, TEAM)]).experiment
    assert experiment.parameters == {"size": 10, "scouts": 3, "carriers": 2}
    groups = experiment.controller.model_dump()["groups"]
    assert {
        name: (one["kind"], one["agents"], one["sensors"], one["actuators"]) for name, one in groups.items()
    } == {"scouts": ("layered", 3, 5, 1), "carriers": ("layered", 2, 1, 2)}
    assert experiment.requirements.max_agents == 5
    other = models.load([tmp_path / "team.sysml"], controller="fully_meshed").experiment
    assert {one["kind"] for one in other.controller.model_dump()["groups"].values()} == {"fully_meshed"}


def test_kinds_that_sense_and_do_the_same_have_one_controller(tmp_path: Path) -> None:
    path = saved(tmp_path, TEAM, ("carriers : Carrier", "others : Scout"))
    experiment = models.load([path]).experiment
    assert (experiment.controller.kind, experiment.sensors, experiment.actuators) == ("layered", 5, 1)


def test_groups_that_the_simulation_declares(tmp_path: Path) -> None:
    experiment = models.load([saved(tmp_path, MINISIM)]).experiment
    assert experiment.parameters == {"defenderSteering": "controller", "numAgents": 3, "numDefenders": 2}
    small = experiment.replace(servers="in-process", method={"population": 4, "generations": 1})
    run = optimize(small, out=tmp_path / "run")
    assert list(run.best.controller.groups) == ["agents", "defenders"]
    of_class = models.load([saved(tmp_path, PURSUIT)], simulation=PURSUIT_CLASS).experiment
    assert of_class.parameters == {"hunters": 4}
    assert list(of_class.controller.model_dump()["groups"]) == ["hunters", "prey"]


def test_numbers_of_several_kinds_of_agents_are_evolved_and_written_back(tmp_path: Path) -> None:
    evolved = "Guard[2] { @Optimize { min = 1; max = 6; } }"
    path = saved(tmp_path, MINISIM, WITHOUT_CONTROLLER, ("Guard[2];", evolved))
    experiment = models.load([path]).experiment
    assert experiment.controller.kind == "parameter_set"
    assert experiment.parameters == {"numAgents": 3, "steering": "rule"}
    small = experiment.replace(servers="in-process", method={"population": 4, "generations": 1})
    run = optimize(small, out=tmp_path / "run")
    models.write_back(run, [path], output=tmp_path / "back")
    number = run.best.controller.parameters["numDefenders"]
    expected = path.read_text().replace("Guard[2] {", f"Guard[{number}] {{")
    assert (tmp_path / "back" / "team.sysml").read_text() == expected


@pytest.mark.parametrize(
    ("text", "change", "answer"),
    [
        (
            TEAM,
            ("out item heading", "in item heading"),
            r":6: part scouts: has no actuators \(out\); add at least one",
        ),
        (
            TEAM,
            ("carriers : C", "scouts : C"),
            r":7: part scouts: other agents have the same name \(line 6\); rename one",
        ),
        (TEAM, ("part carriers : C", "part : C"), ":7: part: has no name; name each group"),
        (
            TEAM,
            ("out item left", "part arm { out grip; } out item left"),
            r":3: part arm: has sensors or actuators, and so has the enclosing part Carrier \(line 3\)",
        ),
        (
            MINISIM,
            WITHOUT_CONTROLLER,
            "minisim has one kind with these parameters; set the parameter defenderSteering: controller",
        ),
        (
            MINISIM,
            ("part defenders", "part guards"),
            ":7: part guards: minisim has no such group of agents; its groups: agents, defenders",
        ),
        (MINISIM, ("part defenders", "part defendr"), "did you mean 'defenders'"),
        (
            MINISIM,
            ("in item agent_x; ", ""),
            ":7: part defenders: has 3 sensors, but defenders of minisim have 4",
        ),
    ],
)
def test_what_is_wrong_with_several_kinds_is_named(
    tmp_path: Path, text: str, change: tuple[str, str], answer: str
) -> None:
    with pytest.raises(InputError, match=answer):
        models.load([saved(tmp_path, text, change)])


def test_other_groups_than_those_of_a_class(tmp_path: Path) -> None:
    third = "part hawks { in item all : Real[2]; out way; }"
    for change, answer in (
        (("part prey {", "part prey[2] {"), ":4: part prey: has 2 agents, but prey of .* have 1"),
        (
            ("part prey {", f"{third} part prey {{"),
            ":4: part hawks: .*Pursuit has no such group of agents; its",
        ),
        (
            (
                "part prey { in item hunters : Real[3]; out left; out right; }",
                third.replace("hawks", "hunter"),
            ),
            "part hunter: .* has no such group of agents; did you mean 'hunters'",
        ),
    ):
        with pytest.raises(InputError, match=answer):
            models.load([saved(tmp_path, PURSUIT, change)], simulation=PURSUIT_CLASS)


def test_a_behaviour_is_that_of_one_kind(tmp_path: Path) -> None:
    (tmp_path / "walk.scxml").write_text(WALK)
    paths = [saved(tmp_path, TEAM), tmp_path / "walk.scxml"]
    with pytest.raises(InputError, match=r"walk\.scxml: a behaviour applies to one kind of agents, but"):
        models.load(paths, target=tmp_path / "x.yaml")
    imported = models.load(paths, target=tmp_path / "x.yaml", controller="layered")
    assert imported.experiment.controller.kind == "team"
