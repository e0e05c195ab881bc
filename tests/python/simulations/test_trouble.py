"""What goes wrong in a user's code: said where it happened, one evaluation lost, the next one sound."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import BatchSimulation, Experiment, InputError, RunError, _engine, evaluate, simulate
from swarmwright.servers.evaluation.base import Controllers, Results
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.simulations.host import Host
from tests.python.simulations import troubled
from tests.python.simulations.troubled import Walk

SOURCE = Path(troubled.__file__).read_text().splitlines()


def line(code: str) -> int:
    (found,) = (number for number, text in enumerate(SOURCE, 1) if code in text)
    return found


TROUBLE = [
    ("reset", rf"Walk.reset: LookupError: no start \(.*troubled.py:{line('no start')}\)"),
    ("raise", rf"Walk.step: IndexError: list index out of range \(.*troubled.py:{line('[0, 1]')}\)"),
    ("numpy", rf"Walk.step: ValueError: all the input array.*troubled.py:{line('np.concatenate')}\)"),
    ("compiled", rf"Walk.step: ValueError: scale < 0 \(.*troubled.py:{line('scale=-1')}\)"),
    (
        "shape",
        r"Walk.step: observations of the shape \(2, 1\) returned, expected \(2, 2\): a row of 2",
    ),
    ("flat", r"Walk.step: observations of the shape \(2,\) returned, expected \(2, 2\)"),
    ("rows", r"Walk.step: observations of the shape \(1, 2\) returned, expected \(2, 2\)"),
    ("nan", r"Walk.step: sensor 0 of agent 0 is nan, expected a finite number"),
    ("huge", r"Walk.step: sensor 0 of agent 0 is inf, expected a finite number \(binary32\)"),
    ("text", r"Walk.step: 'left, right' returned, expected numbers of the shape \(2, 2\)"),
    ("nothing", r"Walk.step: None returned, expected numbers of the shape \(2, 2\)"),
    ("ragged", r"Walk.step: \[\[1.0\], \[1.0, 2.0\]\] returned, expected numbers"),
    (
        "gymnasium",
        r"Walk.step: a tuple of 5 \(ndarray, float, bool, bool, dict\) returned, expected only the obs",
    ),
    ("array", r"Walk.step: an array of <U4 of the shape \(20, 20\) returned, expected numbers of the shape"),
    ("not done", r"Walk.done: None returned, expected True or False"),
    ("fitness", r"Walk.fitness: nan returned, expected a finite number"),
    ("abort", rf"Walk.fitness: Abort \(.*troubled.py:{line('raise Abort')}\)"),
    (
        "mute",
        rf"Walk.fitness: MuteError: its text is unavailable: ValueError \(.*:{line('raise MuteError')}\)",
    ),
    ("bytes as fitness", r"Walk.fitness: b'1' returned, expected a finite number"),
    ("no fitness", r"Walk.fitness: None returned, expected a finite number"),
    ("acting", r"Walk.acting: \[0, 2\] returned, but there are 2 agents, from 0 to 1"),
    ("acting text", r"Walk.acting: \['0'\] returned, expected indices of agents, \(2,\) booleans or None"),
    ("acting flags", r"Walk.acting: \[1, 1\] returned, which names agents twice: .*flags are booleans"),
    ("acting float", r"Walk.acting: \[0.5\] returned, expected indices of agents, \(2,\) booleans or None"),
]


MEASURE = [
    ("measure", r"Walk.measure: {'left': 0} returned, which lacks 'steps'"),
    ("measure text", r"Walk.measure: 'left' returned, expected a mapping from names to numbers"),
    ("measure nan", r"Walk.measure: 'steps' is None, expected a number"),
]


def experiment(trouble: str, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {"simulation": Walk, "parameters": {"trouble": trouble}, "ranking": {"episodes": 6}, **changes}
    )


@pytest.mark.parametrize(("trouble", "words"), TROUBLE, ids=[name for name, _ in TROUBLE])
def test_the_reason_names_method_and_line(trouble: str, words: str) -> None:
    with pytest.raises(RunError, match=f"the episode failed: {words}"):
        simulate(experiment(trouble), servers="in-process")


@pytest.mark.slow
@pytest.mark.parametrize(("trouble", "words"), MEASURE, ids=[name for name, _ in MEASURE])
@pytest.mark.parametrize("servers", ["in-process", 1])
def test_metrics_are_checked_where_they_are_wanted(trouble: str, words: str, servers: Any) -> None:
    simulate(experiment(trouble), servers="in-process")
    with pytest.raises(RunError, match=f"the episode failed: {words}"):
        simulate(experiment(trouble, fitness="steps"), servers=servers)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("servers", "mode"),
    [("in-process", "auto"), (1, "batched"), (2, "offloaded")],
    ids=["in-process", "batched", "offloaded"],
)
@pytest.mark.parametrize("trouble", ["reset", "raise", "nan", "fitness"])
def test_one_evaluation_fails_and_the_others_are_sound(servers: Any, mode: str, trouble: str) -> None:
    seeds = [0, 1, 2, 3, 4]  # of which 0 and 3 make trouble
    genomes = np.random.default_rng(1).normal(size=(6, experiment("").genome_size)).astype(np.float32)

    def results(one: Experiment, servers: Any) -> Results:
        with open_backend(one, servers=servers) as backend:
            return backend.evaluate(
                Controllers.from_genomes(one.representation(), genomes), seeds, lambda *_: None
            )

    found, sound = results(experiment(trouble, mode=mode), servers), results(experiment(""), "in-process")
    failed = np.isin(seeds, [0, 3])
    assert np.isnan(found.fitness[:, failed]).all()
    assert found.fitness[:, ~failed].tobytes() == sound.fitness[:, ~failed].tobytes()
    reasons = [*found.journal.errors]
    method = {"raise": "step", "nan": "step"}.get(trouble, trouble)
    assert {reason.split(":")[0] for reason in reasons} == {f"Walk.{method}"}


@pytest.mark.slow
def test_metrics_that_fail_are_told_where_all_are_sent() -> None:
    """Stepwise, where a server does not know which of them are wanted."""
    genomes = np.zeros((2, experiment("").genome_size), np.float32)
    one = experiment("measure", mode="stepwise")
    with open_backend(one, servers=1) as backend:
        found = backend.evaluate(
            Controllers.from_genomes(one.representation(), genomes), [0, 1], lambda *_: None
        )
    assert np.isnan(found.fitness).tolist() == [[True, False], [True, False]]
    reasons = {*found.journal.errors}
    assert reasons == {"Walk.measure: {'left': 0} returned, which lacks 'steps'"}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
@pytest.mark.parametrize("servers", ["in-process", 1])
@pytest.mark.parametrize("trouble", ["fork", "fork and raise", "fork and exit"])
def test_a_process_that_the_code_forks_does_not_serve(trouble: str, servers: Any) -> None:
    genomes = np.ones((2, experiment("").genome_size))
    found = evaluate(experiment(trouble), genomes, servers=servers)
    assert found.tolist() == evaluate(experiment(""), genomes, servers="in-process").tolist()


@pytest.mark.slow
@pytest.mark.parametrize("servers", ["in-process", 1])
def test_parameters_that_the_code_refuses(servers: Any) -> None:
    with pytest.raises((RunError, InputError), match="trouble: refused found, expected none"):
        evaluate(
            experiment("refused", timeouts={"discovery": 1}),
            np.zeros((1, experiment("").genome_size)),
            servers=servers,
        )


@pytest.mark.parametrize("seed", [-1, 0.5, math.inf, True, math.nan, 10**400, 2**64])
def test_seeds_that_are_none(seed: float) -> None:
    with pytest.raises(
        _engine.InputError, match=r"seed: .* found, expected an integer from 0 to 2\*\*64 - 1"
    ):
        Host(Walk).reset({"seed": seed})


def test_a_failure_is_reported_once_with_its_traceback() -> None:
    reports: list[tuple[str, str]] = []
    host = Host(Walk, lambda reason, trace: reports.append((reason, trace)))
    for one in (host, host.another()):
        for _ in range(2):
            with pytest.raises(RunError, match="no start"):
                one.reset({"trouble": "reset"})
    ((reason, trace),) = reports
    assert reason.startswith("Walk.reset: LookupError")
    assert trace.splitlines()[0] == "Traceback (most recent call last):"
    assert "_host.py" not in trace
    assert 'raise LookupError("no start")' in trace
    acting, rows, done = host.reset({})  # it goes on
    assert (acting.tolist(), rows.shape, done) == ([0, 1], (2, 2), False)


class Endless(Walk):
    """Its end never comes."""

    most_steps = 20
    turns = False

    def done(self) -> bool:
        return self.trouble == "" and super().done()

    def acting(self) -> Any:
        return [] if self.turns else None


class Waiting(Endless):
    """While nobody acts, either."""

    turns = True


class EndlessTogether(BatchSimulation):
    """One of its episodes has no end."""

    title, dimensions, sensors, actuators, most_steps = "together", 1, 1, 1, 20

    def reset(self, parameters: Any, seeds: Any) -> Any:  # noqa: ARG002
        self.seeds, self.steps = seeds, 0
        return np.zeros((len(seeds), 1, 1))

    def step(self, actions: Any) -> Any:
        self.steps += 1
        return np.zeros(actions.shape)

    def done(self) -> Any:
        return (self.seeds > 0) & (self.steps >= 20)

    def fitness(self) -> Any:
        return np.ones(len(self.seeds))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Endless, Waiting, EndlessTogether])
@pytest.mark.parametrize("mode", ["offloaded", "batched"])
def test_an_episode_without_an_end_fails(kind: Any, mode: str) -> None:
    values: dict[str, Any] = {"simulation": kind, "mode": mode, "method": {"population": 4}}
    if kind is not EndlessTogether:
        values["parameters"] = {"trouble": "endless", "steps": 20}
    one = Experiment.from_mapping(values)
    genomes = np.zeros((1, one.genome_size), np.float32)
    with open_backend(one, servers="in-process" if mode == "offloaded" else 1) as backend:
        found = backend.evaluate(
            Controllers.from_genomes(one.representation(), genomes), [0, 1], lambda *_: None
        )
    assert np.isnan(found.fitness).tolist() == [[True, False]]
    (reason,) = {*found.journal.errors}
    assert reason.startswith(f"{kind.__name__}.done: not true after 20 steps; does it become true? The limit")


def test_the_limit_of_steps_can_be_taken_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Walk, "most_steps", 3)
    with pytest.raises(RunError, match=r"Walk\.done: not true after 3 steps"):
        simulate(experiment(""), servers="in-process")
    monkeypatch.setattr(Walk, "most_steps", None)
    simulate(experiment(""), servers="in-process")
    monkeypatch.setattr(Walk, "most_steps", 0)
    with pytest.raises(InputError, match=r"Walk\.most_steps: 0 found, expected an integer from 1"):
        Host(Walk)


def test_episodes_of_very_many_steps_are_named_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("swarmwright.simulations.host._MANY_STEPS", 5)
    monkeypatch.setattr("swarmwright.common.warn_once._given", set())
    for steps in (5, 8, 9):
        one = Experiment.from_mapping({"simulation": Walk, "parameters": {"trouble": "", "steps": steps}})
        simulate(one, servers="in-process")
        warned = [text for text in caplog.messages if "has not ended after 5 steps" in text]
        assert len(warned) == (steps > 5), "none that ends with that step"
    assert warned[0].startswith("Walk: an episode has not ended after 5 steps; does done() become true?")
    caplog.clear()
    monkeypatch.setattr("swarmwright.common.warn_once._given", set())
    monkeypatch.setattr(Walk, "most_steps", 1_000_000, raising=False)
    simulate(one, servers="in-process")
    assert not caplog.messages, "it is declared"


class OtherArguments(Walk):
    """Its methods take other arguments than they get."""

    def reset(self, parameters: Any) -> Any:  # type: ignore[override]
        return super().reset(parameters, 1)


class NoMethods(Walk):
    """One of its methods is none."""

    done = False  # type: ignore[assignment]


class Needing(Walk):
    """Is made with an argument."""

    def __init__(self, _number: int) -> None: ...


def test_methods_with_other_arguments_are_named_with_what_is_expected() -> None:
    here = r"\(.*test_trouble.py:\d+\)"
    for kind, words in (
        (
            OtherArguments,
            rf"reset: TypeError: .* but 3 were given {here}; expected reset\(self, parameters, seed\)$",
        ),
        (NoMethods, r"done: False is not a method \(.*test_trouble.py\); expected done\(self\)$"),
        (Needing, rf"__init__: TypeError: .*'_number' {here}; expected __init__\(self\)$"),
    ):
        with pytest.raises(RunError, match=rf"^{kind.__name__}.{words}"):
            Host(kind).reset({})


def test_a_type_error_within_a_method_has_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def step(self: Walk, actions: Any) -> Any:  # noqa: ARG001
        return len(None)  # type: ignore[arg-type]

    monkeypatch.setattr(Walk, "step", step)
    with pytest.raises(RunError, match=r"Walk.step: TypeError: .*has no len\(\) \(.*test_trouble.py:\d+\)$"):
        simulate(experiment(""), servers="in-process")


class Inherits(Walk):
    """All of its code is in another file, that of its base class."""


@pytest.mark.parametrize(("trouble", "code"), [("compiled", "scale=-1"), ("numpy", "np.concatenate")])
def test_code_of_a_base_class_has_its_line(trouble: str, code: str) -> None:
    with pytest.raises(RunError, match=rf"Inherits.step: .*troubled.py:{line(code)}\)$"):
        simulate(experiment(trouble, simulation=Inherits), servers="in-process")


def test_ctrl_c_in_a_users_code_ends_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(self: Walk, actions: Any) -> Any:  # noqa: ARG001
        raise KeyboardInterrupt

    monkeypatch.setattr(Walk, "step", interrupt)
    with pytest.raises(KeyboardInterrupt):
        simulate(experiment(""), servers="in-process")


def test_the_engine_steps_nothing_but_hosts() -> None:
    with pytest.raises(AttributeError, match="no attribute"):
        _engine.serve(object(), "mqtt://127.0.0.1:1", id=1)  # type: ignore[arg-type]
