"""Missions of the arena: experiments to start from, and mistakes with their place."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from swarmwright import Experiment, InputError, optimize, post_evaluate, templates
from swarmwright.cli._commands import program
from swarmwright.common.yaml import parse
from swarmwright.experiment.validation import check

MISSION = """\
walls: {rectangle: [3, 2]}
floor:
  patches:
    - {name: west, circle: {center: [-1.2, 0.6], radius: 0.25}, color: black}
start:
  rectangle: {x: [-0.3, 0.3], y: [-0.6, 0.6]}
robots: 12
metrics:
  in_west: {kind: robots_on, patch: west, when: end}
fitness: in_west
"""


@pytest.mark.parametrize("name", templates.missions())
def test_every_mission_has_an_experiment(name: str) -> None:
    text = templates.arena(name)
    experiment = Experiment(**check(parse(text, name)))
    assert experiment.simulation == "arena"
    # The mission describes robots of its own where e-pucks cannot do it.
    sensors = {
        "object_retrieval": 20,
        "capture_the_flag": 21,
        "pursuit": 14,
        "soccer": 18,
        "territory": 14,
    }.get(name, 24)
    assert experiment.sensors == sensors
    lines = [line for line in text.splitlines() if line.strip()]
    assert sum("#" in line for line in lines) > len(lines) / 2
    # The mission itself can be the start of one's own.
    values = {"simulation": "arena", "parameters": {"mission": parse(templates.mission(name), name).values}}
    assert Experiment.from_mapping(values).sensors == sensors


def test_short_names_are_known_too() -> None:
    assert templates.arena("aac") == templates.arena("aggregation") == templates.text("arena")
    assert "mission: sca " in templates.arena("sca")


def test_new_prints_missions() -> None:
    printed = CliRunner().invoke(program, ["new", "arena", "--mission", "flocking"])
    assert printed.output == templates.arena("flocking")
    assert "# Arena: flocking, by a swarm of e-pucks" in printed.output
    printed = CliRunner().invoke(program, ["new", "arena", "--mission", "object_retrieval"])
    assert "# Arena: object retrieval, by a swarm of robots that the mission describes." in printed.output
    assert "24 inputs" not in printed.output
    printed = CliRunner().invoke(program, ["new", "arena", "--mission", "dispersion", "--mission-file"])
    assert printed.output == templates.mission("dispersion")
    help_text = " ".join(CliRunner().invoke(program, ["new", "--help"]).output.split())
    assert all(name in help_text for name in templates.missions())


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (["arena", "--mission", "agregation"], "unknown mission 'agregation'; did you mean 'aggregation'?"),
        (["arena", "--mission", "nothing"], "available: aac, aggregation, area_coverage, "),
        (["arena", "--mission", "my.yaml"], "name it in the experiment: parameters: {mission: my.yaml}"),
        (["minisim", "--mission", "aac"], "--mission is for arena only, not for minisim"),
        (["minisim", "--mission-file"], "--mission-file is for arena only, not for minisim"),
    ],
)
def test_mistakes_of_new(arguments: list[str], answer: str) -> None:
    printed = CliRunner().invoke(program, ["new", *arguments])
    assert printed.exit_code == 2
    assert answer in printed.output


@pytest.mark.parametrize(
    ("old", "new_text", "answer"),
    [
        ("[3, 2]", "[3, 2", ":1: is not valid YAML"),
        ("[3, 2]", "[3, 0]", ":1: walls.rectangle[1]: 0 found, expected a number above 0"),
        (
            "rectangle: [3, 2]",
            "corners: [[-1, -1], [1, 1], [1, -1], [-1, 1]]",
            ":1: walls.corners: the sides",
        ),
        ("walls:", "wals:", ":1: wals: unknown field `wals`"),
        ("center: [-1.2, 0.6]", "center: [-4, 0.6]", ':4: floor.patches[0]: the patch "west" lies outside'),
        ("radius: 0.25", "radius: 0.25, radius: 1", ":4: floor.patches[0].circle.radius: duplicate key"),
        (
            "color: black",
            "color: blue",
            ':4: floor.patches[0].color: "blue" (a string) found, expected black',
        ),
        (
            "start:",
            "lights: [{at: [0, 0, 1], power: 2}]\nstart:",
            ":5: lights[0].power: unknown field `power`",
        ),
        ("x: [-0.3, 0.3]", "x: [0.3, -0.3]", ":6: start.rectangle.x: [0.3, -0.3] found, expected the lower"),
        ("x: [-0.3, 0.3]", "x: [-.inf, 0.3]", ":6: start.rectangle.x[0]: must be a finite number"),
        ("robots: 12", "robots: 0", ":7: robots: 0 found, expected 1 to 100000"),
        (
            "robots_on",
            "robot_on",
            ':9: metrics.in_west.kind: "robot_on" found, expected one of "robots_on"',
        ),
        (
            "patch: west",
            "patch: wst",
            ':9: metrics.in_west.patch: no patch of the floor is named "wst"; available: west',
        ),
        (
            "fitness: in_west",
            "fitness: in_wst",
            ':10: fitness: no metric is named "in_wst"; available: in_west',
        ),
        (
            "start:",
            "objects: [{name: load, radius: 0.2, mass: 2}]\nstart:",
            ":5: objects[0]: expected center, its position, or start, a region for random positions",
        ),
        (
            "start:",
            "objects:\n  - {name: load, size: [0.4, 0.2], mass: 2, center: [1.4, 0]}\nstart:",
            ":6: objects[0]: must be inside the walls and outside obstacles",
        ),
        (
            "start:",
            "objects:\n  - {name: load, radius: 0.2, wieght: 2, center: [1, 0]}\nstart:",
            ":6: objects[0].wieght: unknown field `wieght`",
        ),
        ("fitness: in_west", "fitness: {ofset: 1}", ":10: fitness: expected the name of a metric, or"),
    ],
)
def test_a_mistake_in_a_file_is_told_with_file_and_line(
    tmp_path: Path, old: str, new_text: str, answer: str
) -> None:
    assert old in MISSION
    (tmp_path / "mission.yaml").write_text(MISSION.replace(old, new_text))
    (tmp_path / "swarm.yaml").write_text("simulation: arena\nparameters: {mission: mission.yaml}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(tmp_path / "swarm.yaml")
    assert f"{tmp_path}/swarm.yaml:2: parameters.mission: {tmp_path}/mission.yaml{answer}" in str(
        caught.value
    )


def test_all_mistakes_of_a_mission_and_its_robots_are_told_at_once(tmp_path: Path) -> None:
    """The robot charges on a patch of this mission: nothing is said of the patches of the default one."""
    mission = MISSION.replace("color: black", "color: blue").replace("robots: 12", "robots: 0")
    (tmp_path / "mission.yaml").write_text(mission)
    battery = "battery: {standing: 600, driving: 300, charging: {patch: west, duration: 20}}\n"
    (tmp_path / "robot.yaml").write_text(ROBOT.replace("count: 8", "count: 0") + battery)
    swarm = tmp_path / "swarm.yaml"
    swarm.write_text("simulation: arena\nparameters: {mission: mission.yaml, robot: robot.yaml}\nseeed: 1\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(swarm)
    lines = str(caught.value).splitlines()
    found = sorted(line.removeprefix(f"{swarm}:") for line in lines)
    assert len(found) == 4
    assert found[0].startswith(f"2: parameters.mission: {tmp_path}/mission.yaml:4: floor.patches[0].color: ")
    assert found[1].startswith(f"2: parameters.mission: {tmp_path}/mission.yaml:7: robots: 0 found")
    assert found[2].startswith(f"2: parameters.robot: {tmp_path}/robot.yaml:4: sensors[0].count: 0 found")
    assert found[3].startswith("3: seeed: ")


def test_a_mistake_in_the_experiment_is_told_with_its_line(tmp_path: Path) -> None:
    lines = MISSION.replace("radius: 0.25", "radius: -1").splitlines()
    indented = "".join(f"    {line}\n" for line in lines)
    (tmp_path / "swarm.yaml").write_text(f"simulation: arena\nparameters:\n  mission:\n{indented}")
    with pytest.raises(InputError) as caught:
        Experiment.load(tmp_path / "swarm.yaml")
    assert f"{tmp_path}/swarm.yaml:7: parameters.mission.floor.patches[0].circle.radius: -1 found" in str(
        caught.value
    )


def test_robots_of_a_mission_that_do_not_fit_are_told_with_their_line(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(MISSION.replace("robots: 12", "robots: 5000"))
    (tmp_path / "swarm.yaml").write_text("simulation: arena\nparameters:\n  mission: mine.yaml\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(tmp_path / "swarm.yaml")
    expected = f"{tmp_path}/mine.yaml:7: robots: 5000 robots do not fit into their start region"
    assert expected in str(caught.value)


def test_a_robot_that_a_mission_misses_is_told_with_the_line_of_the_mission(tmp_path: Path) -> None:
    mission = "name: mine\nrobots:\n  - {robot: e-puck-rm1.1, count: 2}\n  - {robot: nope.yaml, count: 2}\n"
    (tmp_path / "mine.yaml").write_text(mission)
    swarm = tmp_path / "swarm.yaml"
    swarm.write_text("simulation: arena\nparameters:\n  mission: mine.yaml\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(swarm)
    where = f"{tmp_path}/mine.yaml:4: robots[1].robot: {tmp_path}/nope.yaml: there is no such file"
    assert str(caught.value) == f"{swarm}:3: parameters.mission: {where}"
    swarm.write_text('simulation: arena\nparameters:\n  mission: "a\\0b.yaml"\n')
    with pytest.raises(InputError, match="a path must not contain NUL"):
        Experiment.load(swarm)


@pytest.mark.parametrize(
    ("parameters", "answer"),
    [
        ({"mission": "agregation"}, 'parameters.mission: "agregation" found, expected the name of a mission'),
        ({"robots": 5000}, "parameters.robots: 5000 robots do not fit into their start region"),
        ({"mission": "nowhere.yaml"}, "parameters.mission: nowhere.yaml: there is no such file"),
    ],
)
def test_mistakes_in_parameters(parameters: dict[str, object], answer: str) -> None:
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping({"simulation": "arena", "parameters": parameters})
    assert answer in str(caught.value)


ROBOT = """\
radius: 0.05
drive: {kind: differential, wheel_base: 0.08, max_speed: 0.2}
sensors:
  - {kind: proximity, count: 8, range: 0.2}
  - {kind: compass}
"""


def test_a_robot_in_a_file_says_how_many_sensors_there_are(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(ROBOT)
    (tmp_path / "swarm.yaml").write_text("simulation: arena\nparameters: {robot: robot.yaml}\n")
    experiment = Experiment.load(tmp_path / "swarm.yaml")
    assert (experiment.sensors, experiment.actuators) == (10, 2)


@pytest.mark.parametrize(
    ("old", "new_text", "answer"),
    [
        (
            "proximity",
            "proximty",
            ':4: sensors[0].kind: "proximty" found, expected one of "proximity", "light"',
        ),
        ("count: 8", "count: 0", ":4: sensors[0].count: 0 found, expected 1 to 128"),
        (
            "differential",
            "tracks",
            ':2: drive.kind: "tracks" found, expected one of "differential"',
        ),
        (
            "max_speed: 0.2",
            "max_speed: fast",
            ':2: drive.max_speed: "fast" (a string) found, expected a number',
        ),
        ("radius: 0.05", "radius: -1", ":1: radius: -1 found, expected 0.001 to 10"),
    ],
)
def test_a_mistake_in_a_robot(tmp_path: Path, old: str, new_text: str, answer: str) -> None:
    (tmp_path / "robot.yaml").write_text(ROBOT.replace(old, new_text))
    (tmp_path / "swarm.yaml").write_text("simulation: arena\nparameters: {robot: robot.yaml}\n")
    with pytest.raises(InputError) as caught:
        Experiment.load(tmp_path / "swarm.yaml")
    assert f"{tmp_path}/swarm.yaml:2: parameters.robot: {tmp_path}/robot.yaml{answer}" in str(caught.value)


def test_missions_and_kinds_name_files_of_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "missions").mkdir()
    (tmp_path / "missions" / "robot.yaml").write_text(ROBOT)
    (tmp_path / "here.yaml").write_text(ROBOT.replace("count: 8", "count: 5"))
    (tmp_path / "missions" / "mine.yaml").write_text(MISSION + "robot: robot.yaml\n")
    swarm = tmp_path / "swarm.yaml"
    swarm.write_text("simulation: arena\nparameters: {mission: missions/mine.yaml}\n")
    # Relative to the file that names them, of settings to the working directory.
    assert Experiment.load(swarm).sensors == 10
    monkeypatch.chdir(tmp_path)
    changed = Experiment.load(swarm, ["parameters.mission.robot=here.yaml"])
    assert (changed.sensors, changed.parameters["mission"]["robots"]) == (7, 12)
    kinds = "parameters.robots=[{robot: here.yaml, count: 2}, {robot: e-puck-rm1.1, count: 1}]"
    listed = Experiment.load(swarm, [kinds]).parameters["robots"]
    assert [kind["count"] for kind in listed] == [2, 1]
    assert listed[0]["robot"]["radius"] == 0.05
    with pytest.raises(InputError) as caught:
        Experiment.load(swarm, [missing := kinds.replace("here", "there")])
    words = "parameters.robots[0].robot: there.yaml: there is no such file; did you mean 'here.yaml'?"
    assert str(caught.value) == f"--set {missing}: {words}"
    (tmp_path / "missions" / "robot.yaml").write_text(ROBOT.replace("radius", "radiu"))
    with pytest.raises(
        InputError, match=r"mine.yaml:11: robot: .*robot.yaml:1: radiu: unknown field `radiu`"
    ):
        Experiment.load(swarm)
    (tmp_path / "missions" / "robot.yaml").unlink()
    with pytest.raises(InputError, match=r"missions/robot.yaml: there is no such file"):
        Experiment.load(swarm)


PRESET = """\
preset: e-puck-rm1.1
drive: {noise: 0.15}
sensors:
  light: {noise: 0.9}
  range_and_bearing: {loss: 0.9, range: 0.6}
"""


def test_a_controller_is_evaluated_on_its_robot_with_other_noise(tmp_path: Path) -> None:
    robot = tmp_path / "noisier.yaml"
    robot.write_text(PRESET)
    values = {
        "simulation": "arena",
        "parameters": {"duration": 20},
        "controller": {"kind": "evostick"},
        "method": {"kind": "random_search", "population": 20, "generations": 1},
        "ranking": {"kind": "absolute", "episodes": 1},
        "servers": "local",
        "validate": False,
    }
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")

    def fitness(setting: str) -> list[float]:
        changed = run.experiment.with_settings([setting])
        assert (changed.sensors, changed.actuators) == (24, 2)
        found = post_evaluate(run, episodes=10, seed=5, experiment=changed)
        return list(map(float, found.episodes))

    plain = fitness("parameters.robot=e-puck-rm1.1")
    same = "{preset: e-puck-rm1.1, drive: {noise: 0.05}, sensors: {range_and_bearing: {loss: 0.85}}}"
    assert fitness(f"parameters.robot={same}") == plain
    noisier = fitness(f"parameters.robot={robot}")
    inline = "{preset: e-puck-rm1.1, drive: {noise: 0.15}, sensors: {light: {noise: 0.9}, range_and_bearing: "
    assert noisier == fitness(f"parameters.robot={inline}{{loss: 0.9, range: 0.6}}}}}}")
    assert noisier != plain


@pytest.mark.parametrize(
    ("old", "new_text", "answer"),
    [
        ("rm1.1", "rm1.3", ':1: preset: "e-puck-rm1.3" found, expected the name of a robot (e-puck-rm1.1, '),
        ("noise: 0.15", "noise: 0.5", ":2: drive.noise: 0.5 found, expected 0 to 0.2"),
        ("noise: 0.15", "max_turn: 90", ":2: drive.max_turn: the drive of e-puck-rm1.1 is differential"),
        (
            "light: {noise: 0.9}",
            "compass: {noise: 5}",
            ":4: sensors.compass: e-puck-rm1.1 has no such sensor",
        ),
        ("{noise: 0.9}", "0.9", ":4: sensors.light: 0.9 found, but with preset it is a mapping of what"),
        ("range: 0.6", "gives: [count]", ":5: sensors.range_and_bearing.gives: unknown field `gives`"),
    ],
)
def test_a_mistake_in_a_changed_preset_is_told_with_its_line(
    tmp_path: Path, old: str, new_text: str, answer: str
) -> None:
    assert PRESET.count(old) == 1
    (tmp_path / "robot.yaml").write_text(PRESET.replace(old, new_text))
    with pytest.raises(InputError) as caught:
        Experiment.from_mapping(
            {"simulation": "arena", "parameters": {"robot": str(tmp_path / "robot.yaml")}}
        )
    assert f"parameters.robot: {tmp_path}/robot.yaml{answer}" in str(caught.value)


@pytest.mark.parametrize("mission", [{}, {"mission": "foraging"}])
def test_robots_that_are_too_large_for_a_named_mission_are_named_themselves(mission: dict[str, str]) -> None:
    """The number of robots, which stands in no file of the user, is not what is to be changed."""
    parameters = {"robot": {"preset": "e-puck-rm1.1", "radius": 3.5}, **mission}
    said = r"^parameters\.robot\.radius: 20 robots do not fit .* smaller radius$"
    with pytest.raises(InputError, match=said):
        Experiment.from_mapping({"simulation": "arena", "parameters": parameters})


def test_a_mistake_in_a_mission_is_not_blamed_on_the_robot(tmp_path: Path) -> None:
    """Which names a patch of this mission, not of the default one."""
    (tmp_path / "mission.yaml").write_text(
        "walls: {rectangle: [3, 2]}\nstart: {disc: {radius: 0.5}}\nfitness: order\n"
        "floor: {patches: [{name: depot, circle: {center: [0, 0], radius: 0.2}, color: black}]}\n"
        "lamps: 3\n"
    )
    (tmp_path / "robot.yaml").write_text(
        "preset: e-puck-rm1.1\nbattery: {standing: 120, driving: 40, charging: {patch: depot, duration: 5}}\n"
    )
    (tmp_path / "mine.yaml").write_text(
        "simulation: arena\nparameters: {mission: mission.yaml, robot: robot.yaml, robots: 5}\n"
        "controller: {kind: evostick}\n"
    )
    with pytest.raises(InputError, match="unknown field `lamps`") as error:
        Experiment.load(tmp_path / "mine.yaml")
    assert "depot" not in str(error.value)
    mission = tmp_path / "mission.yaml"
    mission.write_text(mission.read_text().replace("lamps: 3\n", ""))
    assert Experiment.load(tmp_path / "mine.yaml").simulation == "arena"


@pytest.mark.parametrize("controller", ["{kind: evostick}", "{kind: team, groups: {a: {kind: layered}}}"])
def test_what_follows_from_a_mission_that_is_missing_is_not_told(controller: str, tmp_path: Path) -> None:
    """Its metrics, and its kinds of robots."""
    (tmp_path / "one.yaml").write_text(
        f"simulation: arena\nparameters: {{mission: mine.yaml}}\nfitness: in_west\ncontroller: {controller}\n"
        "method: {populaton: 5}\n"
    )
    for text, words in (
        (None, "there is no such file"),
        ("", "holds nothing; expected keys and values"),
        (
            "simulation: arena\n",
            "is an experiment, not a mission with walls, start, metrics and fitness",
        ),
    ):
        if text is not None:
            (tmp_path / "mine.yaml").write_text(text)
        with pytest.raises(InputError) as raised:
            Experiment.load(tmp_path / "one.yaml")
        mission, method = str(raised.value).splitlines()
        assert mission.startswith(f"{tmp_path}/one.yaml:2: parameters.mission: {tmp_path}/mine.yaml: {words}")
        assert "method.populaton: unknown key" in method


def test_a_mission_in_the_place_of_an_experiment(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(MISSION)
    words = rf"is a mission, not an experiment; use it as .*{{mission: {tmp_path}/mine.yaml}} .*'swarmwr"
    with pytest.raises(InputError, match=words):
        Experiment.load(tmp_path / "mine.yaml")
