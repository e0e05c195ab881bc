"""A league of controllers from runs, bundles and files: its table, who is left out, and its repetition."""

import io
import json
import os
import zipfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, RunError, optimize
from swarmwright.analysis.league import League, find_entries, find_experiment, play_league
from swarmwright.cli import run as run_command
from swarmwright.runs.matches import play
from swarmwright.runs.post_evaluation import EvaluationOptions
from tests.python.experiment.test_opponents import bundle
from tests.python.simulations.duel import Duel, Trio, Wide

TOURNAMENT: dict[str, Any] = {
    "simulation": Duel,
    "controller": {"hidden": []},
    "method": {"population": 4, "generations": 1},
    "ranking": {"kind": "tournament", "pairing": "random", "rounds": 1},
}
ROLES: dict[str, Any] = {
    "simulation": Wide,
    "controller": {"hidden": []},
    "populations": {"left": {}, "right": {}},
    "method": {"population": 4, "generations": 1},
    "ranking": {"rounds": 1},
}


TRIO: dict[str, Any] = {
    "simulation": Trio,
    "controller": {"hidden": []},
    "populations": {"first": {}, "second": {}, "third": {}},
    "method": {"population": 4, "generations": 3},
    "ranking": {"pairing": "best"},
}


def pulling(strength: float, sensors: int = 1, **changes: Any) -> dict[str, Any]:
    """Return a controller whose only actuator is about its strength."""
    return {
        "version": 1,
        "kind": "layered",
        "sensors": sensors,
        "hidden": [],
        "actuators": 1,
        "activation": "tanh",
        "output_range": [-1, 1],
        "weights": [float(np.arctanh(strength)), *([0.0] * sensors)],
        **changes,
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Controllers that pull with 0.1, 0.3, 0.5 and 0.8, the last one in a bundle."""
    path = tmp_path / "league"
    path.mkdir()
    for strength in (0.1, 0.3, 0.5):
        (path / f"pull-{strength}.json").write_text(json.dumps(pulling(strength)))
    bundle(path / "their.zip", pulling(0.8))
    return path


def options(episodes: int = 4, seed: int | None = 7, servers: Any = "in-process") -> EvaluationOptions:
    return EvaluationOptions.of(episodes, seed, None, servers, None)


def league(folder: Path, values: dict[str, Any] | None = None, **changes: Any) -> League:
    experiment = Experiment.from_mapping(TOURNAMENT if values is None else values)
    return play_league(folder, experiment, options(**changes))


def command(*arguments: str | Path, status: int = 0) -> str:
    """Run `swarmwright league`; return what it has said."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text):
        assert run_command(["league", *map(str, arguments)]) == status, text.getvalue()
    return text.getvalue()


def test_the_stronger_is_before_the_weaker(folder: Path) -> None:
    (folder / "their.zip").unlink()  # a controller of another simulation
    (folder / "pull-0.8.json").write_text(json.dumps(pulling(0.8)))
    table = league(folder, episodes=20)
    ((side, rows),) = table.tables
    assert side == ""
    assert [participant.name for participant, _ in rows] == [f"pull-{x}.json" for x in (0.8, 0.5, 0.3, 0.1)]
    assert table.matches == 12
    assert sum(standing.wins for _, standing in rows) == 12 * 20
    best = rows[0][1]
    assert best.rating_interval is not None
    assert best.rating_interval[0] <= best.rating <= best.rating_interval[1]
    assert table.mean_fitness(rows[0][0], 0) == pytest.approx(2.4, abs=0.3)


def test_matches_are_those_of_play(folder: Path) -> None:
    table = league(folder)
    experiment = Experiment.from_mapping(TOURNAMENT)
    weights = [participant.opponent.weights for participant in table.participants]
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    expected = play(
        experiment,
        [np.concatenate([weights[i], weights[j]]) for i, j in pairs],
        table.seeds,
        servers="in-process",
    )
    assert [table.fitness[i, j].tolist() for i, j in pairs] == expected.tolist()


def test_controllers_of_several_architectures_meet(folder: Path) -> None:
    hidden = pulling(0.9, hidden=[2], weights=[3.0, 0, 3.0, 0, 1.0, 1.0, 1.0])
    (folder / "hidden.json").write_text(json.dumps(hidden))
    table = league(folder)
    assert table.matches == 12
    assert table.tables[0][1][0][0].name == "hidden.json"


def test_who_is_left_out_and_why(folder: Path) -> None:
    (folder / "broken.json").write_text("{")
    (folder / "wide.json").write_text(json.dumps(pulling(0.2, 2)))
    (folder / "copy.json").write_text(json.dumps(pulling(0.1)))
    (folder / "\x1b[2J\n.json").write_text("[]")
    (folder / "empty").mkdir()
    (folder / "notes.txt").write_text("no controller")
    (folder / ".hidden.json").write_text("{")
    os.mkfifo(folder / "pipe.json")
    table = league(folder)
    reasons = {each.name: each.reason for each in table.left_out}
    assert list(reasons) == sorted(reasons)
    for name, reason in [
        ("broken.json", "broken.json: is not valid JSON"),
        ("wide.json", "wide.json: has 2 sensors and 1 actuators, but the agents have 1 and 1"),
        ("pull-0.1.json", "pull-0.1.json: is the same controller as copy.json"),
        (r"\x1b[2J\n.json", r"\x1b[2J\n.json: [] found; expected"),
        ("empty", "empty: is neither a run folder"),
        ("pipe.json", "pipe.json: is not a regular file"),
        ("their.zip", "their.zip: was evolved in minisim, not in Duel"),
    ]:
        assert reasons.pop(name).startswith(reason)
    assert not reasons
    assert str(table).count("Left out: ") == 7


def test_too_few_that_can_meet(folder: Path) -> None:
    for strength in (0.1, 0.3):
        (folder / f"pull-{strength}.json").unlink()
    with pytest.raises(
        InputError, match=r"no two controllers that can meet in a match; their.zip: was evolved"
    ):
        league(folder)
    with pytest.raises(InputError, match=r"so the experiment is unknown; name one with --experiment"):
        play_league(folder, None, options())
    alone = Experiment.from_mapping({"simulation": "minisim"})
    with pytest.raises(InputError, match="not a competition"):
        play_league(folder, alone, options())


def test_failed_episodes_do_not_count(folder: Path) -> None:
    failing = {**TOURNAMENT, "parameters": {"tears": 1.0}}
    table = league(folder, failing)
    assert 0 < table.failed < table.matches * 4
    assert any(f"{table.failed} episodes failed and did not count" in note for note in table.caveats)
    assert sum(standing.wins for _, standing in table.tables[0][1]) == table.matches * 4 - table.failed
    with pytest.raises(RunError, match="every episode failed"):
        league(folder, {**TOURNAMENT, "parameters": {"tears": 9.0}})


def test_sides_with_different_tasks_have_a_table_each(tmp_path: Path) -> None:
    for strength in (0.1, 0.5):
        (tmp_path / f"left-{strength}.json").write_text(json.dumps(pulling(strength, 2)))
        (tmp_path / f"right-{strength}.json").write_text(json.dumps(pulling(strength)))
    optimize(Experiment.from_mapping(ROLES), servers="in-process", out=tmp_path / "run")
    table = league(tmp_path, ROLES, episodes=6)
    assert table.matches == 3 * 3 - 1
    tables = {side: [participant.name for participant, _ in rows] for side, rows in table.tables}
    assert {side: sorted(names) for side, names in tables.items()} == {
        "left": ["left-0.1.json", "left-0.5.json", "run"],
        "right": ["right-0.1.json", "right-0.5.json", "run"],
    }
    assert tables["left"].index("left-0.5.json") < tables["left"].index("left-0.1.json")
    assert "Side left" in str(table)
    assert "same opponent and seed" in str(table)
    # Without an experiment, it is that of the run, whose seeds are not used again.
    again = play_league(tmp_path, None, options(6, seed=None))
    assert not set(again.seeds) & {0, 1}


def test_the_same_table_again_and_whatever_files_are_called(folder: Path) -> None:
    table = league(folder)
    assert str(league(folder)) == str(table)
    (folder / "pull-0.1.json").rename(folder / "z.json")
    assert league(folder).digest == table.digest
    assert league(folder, seed=8).digest != table.digest


def test_the_command_prints_and_writes_the_table(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    duel = Path(__file__).parents[1] / "simulations" / "duel.py"
    text = f"simulation: {duel}:Duel\nranking: {{kind: tournament}}\n"
    Path("duel.yaml").write_text(text)
    arguments = (folder, "--experiment", "duel.yaml", "--episodes", "3", "--servers", "in-process")
    said = command(*arguments, "--seed", "5", "--output", "table.md", status=1)
    lines = said.splitlines()
    assert lines[0] == "3 controllers, 6 matches of 3 episodes in Duel"
    assert lines[1] == "Seeds: 5 to 7"
    assert lines[4].split()[:4] == ["rank", "controller", "rating", "95"]
    assert lines[5].split()[:2] == ["1", "pull-0.5.json"]
    assert "The table is in table.md" in said
    table = Path("table.md").read_text()
    assert "| 1 | pull-0.5.json | " in table
    assert r"left\_pull" not in table
    (folder / "league.yaml").write_text(text)
    refused = command(*arguments[:1], *arguments[3:], status=2)
    assert "names a simulation that is not built in, or code" in refused
    named = ("--experiment", folder / "league.yaml")
    assert f"--experiment {folder / 'league.yaml'}" in refused
    (line,) = command(folder, *named, *arguments[3:], "--seed", "5", "--json", status=1).splitlines()
    values = json.loads(line)
    assert values["seeds"] == [5, 6, 7]
    assert values["tables"][0]["rows"][0]["name"] == "pull-0.5.json"
    assert f"SHA-256 of the results: {values['digest']}" in said
    assert len(values["matches"]) == 6
    assert values["left_out"][0]["name"] == "their.zip"
    assert values["sides"] == {"left": "left_pull", "right": "right_pull"}


@pytest.mark.parametrize(
    "changes",
    [
        {"simulation": "evil.py:Evil"},
        {"simulation": "package.evil:Evil"},
        {"simulation": {"command": "touch evil"}},
        {"simulation": "evil.fmu"},
        {"simulation": None},
        {"method": {"kind": "evil.py:Evil"}},
        {"controller": {"kind": "evil.py:Evil"}},
        {"populations": {"left": {"method": {"kind": "evil.py:Evil"}}}},
    ],
)
def test_the_file_of_a_folder_executes_no_code(changes: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "evil.py").write_text("raise AssertionError('is executed')\n")
    (tmp_path / "league.yaml").write_text(json.dumps({**SOCCER, **changes}))
    with pytest.raises(InputError, match=r"not built in, or code, .*--experiment .*league\.yaml"):
        find_experiment(tmp_path, [])


def test_the_file_of_a_folder_is_its_experiment(tmp_path: Path) -> None:
    (tmp_path / "league.yaml").write_text(json.dumps(SOCCER))
    assert find_experiment(tmp_path, []) == Experiment.from_mapping(SOCCER)


def test_many_other_files_are_counted(folder: Path) -> None:
    for number in range(50):
        (folder / f"x{number:02}.json").write_text("{}")
    table = league(folder)
    assert len(table.left_out) == 51
    for text in (str(table), table.markdown()):
        lines = [line for line in text.splitlines() if "Left out: " in line]
        assert len(lines) == 21
        assert lines[-1].endswith("Left out: 31 more; --json has all")


def test_three_sides_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match=r"needs two sides, so that two .*, but .* has first, second, third"):
        league(folder, TRIO)


def test_why_there_are_no_intervals(folder: Path) -> None:
    still = {**TOURNAMENT, "parameters": {"slip": 0.0}}
    assert league(folder, still).caveats == (
        "the results do not depend on the seed, so there are no intervals",
    )
    calm = {**TOURNAMENT, "parameters": {"slip": 0.01}}
    assert league(folder, calm).caveats == ("each seed has the same winners, so there are no intervals",)
    assert league(folder, calm, episodes=1).caveats == league(folder, calm).caveats
    wild = {**TOURNAMENT, "parameters": {"slip": 0.8}}
    assert league(folder, wild).caveats == (
        "intervals of so few episodes are too narrow; choose more with --episodes",
    )
    assert league(folder, wild, episodes=5).caveats == ()


def test_markdown_cannot_be_imitated_by_names(folder: Path) -> None:
    (folder / "a|b](x)<i>`.json").write_text(json.dumps(pulling(0.6)))
    table = league(folder).markdown()
    assert r"a\|b\](x)\<i\>\`.json" in table
    rows = [line for line in table.splitlines() if line.startswith("| ")]
    assert len({line.replace(r"\|", "").count("|") for line in rows}) == 1


def test_wrong_arguments_have_a_message(folder: Path, tmp_path: Path) -> None:
    assert "this table ends with .md" in command(folder, "--output", tmp_path / "t.csv", status=2)
    assert "does not exist" in command(tmp_path / "nothing", status=2)
    (folder / "run.sqlite").touch()
    with pytest.raises(InputError, match="is a run folder; name the folder in which"):
        find_entries(folder)


SOCCER: dict[str, Any] = {
    "simulation": "arena",
    "parameters": {"mission": "soccer", "duration": 1},
    "ranking": {"kind": "tournament", "sides": {"left": "left_goals", "right": "right_goals"}},
    "populations": {},
}


def recorded(path: Path, experiment: Any) -> Path:
    """Write a bundle with this record of its experiment."""
    bundle(path)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    files["evaluation.json"] = json.dumps({"experiment": experiment}).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


def test_the_experiment_of_a_bundle_is_used_if_its_simulation_is_built_in(tmp_path: Path) -> None:
    competition = Experiment.from_mapping(
        {"simulation": "arena", "parameters": {"mission": "soccer"}, "ranking": {"kind": "tournament"}}
    )
    sides = competition.to_mapping()["ranking"]["sides"]
    values = {**SOCCER, "ranking": {**SOCCER["ranking"], "sides": sides}, "servers": {"launcher": "process"}}
    recorded(tmp_path / "b.zip", values)
    table = find_experiment(tmp_path, ["b.zip"])
    assert table is not None
    assert (table.simulation, table.parameters["duration"]) == ("arena", 1)
    assert table.servers == competition.servers  # only what matches need is read


@pytest.mark.parametrize(
    "experiment",
    [
        {**SOCCER, "simulation": "command:{}"},
        {**SOCCER, "simulation": "evil.py:Evil"},
        {**SOCCER, "simulation": ["arena"]},
        {**SOCCER, "simulation": None},
        {**SOCCER, "parameters": [1]},
        {**SOCCER, "parameters": {"mission": "nothing"}},
        {**SOCCER, "ranking": {"sides": {"left": "__import__('os')", "right": "1"}}},
        {**SOCCER, "ranking": {"sides": {"here": "1", "there": "2"}}},
        {**SOCCER, "ranking": {"sides": ["left", "right"]}},
        {**SOCCER, "ranking": None},
        {**SOCCER, "populations": {"\x1b": {}}},
        {**SOCCER, "populations": 7},
        [],
        None,
    ],
)
def test_what_a_bundle_says_of_its_experiment_is_not_trusted(tmp_path: Path, experiment: Any) -> None:
    recorded(tmp_path / "b.zip", experiment)
    with pytest.raises(InputError, match="the experiment is unknown"):
        find_experiment(tmp_path, ["b.zip"])


@pytest.mark.slow
def test_the_same_table_on_servers(folder: Path) -> None:
    assert league(folder, servers=2).digest == league(folder).digest
