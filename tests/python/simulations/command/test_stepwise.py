"""Commands that are stepped over their standard input and output."""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, RunError, evaluate, optimize, simulate
from swarmwright.simulations.command import stepwise
from tests.python.cli.test_services import events
from tests.python.records import same_record
from tests.python.simulations.command.processes import Traced

pytestmark = pytest.mark.slow

MINISIM = Path(__file__).with_name("minisim_process.py")
DEFINITION = {
    "command": [sys.executable, str(MINISIM)],
    "title": "minisim",
    "controller": "stepwise",
    "sensors": 4,
    "actuators": 1,
    "metrics": {"arrived": "last", "caught": "last", "steps": "last", "distance": "last"},
    "determinism": "bitwise",
}
VALUES: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"placement": "random", "numAgents": 3},
    "controller": {"kind": "fully_meshed", "hidden": 1},
    "method": {"kind": "nnga", "population": 12, "generations": 2},
    "ranking": {"episodes": 2},
    "fitness": "arrived - 0.1 * distance",
}


def test_two_commands_beside_two_built_in_servers_have_one_record(
    start: Any, embedded_broker: str, tmp_path: Path
) -> None:
    command = Experiment.from_mapping({**VALUES, "simulation": DEFINITION, "fitness": None})
    command.save(tmp_path / "command.yaml")
    processes = [
        start("serve", tmp_path / "command.yaml", "--broker", embedded_broker, "--count", "2", "--json"),
        start("serve", "minisim", "--broker", embedded_broker, "--count", "2", "--json"),
    ]
    for process in processes:
        events(process, "ready", 2)
    experiment = Experiment.from_mapping(VALUES)
    alone = optimize(experiment, out=tmp_path / "alone", servers="local")
    # Enough that all four take part although one kind is much faster.
    together = optimize(
        experiment.replace(mode="stepwise"), out=tmp_path / "together", broker=embedded_broker
    )
    same_record(together, alone)
    assert len(together._store.servers()) == 4


def test_the_same_as_built_in() -> None:
    built_in = Experiment.from_mapping(VALUES)
    command = Experiment.from_mapping({**VALUES, "simulation": {**DEFINITION, "recycle": 3}})
    genomes = np.random.default_rng(1).normal(size=(2, built_in.genome_size)).astype(np.float32)
    expected = evaluate(built_in, genomes, servers="local").tobytes()
    for servers in ("in-process", "local"):
        assert evaluate(command, genomes, servers=servers).tobytes() == expected
    for mode in ("stepwise", "batched"):
        assert evaluate(command.replace(mode=mode), genomes, servers=1).tobytes() == expected


STEPPED = """
import json, os, sys
for number, line in enumerate(sys.stdin):
    speed = json.loads(line)["reset"]["parameters"]["speed"]
    {script}
"""
WELL = (
    'print(json.dumps({"done": True, "fitness": speed + 0.25, "metrics": {"pid": os.getpid()}}), flush=True)'
)


def stepped(traced: Traced, script: str = WELL, **definition: Any) -> Experiment:
    (traced.folder / "stepped.py").write_text(STEPPED.replace("{script}", script))
    return traced.experiment(
        [sys.executable, "stepped.py"],
        controller="stepwise",
        fitness="fitness + 0 * pid",
        metrics={"pid": "last"},
        **definition,
    )


def test_one_process_runs_many_episodes(traced: Traced) -> None:
    experiment = stepped(traced, f"assert number < 5; {WELL}")
    assert evaluate(experiment, [[0.0], [0.5], [1.0], [0.25], [0.75]]).tolist() == [
        0.25,
        0.75,
        1.25,
        0.5,
        1.0,
    ]


def test_what_a_process_prints_at_its_end_is_heard(traced: Traced, capfd: pytest.CaptureFixture[str]) -> None:
    last = "import atexit; atexit.register(print, 'that was all', file=sys.stderr)"
    evaluate(stepped(traced, f"{last}; {WELL}", recycle=1), [[0.0], [0.5], [1.0]])
    assert capfd.readouterr().err.splitlines().count("that was all") >= 2, "of all but the last process"


@pytest.mark.parametrize("how", ["recycle", "exit"])
def test_another_process_after_some_episodes(traced: Traced, how: str) -> None:
    script = f"assert number < 2; {WELL}" + ("; number == 1 and sys.exit()" if how == "exit" else "")
    experiment = stepped(traced, script, recycle=2 if how == "recycle" else 0)
    assert evaluate(experiment, [[0.0], [0.5], [1.0], [0.25], [0.75]]).tolist() == [
        0.25,
        0.75,
        1.25,
        0.5,
        1.0,
    ]


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("sys.exit(3)", "stepped: ended with exit status 3"),
        ("sys.exit(0)", "ended in the middle of an episode, with exit status 0"),
        ("raise OSError('no more rope')", "exit status 1; its last output: .*OSError: no more rope"),
        ("print('{\"done\"', flush=True)", r'wrote a line that is not valid JSON: \{"done"'),
        ('print(\'{"error": "no motor"}\', flush=True)', "reports: no motor"),
        ("print('{\"done\": true}', flush=True)", "without the metric 'pid'; available: none"),
        ("print('{\"x\": true}', flush=True)", "has neither sensors nor done"),
        (
            'print(\'{"done": true, "fitness": NaN, "metrics": {"pid": 1}}\', flush=True)',
            "fitness is nan, expected a finite number",
        ),
        ("print('nothing' * 10**6)", "printed more than 1 MB"),
        (
            "print('{\"done\": true}', end='', flush=True); import time; time.sleep(1000)",
            r"has not ended after 0\.8 s .*; its answer \{\"done\": true\} has no line end; write it",
        ),
        ('print(\'{"done": true, "id": 7}\', flush=True)', 'answered with the "id" 7, expected 1'),
        ("import time; time.sleep(1000)", r"has not ended after 0\.8 s"),
        ("import subprocess; subprocess.Popen(['sleep', '1000']); sys.exit(2)", "exit status 2"),
    ],
)
def test_failures(traced: Traced, script: str, reason: str) -> None:
    timeout = 0.8 if "0\\.8 s" in reason else 100.0
    began = time.monotonic()
    with pytest.raises(RunError, match=reason):
        simulate(stepped(traced, script, timeout=timeout, output=1))
    assert time.monotonic() - began < 5
    assert traced.left() == []


@pytest.mark.parametrize(
    ("metrics", "fitness", "result"),
    [
        ('{"pid": 1, "note": "well", "other": NaN}', "pid", 1),
        ('{"pid": 1, "free": NaN}', "pid", 1),
        ('{"pid": 1, "free": NaN}', "pid + free", "free is nan, expected a finite number"),
        ('{"pid": NaN, "free": 1}', "pid", "pid is nan, expected a finite number"),
        ('{"pid": 1, "free": null}', "pid", "free is null, expected a number"),
        ('{"fitness": true}', "fitness", "fitness is true, expected a number"),
        ("[1]", "pid", r"metrics is \[1\], expected .NAME: NUMBER, "),
    ],
)
def test_metrics_are_checked_where_they_are_used(
    traced: Traced, metrics: str, fitness: str, result: float | str
) -> None:
    declared = {name: "last" for name in ("pid", "free") if name in metrics + fitness}
    script = f'print(\'{{"done": true, "metrics": {metrics}}}\', flush=True)'
    (traced.folder / "stepped.py").write_text(STEPPED.replace("{script}", script))
    experiment = traced.experiment(
        [sys.executable, "stepped.py"], controller="stepwise", fitness=fitness, metrics=declared
    )
    if isinstance(result, str):
        with pytest.raises(RunError, match=result):
            simulate(experiment)
    else:
        assert simulate(experiment) == result


def test_metrics_are_a_list_of_names(traced: Traced) -> None:
    script = 'print(\'{"done": true, "metrics": {"pid": 2, "free": 3}}\', flush=True)'
    (traced.folder / "stepped.py").write_text(STEPPED.replace("{script}", script))

    def experiment(**changes: Any) -> Experiment:
        return traced.experiment([sys.executable, "stepped.py"], controller="stepwise", **changes)

    assert simulate(experiment(metrics=["pid", "free"], fitness="pid + free")) == 5
    named = experiment(metrics=["pid"], fitness="pid").simulation
    assert named == experiment(metrics={"pid": "last"}, fitness="pid").simulation
    announce = r"'fre' is not a metric of .*list the metrics of a command in simulation.metrics: \[NAME"
    with pytest.raises(InputError, match=announce):
        experiment(metrics=["pid", "free"], fitness="fre")
    with pytest.raises(RunError, match=r"stepped: ended an episode without a fitness; write"):
        simulate(experiment())


TWICE = """
import json, sys
def say(**words): print(json.dumps(words), flush=True)
for line in sys.stdin:
    message = json.loads(line)
    if "reset" in message:
        steps, total, speed = 0, 0.0, 0.0
    else:
        speed = message["actuators"][0][0]
        steps, total = steps + 1, total + speed
    if steps == 40:
        say(done=True, fitness=total)
        if {end} and speed < 0: say(done=True, fitness=total)
    else:
        say(sensors=[[0.5]])
        if {middle} and speed < 0: say(sensors=[[0.5]])
"""


def twice(traced: Traced, *, end: bool = False, middle: bool = False) -> Experiment:
    (traced.folder / "twice.py").write_text(TWICE.replace("{end}", str(end)).replace("{middle}", str(middle)))
    command = [sys.executable, "twice.py"]
    experiment = traced.experiment(command, controller="stepwise", sensors=1, actuators=1)
    return experiment.replace(controller={"kind": "layered", "hidden": []})


def test_an_end_that_is_said_twice_is_a_failure(traced: Traced, caplog: pytest.LogCaptureFixture) -> None:
    """The program may be one message behind."""
    genomes = np.random.default_rng(4).normal(size=(8, 2))
    well = evaluate(twice(traced), genomes)
    fitness = evaluate(twice(traced, end=True), genomes)
    assert np.isnan(fitness).tolist() == (well < 0).tolist()
    assert (fitness == well)[well > 0].all()
    assert 'answered a message twice: {"done": true' in caplog.text


def test_the_first_warning_of_a_command_is_logged(traced: Traced, caplog: pytest.LogCaptureFixture) -> None:
    script = TWICE.replace(
        "say(done=True, fitness=total)", "say(done=True, fitness=total, warning='slow\\x1b')", 1
    )
    (traced.folder / "twice.py").write_text(script.replace("{end}", "0").replace("{middle}", "0"))
    experiment = traced.experiment(
        [sys.executable, "twice.py"], controller="stepwise", sensors=1, actuators=1
    ).replace(controller={"kind": "layered", "hidden": []})
    genomes = np.random.default_rng(4).normal(size=(4, 2))
    assert evaluate(experiment, genomes).tolist() == evaluate(twice(traced), genomes).tolist()
    assert caplog.text.count("the command reports: slow\\x1b") == 1


def test_an_error_may_come_at_any_time(traced: Traced) -> None:
    script = TWICE.replace(
        "say(sensors=[[0.5]])", 'say(sensors=[[0.5]]); steps == 2 and say(error="no motor")'
    )
    (traced.folder / "late.py").write_text(script.replace("{end}", "False").replace("{middle}", "False"))
    experiment = traced.experiment(
        [sys.executable, "late.py"], controller="stepwise", sensors=1, actuators=1
    ).replace(controller={"kind": "layered", "hidden": []})
    with pytest.raises(RunError, match="late: reports: no motor"):
        simulate(experiment)


def test_two_answers_to_a_message_fail_the_episode(traced: Traced, caplog: pytest.LogCaptureFixture) -> None:
    genomes = np.random.default_rng(4).normal(size=(8, 2))
    well = evaluate(twice(traced), genomes)
    fitness = evaluate(twice(traced, middle=True), genomes)
    assert np.isnan(fitness).tolist() == (well < 0).tolist()
    assert (fitness == well)[well > 0].all()
    assert 'answered a message twice: {"sensors": ' in caplog.text


BEHIND = """
import json, os, sys, time
def say_rest(text): print(text, flush=True)
def say(**words): say_rest(json.dumps(words))
number = 0
for line in sys.stdin:
    message = json.loads(line)
    number += 1
    if "reset" in message:
        steps, total = 0, 0.0
    else:
        steps, total = steps + 1, total + steps * message["actuators"][0][0]
    answer = dict(sensors=[[steps]]) if steps < 6 else dict(done=True, fitness=total)
    if {repeats}: answer["id"] = message["id"]
    say(**answer)
    if steps == {at}:
        # The second answer comes after the next message.
        line = sys.stdin.readline()
        say(**answer)
        message = json.loads(line)
        steps, total = steps + 1, total + steps * message["actuators"][0][0]
        answer = dict(sensors=[[steps]])
        if {repeats}: answer["id"] = message["id"]
        say(**answer)
    elif steps == 6 and {after}:
        {after}
"""


def behind(traced: Traced, *, repeats: bool = False, at: int = -1, after: str = "0") -> Experiment:
    script = BEHIND.replace("{repeats}", str(repeats)).replace("{at}", str(at)).replace("{after}", after)
    (traced.folder / "behind.py").write_text(script)
    command = [sys.executable, "behind.py"]
    experiment = traced.experiment(command, controller="stepwise", sensors=1, actuators=1)
    return experiment.replace(controller={"kind": "layered", "hidden": []})


def test_a_second_answer_that_comes_late_gives_no_fitness(
    traced: Traced, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stepwise, "SETTLE_S", 1.0)  # of which nothing is waited where an answer comes
    genomes = np.random.default_rng(4).normal(size=(4, 2))
    assert np.isnan(evaluate(behind(traced, at=2), genomes)).all()
    assert "answered a message twice: {" in caplog.text
    caplog.clear()
    assert np.isnan(evaluate(behind(traced, at=2, repeats=True), genomes)).all()
    assert "answered message 3 twice" in caplog.text


@pytest.mark.parametrize("delay", [0, 0.015, 0.06])
@pytest.mark.parametrize("servers", ["in-process", 2])
def test_a_process_that_fails_after_the_end_fails_no_episode(
    traced: Traced, caplog: pytest.LogCaptureFixture, servers: Any, delay: float
) -> None:
    """Whenever that is seen."""
    genomes = np.random.default_rng(4).normal(size=(6, 2))
    well = evaluate(behind(traced), genomes)
    fails = behind(traced, after=f"(time.sleep({delay}), os._exit(3))")
    assert evaluate(fails, genomes, servers=servers).tolist() == well.tolist()
    if servers == "in-process":
        assert caplog.text.count("ended with exit status 3 after the end of an episode: it may have") == 1
        assert len(caplog.records) == 1


@pytest.mark.parametrize("fails", ["sys.exit(3)", 'print(\'{"error": "no motor"}\', flush=True)'])
def test_a_reset_that_fails_because_of_its_parameters(
    traced: Traced, caplog: pytest.LogCaptureFixture, fails: str
) -> None:
    experiment = stepped(traced, f"speed == 0.5 and {fails}; {WELL}")
    fitness = evaluate(experiment, [[0.0], [0.25], [0.5], [0.75]])
    assert [str(value) for value in fitness] == ["0.25", "0.5", "nan", "1.0"]
    assert "after the end of an episode" not in caplog.text


@pytest.mark.parametrize(
    ("late", "repeats"),
    [
        ('say(error="no paper", id=answer["id"])', True),
        ('say(error="no paper")', True),
        ('say(error="no paper")', False),
        ('(time.sleep(0.06), say(error="no paper"))', False),
        # As programs that do not buffer, which write the line end apart.
        ("""(print('{"error": "no paper"', end="", flush=True), time.sleep(0.04), say_rest("}"))""", False),
    ],
)
@pytest.mark.parametrize("servers", ["in-process", 2])
def test_an_error_after_the_end_fails_no_episode(
    traced: Traced, caplog: pytest.LogCaptureFixture, servers: Any, late: str, repeats: bool
) -> None:
    """Whenever it comes."""
    genomes = np.random.default_rng(4).normal(size=(5, 2))
    well = evaluate(behind(traced), genomes)
    reports = behind(
        traced, repeats=repeats, after=late if repeats else late.replace(', id=answer["id"]', "")
    )
    assert evaluate(reports, genomes, servers=servers).tolist() == well.tolist()
    if servers == "in-process":
        assert [one.getMessage() for one in caplog.records] == [
            "the command reports an error after the end of an episode: no paper"
        ]


def test_repeated_ids_tell_a_second_end_from_the_next_answer(
    traced: Traced, caplog: pytest.LogCaptureFixture
) -> None:
    genomes = np.random.default_rng(4).normal(size=(8, 2))
    well = evaluate(behind(traced), genomes)
    twice = behind(traced, repeats=True, after="say(**answer)")
    assert evaluate(twice, genomes).tolist() == evaluate(twice, genomes).tolist() == well.tolist()
    assert not caplog.records


def test_after_a_failure_another_process_goes_on(traced: Traced) -> None:
    experiment = stepped(traced, f"assert speed != 0.5; {WELL}")
    fitness = evaluate(experiment, [[0.0], [0.5], [1.0]])
    assert [str(value) for value in fitness] == ["0.25", "nan", "1.25"]


def test_a_byte_order_mark_before_the_first_answer(traced: Traced) -> None:
    marked = WELL.replace("print(", "print('\\ufeff' * (not number) + ")
    experiment = stepped(traced, f"sys.stdout.reconfigure(encoding='utf-8'); {marked}")
    assert evaluate(experiment, [[0.0], [0.5]]).tolist() == [0.25, 0.75]


def test_nothing_is_left_after_a_run(traced: Traced) -> None:
    simulate(stepped(traced), servers="local")
    assert traced.left(within=5) == []
