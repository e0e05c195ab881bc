"""What is said of a run's best on seeds that the run did not use."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError, Run, optimize, post_evaluate

pytestmark = pytest.mark.slow

NOISY = """\
simulation: minisim
parameters: {numAgents: 3, numDefenders: 3, placement: random, speedDefenders: 0.5}
method: {kind: random_search, population: 20, generations: 15}
ranking: {episodes: 2, seeds: new}
servers: local
"""


@pytest.fixture
def noisy(tmp_path: Path) -> Path:
    path = tmp_path / "noisy.yaml"
    path.write_text(NOISY)
    return path


def test_noisy_runs_end_with_it(program: Any, noisy: Path) -> None:
    noisy.with_name("sweep.yaml").write_text(
        "experiment: noisy.yaml\ngrid: {method.generations: [15]}\nseeds: [1]\n"
    )
    result = program("optimize", noisy, "--out", "run", "--json")
    last = json.loads(result.stdout.splitlines()[-1])
    unseen = last["unseen"]
    assert (unseen["episodes"], unseen["seed"]) == (30, 1_000_000_000)
    assert unseen["low"] < unseen["fitness"] < unseen["high"] < last["best"]["fitness"]
    fitness = f"{unseen['fitness']:.4g} with standard error {unseen['standard_error']:.2g}"
    interval = f"{unseen['low']:.4g} to {unseen['high']:.4g}"
    said = (
        f"recorded fitness {last['best']['fitness']:.6g} (2 episodes of generation "
        f"{last['best']['generation']}); selection biases it upwards\n"
        f"  fitness on 30 episodes with held-out seeds: {unseen['fitness']:.4g}, "
        f"95 % confidence interval {interval} (Student's t). Report this one\n"
    )
    assert said in program("runs", "show", "run").stdout
    shown = json.loads(program("runs", "show", "run", "--json").stdout)
    assert shown["validation"] == last["validation"]
    assert shown["validation"]["candidates"][0]["fitness"] == unseen["fitness"]
    assert f" ({fitness} on held-out seeds), 300 evaluations" in program("sweep", "sweep.yaml").stdout


def test_too_few_episodes_for_one_fitness(program: Any, noisy: Path) -> None:
    settings = ["method.generations=1", "ranking={episodes: 3, aggregate: median}", "validate=false"]
    run = optimize(Experiment.load(noisy, settings), out=noisy.parent / "run")
    refused = program("evaluate", "run", "--episodes", "2")
    words = "episodes: must be at least ranking.episodes (3), which the fitness aggregates, not 2"
    assert (refused.returncode, words in refused.stderr) == (2, True)
    with pytest.raises(InputError, match=re.escape(words)):
        post_evaluate(run, episodes=2)
    assert "as the median of 3 episodes: " in program("evaluate", "run", "--episodes", "3").stdout


def test_any_run_can_be_asked(program: Any, noisy: Path) -> None:
    optimize(Experiment.load(noisy, ["method.generations=2"]), out=noisy.parent / "run")
    result = program("evaluate", "run", "--episodes", "50", "--seed", "7", "--json")
    assert result.returncode == 0, result.stderr
    values = json.loads(result.stdout)
    assert (values["episodes"], values["seed"], values["seeds"][-1], len(values["values"])) == (50, 7, 56, 50)
    assert values["fitness"]["mean"] == values["mean"]
    again = program("evaluate", "run", "--episodes", "50", "--seed", "7", "--servers", "1")
    assert f"  mean {values['mean']:.6g}, standard error {values['standard_error']:.2g}, 95 %" in again.stdout
    assert f"recorded fitness {values['recorded']:.6g}." in again.stdout
    wrong = program("evaluate", "run", "--set", "parameters.maxSteps=3")
    assert wrong.returncode == 2
    assert wrong.stderr == (
        "swarmwright: --set parameters.maxSteps=3: parameters: --set changes the conditions, so the "
        "result cannot be compared with the record; add --episodes N\n"
    )


def test_it_says_where_the_seeds_are_those_of_the_validation(program: Any, noisy: Path) -> None:
    program("optimize", noisy, "--out", "run", "--set", "validate.episodes=20")
    same = "the same as those of the run's validation (fresh ones: --seed 1000000020)"
    text = program("evaluate", "run", "--episodes", "20").stdout
    assert f"20 episodes with the held-out seeds 1000000000 to 1000000019, {same}:" in text
    assert "20 of them those of the run's validation" in program("evaluate", "run", "--episodes", "30").stdout
    # The next seed after those that are shown is not fresh where the validation has more.
    for options in (("--episodes", "10"), ("--episodes", "1", "--seed", "1000000004")):
        assert "(fresh ones: --seed 1000000020)" in program("evaluate", "run", *options).stdout
    fresh = program("evaluate", "run", "--seed", "1000000020", "--episodes", "5").stdout
    assert "5 episodes with the held-out seeds 1000000020 to 1000000024:" in fresh
    assert (
        "20 of them used by the run:" in program("evaluate", "run", "--seed", "0", "--episodes", "20").stdout
    )
    program("optimize", noisy, "--out", "without", "--set", "validate=false")
    assert "validation" not in program("evaluate", "without", "--episodes", "20").stdout


def test_the_settings_of_other_episodes_are_named(program: Any, noisy: Path) -> None:
    experiment = Experiment.load(noisy, ["method.generations=2", "validate.episodes=20"])
    optimize(experiment, out=noisy.parent / "run")
    asked = ("evaluate", "run", "--episodes", "20", "--set", "parameters.numAgents=2")
    text = program(*asked).stdout
    first, second, third = text.splitlines()[:3]
    assert first.endswith(", without these settings.")
    assert second == "Settings: parameters.numAgents=2"
    assert third == "20 episodes with the held-out seeds 1000000000 to 1000000019:"
    assert json.loads(program(*asked, "--json").stdout)["settings"] == ["parameters.numAgents=2"]
    # Where it is computed does not matter, so that the episodes are those of the validation.
    same = program("evaluate", "run", "--episodes", "20", "--set", "timeouts.step=9").stdout
    assert "those of the run's validation" in same
    assert "without these settings" not in same
    best = ("--controller", "run/best.json", "--episodes", "2")
    said = program("evaluate", "run", *best, "--set", "parameters.numAgents=2").stdout
    assert said.splitlines()[1] == "Settings: parameters.numAgents=2"


def test_the_best_ones_are_listed(program: Any, noisy: Path) -> None:
    asked = ("--set", "validate.episodes=40", "--set", "validate.candidates=3")
    text = program("optimize", noisy, "--out", "run", *asked).stdout
    assert "on 40 episodes with held-out seeds" in text
    table = text[text.index("The 3 best of the run, on these seeds:") :].splitlines()
    assert "generation  candidate  recorded  held-out  95 % interval" in table[1]
    values = json.loads(program("runs", "show", "run", "--json").stdout)["validation"]["candidates"]
    for line, one in zip(table[2:5], values, strict=True):
        assert line.split()[:2] == [str(one["generation"]), str(one["candidate"])]
        assert f"{one['recorded']:.6g}" in line
        assert line.split()[3:] == [f"{one['fitness']:.4g}", f"{one['low']:.4g}", "to", f"{one['high']:.4g}"]
    without = program("optimize", noisy, "--out", "off", "--set", "validate=false").stdout
    assert "held-out" not in without


def test_a_fitness_without_chance_is_said_to_be_so(program: Any, noisy: Path) -> None:
    # What is given is evaluated; with auto, the first 20 are enough.
    for given, count in (("100", 100), ("auto", 20)):
        fixed = ("--set", "parameters.placement=fixed", "--set", f"validate.episodes={given}")
        text = program("optimize", noisy, "--out", f"run {given}", *fixed).stdout
        assert (
            f"All {count} held-out episodes gave the recorded fitness, so it does not seem to depend on the "
            "seed. Report the recorded fitness of this controller; to judge the method, run it with several "
            "seeds (`swarmwright sweep`)."
        ) in text
        last = json.loads(program("runs", "show", f"run {given}", "--json").stdout)
        assert last["unseen"] is None
        assert (last["validation"]["depends_on_seed"], last["validation"]["episodes"]) == (False, count)


def test_resume_does_what_is_left_of_it(program: Any, noisy: Path) -> None:
    program("optimize", noisy, "--out", "run", "--set", "validate=false")
    assert "there is nothing left to do" in program("resume", "run").stdout
    later = program("resume", "run", "--set", "validate.episodes=50")
    assert "run is finished: its best candidates are validated." in later.stdout
    assert "on 50 episodes with held-out seeds" in later.stdout
    assert "there is nothing left to do" in program("resume", "run").stdout


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["local", "2"])
def test_metrics_are_measured_where_they_are_asked_for(program: Any, noisy: Path, servers: str) -> None:
    fitness = ("--set", "fitness=arrived - 0.1 * distance", "--set", "method.generations=2")
    program("optimize", noisy, "--out", "run", "--set", "validate.episodes=20", *fitness)
    options = ("--episodes", "20", "--servers", servers, "--json")
    plain = json.loads(program("evaluate", "run", *options).stdout)
    assert list(plain["metrics"]) == ["arrived", "distance"]
    values = json.loads(program("evaluate", "run", *options, "--metrics", "all").stdout)
    assert values["values"] == plain["values"]
    assert list(values["metrics"]) == ["arrived", "distance", "caught", "steps"]
    for index, value in enumerate(values["values"]):
        one = {name: metric["values"][index] for name, metric in values["metrics"].items()}
        assert value == one["arrived"] - 0.1 * one["distance"]
        assert 1 <= one["steps"] <= 15
    assert (
        json.loads(program("evaluate", "run", *options, "--metrics", "steps").stdout)["metrics"]["steps"]
        == (values["metrics"]["steps"])
    )
    last = Run.open(noisy.parent / "run").validation
    assert last is not None
    assert last.best.metrics["arrived"].tolist() == values["metrics"]["arrived"]["values"]
    wrong = program("evaluate", "run", *options, "--metrics", "arived")
    assert wrong.returncode == 2
    assert "metrics: unknown metric 'arived'; did you mean 'arrived'?" in wrong.stderr
    assert (
        "--metrics needs --episodes or --seed; add one"
        in program("evaluate", "run", "--metrics", "all").stderr
    )


def test_it_is_exported(program: Any, noisy: Path) -> None:
    program("optimize", noisy, "--out", "run", "--set", "validate=false")
    without = program("runs", "export", "run", "table.csv", "--validation")
    assert without.returncode == 2
    assert (
        "run: has no validation; `swarmwright resume run --set validate.episodes=100` makes one"
        in without.stderr
    )
    program("resume", "run", "--set", "validate.episodes=30")
    assert (
        "The validation is in table.csv"
        in program("runs", "export", "run", "table.csv", "--validation").stdout
    )
    assert len((noisy.parent / "table.csv").read_text().splitlines()) == 1 + 5 * 30


def test_a_controller_of_a_file(program: Any, noisy: Path) -> None:
    run = optimize(
        Experiment.load(noisy, ["method.generations=1", "validate=false"]), out=noisy.parent / "run"
    )
    run.best.controller.save(noisy.with_name("mine.json"))
    expected = program("evaluate", "run", "--episodes", "20").stdout.splitlines()
    shown = program("evaluate", noisy, "--controller", "mine.json", "--episodes", "20")
    lines = shown.stdout.splitlines()
    assert lines[0] == "The controller of mine.json."
    assert lines[1:] == expected[1:]
    told = program("evaluate", "run", "--controller", "mine.json", "--seed", "5", "--episodes", "2", "--json")
    values = json.loads(told.stdout)
    assert (values["controller"], values["seeds"], "recorded" in values) == ("mine.json", [5, 6], False)
    for arguments, words in (
        (["mine.json"], "evaluate EXPERIMENT.yaml --controller FILE --episodes 100"),
        (
            ["run", "--controller", "mine.json"],
            "--controller needs --episodes or --seed; add one",
        ),
        (
            ["run", "--controller", "mine.json", "--seed", "1", "--candidate", "0"],
            "--controller and --candidate exclude each other",
        ),
        *(
            (
                [place, "--controller", "mine.json", "--episodes", "2", "--set", f"{key}=4"],
                f"--set {key}=4: has no effect here; set the seed of episodes with --seed",
            )
            for place in (str(noisy), "run")
            for key in ("seed", "parameters.seed")
        ),
    ):
        refused = program("evaluate", *arguments)
        assert (refused.returncode, words in refused.stderr) == (2, True), refused.stderr


def test_a_learning_curve(program: Any, noisy: Path) -> None:
    run = optimize(Experiment.load(noisy, ["method.generations=5"]), out=noisy.parent / "run")
    result = program("evaluate", "run", "--curve", "3", "--episodes", "20", "--out", "curve.svg")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].endswith("best so far, in 20 episodes with the seeds 1000000000 to 1000000019:")
    assert [line.split()[:2] for line in lines[2:5]] == [["0", "20"], ["2", "60"], ["4", "100"]]
    assert "<svg" in noisy.with_name("curve.svg").read_text()
    values = json.loads(
        program("evaluate", "run", "--curve", "3", "--episodes", "20", "--out", "c.csv", "--json").stdout
    )
    (_, _, last) = values["points"]
    assert last["best"]["number"] == run.evaluation().number
    assert last["best"]["fitness"] == post_evaluate(run, episodes=20).fitness.mean
    assert len(noisy.with_name("c.csv").read_text().splitlines()) == 4
    assert (
        "Settings: parameters.speedDefenders=0.2"
        in program("evaluate", "run", "--curve", "2", "--set", "parameters.speedDefenders=0.2").stdout
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "c.png"], "--out needs --curve; add it"),
        (["--curve", "3", "--candidate", "1"], "--curve and --candidate exclude each other"),
        (["--curve", "3", "--metrics", "all"], "--curve and --metrics exclude each other"),
        (["--curve", "3", "--out", "c.txt"], "must end with .png, .svg or .pdf, or with .csv for a table"),
        (["--curve", "0"], "--curve"),
    ],
)
def test_mistakes_with_learning_curves(program: Any, noisy: Path, options: list[str], words: str) -> None:
    optimize(Experiment.load(noisy, ["method.generations=1", "validate=false"]), out=noisy.parent / "run")
    result = program("evaluate", "run", *options)
    assert (result.returncode, words in result.stderr) == (2, True), result.stderr
