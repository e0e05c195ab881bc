import json
import re
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from swarmwright import Run

pytestmark = pytest.mark.slow

EXPERIMENT = """\
simulation: minisim
parameters: {maxSteps: 6, stepSize: 20, helloMessage: Hello there}
method: {kind: random_search, population: 5, generations: 1}
servers: local
"""


@pytest.fixture
def run(program: Any, tmp_path: Path) -> str:
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    result = program("optimize", "x.yaml", "--out", "result")
    assert result.returncode == 0, result.stderr
    return "result"


def test_replay_shows_every_step_and_ends_with_the_fitness_of_the_run(
    program: Any, run: str, tmp_path: Path
) -> None:
    best = Run.open(tmp_path / run).best
    shown = program("replay", run, "--json")
    *scenes, last = [json.loads(line) for line in shown.stdout.splitlines()]
    assert [scene["step"] for scene in scenes] == list(range(len(scenes)))
    assert 2 <= len(scenes) <= 7
    assert scenes[0]["message"] == "Hello there"
    assert scenes[0]["fitness"] == -12.0, "so far: the distance to the goal"
    assert scenes[-1]["fitness"] == last["fitness"] == best.fitness
    assert (last["generation"], last["candidate"]) == (best.generation, best.candidate)
    assert (last["episode"], last["seed"]) == (0, 0)
    text = program("replay", run)
    assert text.stdout.count("Hello there") == len(scenes)
    assert "\x1b" not in text.stdout
    first, *_, end = text.stdout.splitlines()
    assert first == f"minisim: candidate {best.candidate} of generation 0"
    assert end == f"Fitness {best.fitness + 0.0:.6g}."


@pytest.mark.parametrize("name", ["best.gif", "best.PNG"])
def test_replay_saves_pictures(program: Any, run: str, tmp_path: Path, name: str) -> None:
    result = program("replay", run, "--save", name)
    assert result.returncode == 0, result.stderr
    assert name in result.stdout
    with Image.open(tmp_path / name) as picture:
        assert picture.width > 400
        assert (getattr(picture, "n_frames", 1) > 1) == (name == "best.gif")


def test_replay_writes_a_page_and_a_film(program: Any, run: str, tmp_path: Path) -> None:
    for name, what in (("best.html", "The page"), ("best.mp4", "The video")):
        result = program("replay", run, "--save", name)
        assert result.returncode == 0, result.stderr
        assert f"{what} is in {name}" in result.stdout
        assert (tmp_path / name).stat().st_size > 5000
    page = (tmp_path / "best.html").read_text(encoding="utf-8")
    for said in ("of generation 0", "random_search", "layered, 4-8-1, tanh", "Hello there"):
        assert said in page


def test_another_controller(program: Any, run: str, tmp_path: Path) -> None:
    Run.open(tmp_path / run).best.controller.save(tmp_path / "best.json")
    same = program("replay", run, "--controller", "best.json", "--json")
    last, of_run = (
        json.loads(said.stdout.splitlines()[-1]) for said in (same, program("replay", run, "--json"))
    )
    assert last["fitness"] == of_run["fitness"]
    assert (last["controller"], last["candidate"]) == ("best.json", None)
    (tmp_path / "broken.json").write_text('{"version": 1, "kind": "layered"}')
    broken = program("replay", run, "--controller", "broken.json")
    assert broken.returncode == 2
    assert "broken.json" in broken.stderr


def test_any_candidate_of_the_record(program: Any, run: str, tmp_path: Path) -> None:
    record = Run.open(tmp_path / run).record
    for candidate, fitness in enumerate(record.fitness):
        shown = program("replay", run, "--generation", "0", "--candidate", str(candidate), "--json")
        assert json.loads(shown.stdout.splitlines()[-1])["fitness"] == fitness
    of_generation = program("replay", run, "--generation", "0", "--json").stdout.splitlines()[-1]
    assert json.loads(of_generation)["fitness"] == record.fitness.max()


def test_every_episode_of_several(program: Any, tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text(
        EXPERIMENT.replace("maxSteps: 6", "maxSteps: 6, placement: random") + "ranking: {episodes: 3}\n"
    )
    assert program("optimize", "x.yaml", "--out", "several").returncode == 0
    opened = Run.open(tmp_path / "several")
    row = int(opened.record.fitness.argmax())
    for episode, fitness in enumerate(opened.record.episodes[row]):
        shown = program("replay", "several", "--episode", str(episode), "--json").stdout.splitlines()[-1]
        assert json.loads(shown)["fitness"] == fitness
    end = program("replay", "several").stdout.splitlines()[-1]
    first, mean = opened.record.episodes[row][0], opened.best.fitness
    assert end == (
        f"Fitness {first:.6g} in episode 0; recorded fitness of the candidate: {mean:.6g} "
        "(mean of 3 episodes)."
    )
    foreign = program("replay", "several", "--seed", "77")
    assert "with seed 77; recorded fitness of the candidate: " in foreign.stdout


def test_parameters_that_were_evolved_are_played_and_drawn(program: Any, tmp_path: Path) -> None:
    (tmp_path / "rule.yaml").write_text(
        "simulation: minisim\nservers: local\nparameters: {steering: rule, numAgents: 3, numDefenders: 3}\n"
        "controller: {kind: parameter_set, parameters: {avoidance: {type: real, range: [0, 5]}, "
        "maxSteps: {type: integer, range: [3, 9]}}}\n"
        "method: {kind: random_search, population: 4, generations: 1}\n"
    )
    assert program("optimize", "rule.yaml", "--out", "rule").returncode == 0
    for candidate, fitness in enumerate(Run.open(tmp_path / "rule").record.fitness):
        shown = program("replay", "rule", "--generation", "0", "--candidate", str(candidate), "--json")
        assert json.loads(shown.stdout.splitlines()[-1])["fitness"] == fitness
    drawn = program("draw", "rule", "--out", "rule.svg")
    assert drawn.returncode == 0, drawn.stderr


NAMED = ("--candidate", "0:3")
SPLIT = ("--generation", "0", "--candidate", "3")


def test_a_candidate_has_one_name_in_all_commands(program: Any, run: str) -> None:
    named = program("replay", run, "--candidate", "0:3", "--save", "x.gif").stdout
    assert named.startswith("Candidate 3 of generation 0, evaluation 3. Fitness ")
    assert named.endswith("The animation is in x.gif\n")
    assert program("replay", run, "--candidate", "3", "--save", "x.gif").stdout == named
    again = [program("evaluate", run, *option).stdout for option in (NAMED, SPLIT)]
    assert again[0] == again[1]
    assert "Candidate 3 of generation 0, evaluation 3." in again[0]
    assert program("draw", run, *NAMED, "--out", "x.svg").returncode == 0


def test_what_there_is_not_cannot_be_replayed(program: Any, run: str) -> None:
    for options, said in (
        ("--episode 1", "episode 1: the run has only episode 0"),
        ("--episode 0 --seed 3", "leave one out"),
        ("--generation 1", "result: has only generation 0, but no generation 1"),
        ("--generation 0 --candidate 5", "result: generation 0 has candidates 0 to 4, but no candidate 5"),
        ("--candidate 0:5", "result: generation 0 has candidates 0 to 4, but no candidate 5"),
        ("--generation 0 --candidate 0:3", "--candidate 0:3 names the generation; leave out --generation"),
        ("--candidate best", "'best' is not G:N, such as 19:3"),
        ("--candidate 5", "result: has evaluations 0 to 4, but no evaluation 5"),
        ("--controller x.yaml --generation 0", "--controller and --generation exclude each other"),
        ("--save x.avi", ".html, .gif, .mp4 or .png"),
        ("--save nowhere/x.gif", "there is no folder 'nowhere'"),
    ):
        result = program("replay", run, *options.split())
        assert result.returncode == 2, result.stdout
        assert said in result.stderr


def test_a_folder_that_is_no_run(program: Any, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    result = program("replay", "empty")
    assert result.returncode == 2
    assert "not a run folder" in result.stderr


def test_simulate_gives_the_fitness_that_the_run_had(program: Any, run: str, tmp_path: Path) -> None:
    best = json.loads((tmp_path / run / "best.json").read_text())["fitness"]
    result = program("simulate", "x.yaml", "--controller", run, "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["fitness"] == best
    plain = program("simulate", "x.yaml")
    assert plain.returncode == 0
    assert plain.stdout.startswith("Fitness ")


def test_the_server_draws_when_asked_to(program: Any, run: str) -> None:
    result = program("simulate", "x.yaml", "--controller", run, "--visual")
    assert result.returncode == 0, result.stderr
    assert "Hello there" in result.stdout


def test_a_new_experiment_file_is_valid(program: Any, tmp_path: Path) -> None:
    (tmp_path / "my.yaml").write_text(program("new", "minisim").stdout)
    result = program("simulate", "my.yaml")
    assert result.returncode == 0, result.stderr


def test_the_schema_accepts_the_template(program: Any) -> None:
    from jsonschema import Draft202012Validator
    from ruamel.yaml import YAML

    schema = json.loads(program("schema").stdout)
    Draft202012Validator.check_schema(schema)
    template = YAML(typ="safe").load(program("new", "minisim").stdout)
    assert list(Draft202012Validator(schema).iter_errors(template)) == []
    assert list(Draft202012Validator(schema).iter_errors({**template, "sede": 1}))


def test_several_candidates_stand_on_a_page(program: Any, run: str, tmp_path: Path) -> None:
    (tmp_path / "y.yaml").write_text(EXPERIMENT)
    assert program("optimize", "y.yaml", "--seed", "5", "--out", "other").returncode == 0
    result = program("replay", run, "--beside", "0:3", "--beside", "other", "--save", "several.html")
    assert result.returncode == 0, result.stderr
    page = (tmp_path / "several.html").read_text(encoding="utf-8")
    other = Run.open(tmp_path / "other").best
    assert '"name":"result 0:3"' in page
    assert f'"name":"other 0:{other.candidate}"' in page
    assert program("replay", run, "--beside", "0:3", "--save", "one.html").returncode == 0
    assert '"name":"0:3"' in (tmp_path / "one.html").read_text(encoding="utf-8"), "the run is the same"
    for arguments, words in (
        (("--beside", "0:3"), "--beside needs a page: --save FILE.html"),
        (("--beside", "0:3", "--save", "x.gif"), "--beside needs a page: --save FILE.html"),
        (
            ("--beside", "best", "--save", "x.html"),
            "--beside best: expected GENERATION:CANDIDATE such as 0:7",
        ),
        (("--beside", "7:1", "--save", "x.html"), "has only generation 0, but no generation 7"),
    ):
        wrong = program("replay", run, *arguments)
        assert wrong.returncode == 2
        assert words in wrong.stderr
        assert not (tmp_path / "x.html").exists()


def test_another_run_stands_beside_it_in_the_same_episode(program: Any, run: str, tmp_path: Path) -> None:
    (tmp_path / "longer.yaml").write_text(EXPERIMENT.replace("maxSteps: ", "maxSteps: 1"))
    assert program("optimize", "longer.yaml", "--out", "longer").returncode == 0
    lengths = [Run.open(tmp_path / name).experiment.parameters["maxSteps"] for name in (run, "longer")]
    assert lengths[0] < lengths[1]
    result = program("replay", run, "--beside", "longer", "--save", "both.html")
    assert result.returncode == 0, result.stderr
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    data = json.loads(page.partition('id="episode">')[2].partition("</script>")[0])
    assert all(len(episode["fitness"]) <= lengths[0] + 1 for episode in data["episodes"])
    assert [episode["name"].partition(" ")[0] for episode in data["episodes"]] == ["result", "longer"]
    (tmp_path / "arena.yaml").write_text(ARENA)
    assert program("optimize", "arena.yaml", "--out", "arena").returncode == 0
    wrong = program("replay", run, "--beside", "arena", "--save", "x.html")
    assert wrong.returncode == 2
    assert "arena: does not fit minisim of result: controller.sensors: 9, but" in wrong.stderr
    assert "show it alone: swarmwright replay arena" in wrong.stderr


def test_a_page_says_what_is_not_as_in_the_run(program: Any, run: str, tmp_path: Path) -> None:
    assert program("replay", run, "--save", "same.html").returncode == 0
    same = (tmp_path / "same.html").read_text(encoding="utf-8")
    assert "changed parameters" not in same
    assert "fitness of this episode" not in same
    changes = ("--set", "parameters.maxSteps=3", "--set", "fitness=100 + distance")
    assert program("replay", run, *changes, "--save", "other.html").returncode == 0
    facts = (tmp_path / "other.html").read_text(encoding="utf-8").partition('<dl class="facts">')[2]
    assert "<dt>changed parameters</dt><dd>maxSteps 3 (in the run" in facts
    assert "<dt>changed fitness</dt><dd>100 + distance (in the run the simulation&#x27;s)" in facts
    assert re.search(r"<dt>fitness of this episode</dt><dd>1\d\d", facts), "100 and the distance"


def test_changed_parameters_are_said_as_they_were_typed(program: Any, tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text(ARENA)
    assert program("optimize", "arena.yaml", "--out", "arena").returncode == 0
    (tmp_path / "crowd.yaml").write_text(
        "title: Crowd\nwalls: {sides: 12, apothem: 3}\nstart: {disc: {radius: 2}}\n"
        "metrics: {apart: {kind: nearest_distance, when: end}}\nfitness: apart\n"
    )
    was = Run.open(tmp_path / "arena").experiment.parameters
    changes = ("parameters.mission=crowd.yaml", "parameters.robots=7", "parameters.duration=3")
    options = [part for change in changes for part in ("--set", change)]
    result = program("replay", "arena", *options, "--save", "crowd.html")
    assert result.returncode == 0, result.stderr
    facts = (tmp_path / "crowd.html").read_text(encoding="utf-8").partition('<dl class="facts">')[2]
    before = {key: f" (in the run {was[key]})" if key in was else "" for key in ("robots", "duration")}
    assert (
        f"<dd>mission crowd.yaml (in the run {was['mission']}), robots 7{before['robots']}, "
        f"duration 3{before['duration']}</dd>"
    ) in facts


def test_what_a_picture_shows_can_be_chosen(program: Any, run: str, tmp_path: Path) -> None:
    sizes = {}
    for parts in ("none", "trails", "trails,rays,links,labels"):
        result = program("replay", run, "--show", parts, "--save", "x.png")
        assert result.returncode == 0, result.stderr
        sizes[parts] = (tmp_path / "x.png").read_bytes()
    assert sizes["none"] != sizes["trails"]
    assert sizes["trails"] == sizes["trails,rays,links,labels"], "Minisim has neither rays nor links"
    for options, labels in (((), None), (("--show", "labels"), True), (("--show", "trails"), False)):
        assert program("replay", run, *options, "--save", "x.html").returncode == 0
        page = (tmp_path / "x.html").read_text(encoding="utf-8")
        data = json.loads(page.split('id="episode">')[1].split("</script>")[0])
        assert data["shown"]["labels"] is labels, "None: as the page decides"
    wrong = program("replay", run, "--show", "tracks", "--save", "x.png")
    assert wrong.returncode == 2
    assert "--show: 'tracks' is not a part; choose from trails, rays, links, labels or none" in wrong.stderr


ARENA = """\
simulation: arena
parameters: {mission: aac, robots: 5, duration: 2, robot: e-puck-rm1.2}
controller: {kind: modules}
method: {kind: random_search, population: 3, generations: 1}
validate: false
servers: local
"""


def test_the_arena_is_shown_with_its_robots_and_their_machines(program: Any, tmp_path: Path) -> None:
    (tmp_path / "arena.yaml").write_text(ARENA)
    assert program("optimize", "arena.yaml", "--out", "arena").returncode == 0
    shown = program("replay", "arena", "--json")
    first = json.loads(shown.stdout.splitlines()[0])
    assert {"floor", "patches", "walls", "rays"} <= set(first)
    assert len(first["bodies"]) == 5
    assert all("heading" in body for body in first["bodies"])
    page = program("replay", "arena", "--save", "arena.html")
    assert page.returncode == 0, page.stderr
    text = (tmp_path / "arena.html").read_text(encoding="utf-8")
    data = json.loads(text.split('id="episode">')[1].split("</script>")[0])
    (episode,) = data["episodes"]
    assert episode["trace"]["names"][-2:] == ["left wheel", "right wheel"]
    assert episode["trace"]["agents"] == 5
    assert len(episode["machine"]["states"]) >= 1
    assert episode["metrics"]
    assert {len(values) for values in episode["metrics"].values()} == {len(episode["fitness"])} == {20}
    coloured = program("replay", "arena", "--colors", "controller", "--save", "arena.png")
    assert coloured.returncode == 0, coloured.stderr
    drawn = program("replay", "arena")
    assert "agent 5" in drawn.stdout
    assert "wall" in drawn.stdout


def test_a_replay_says_what_the_fitness_beside_it_is(program: Any, tmp_path: Path) -> None:
    """With racing it is the mean of several instances; with other parameters nothing is to be the same."""
    parameters = "numAgents: 3, numDefenders: 3, placement: random, speedDefenders: 0.5, maxSteps: 15"
    (tmp_path / "x.yaml").write_text(
        f"simulation: minisim\nparameters: {{{parameters}}}\nservers: in-process\n"
        "method: {kind: racing, evaluations: 300, survivors: 4}\n"
    )
    result = program("optimize", "x.yaml", "--out", "raced")
    assert result.returncode == 0, result.stderr
    best = Run.open(tmp_path / "raced").evaluation()
    last = program("replay", "raced").stdout.splitlines()[-1]
    again = program("evaluate", "raced")
    assert again.returncode == 0
    scores = [float(line.rpartition("now ")[2]) for line in again.stdout.splitlines() if "now" in line]
    assert len(scores) > 5
    assert sum(scores) / len(scores) == pytest.approx(best.fitness)
    made = f"recorded fitness of the candidate: {best.fitness:.6g} (mean of {len(scores)} instances)."
    assert last == f"Fitness {scores[0]:.6g} in episode 0; {made}"
    third = program("replay", "raced", "--episode", "3").stdout.splitlines()[-1]
    assert third == f"Fitness {scores[3]:.6g} in episode 3; {made}"
    assert scores[-1] == best.episodes[0]
    other = program("replay", "raced", "--set", "parameters.maxSteps=3").stdout.splitlines()[-1]
    assert "recorded fitness of the candidate: " in other
    assert "bit-identical" not in other
