"""Values between Python and the engine: their types, their bits, and what is refused."""

import threading
from types import UnionType
from typing import Any, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

import numpy as np
import pytest

from swarmwright import Experiment, InputError, _engine, evaluate, optimize
from swarmwright.common import engine_types
from swarmwright.common.random_numbers import Stream
from swarmwright.experiment.document import Faults, Timeouts
from swarmwright.servers.evaluation import reports
from swarmwright.servers.rows import Attempt, AttemptEntry
from swarmwright.servers.supervision.local_servers import LocalServers

POOL: dict[str, Any] = {"simulation": "minisim", "parameters": {}, "requirements": {"dimensions": 2}}
NOWHERE = "mqtt://127.0.0.1:1"


def fits(value: Any, expected: Any) -> bool:
    """Whether a value is what a type says, to the last key: int is not float here, and bool is not int."""
    origin, arguments = get_origin(expected), get_args(expected)
    if expected is Any:
        return True
    if is_typeddict(expected):
        hints = get_type_hints(expected)
        required = expected.__required_keys__
        return (
            type(value) is dict
            and required <= value.keys() <= hints.keys()
            and all(fits(one, hints[key]) for key, one in value.items())
        )
    if origin in (Union, UnionType):
        return any(fits(value, one) for one in arguments)
    if origin is NotRequired:
        return fits(value, arguments[0])
    if origin is list:
        return type(value) is list and all(fits(one, arguments[0]) for one in value)
    if origin is tuple:
        return type(value) is tuple and len(value) == len(arguments) and all(map(fits, value, arguments))
    if origin is dict:
        return type(value) is dict and all(fits(one, arguments[1]) for one in value.values())
    if origin is not None:  # Literal
        return value in arguments
    return type(value) is expected


def test_what_fits_a_type() -> None:
    report = {"event": "server", "server": 1, "state": "left"}
    assert fits(report, engine_types.Report)
    for wrong in ({**report, "server": 1.0}, {**report, "more": 1}, {"event": "server", "server": 1}):
        assert not fits(wrong, engine_types.Report)


@pytest.mark.slow
def test_reports_counts_and_attempts_have_their_types(embedded_broker: str) -> None:
    told: list[Any] = []
    settings = {"simulation": "minisim", "broker": embedded_broker, "prefix": "", "step_timeout": 5.0}
    experiment = Experiment.from_mapping({"simulation": "minisim"})
    representation = experiment.representation()
    genomes = np.stack([representation.initial(Stream(1, "test", 0, index)) for index in range(8)])
    for mode in ("stepwise", "offloaded"):
        with LocalServers([{**settings, "id": 2**31 - 2}]):
            pool = _engine.Pool(embedded_broker, **POOL, mode=mode, timeouts={"discovery": 5.0})
            try:
                pool.listen(told.append)
                pool.wait_for_server()
                _, _, attempts, warnings = pool.evaluate(
                    representation.architecture(), representation.weights(genomes), [0]
                )
                assert fits(pool.counts(), engine_types.Counts)
            finally:
                pool.close()
        assert fits(attempts, list[engine_types.AttemptFields])
        assert {row["server"] for row in attempts} == {2**31 - 2}
        assert {row["mode"] for row in attempts} == {mode}
        assert all((row["steps"] is not None) == (mode == "stepwise") for row in attempts)
        assert warnings == []
    assert {report["event"] for report in told} >= {"server", "attempt", "status"}
    assert [report for report in told if not fits(report, engine_types.Report)] == []


def test_an_attempt_has_the_columns_of_the_store() -> None:
    columns = [name for name in Attempt.__dataclass_fields__ if name not in {"session", "generation"}]
    assert list(AttemptEntry._fields) == columns
    hints = get_type_hints(AttemptEntry)
    assert hints == get_type_hints(engine_types.AttemptFields)


@pytest.mark.slow
def test_presences_and_news_have_their_types(any_broker: str) -> None:
    settings = {"simulation": "minisim", "broker": any_broker, "id": 3, "prefix": "", "step_timeout": 5.0}
    experiment = Experiment.from_mapping({"simulation": "minisim", "broker": any_broker})
    watcher = _engine.Watcher(any_broker)
    try:
        with LocalServers([settings]):
            (server,) = _engine.servers(any_broker, wait=0.3)
            assert fits(server, engine_types.Presence)
            assert (server["server"], server["state"], server["simulations"]) == (3, "ready", ["minisim"])
            evaluate(experiment, np.zeros((1, experiment.genome_size)))
        news: list[Any] = []
        while not any("left" in one for one in news):
            more = watcher.poll(5.0)
            assert more
            news += more
    finally:
        watcher.close()
    assert [one for one in news if not fits(one, engine_types.News)] == []
    assert {key for one in news for key in one} >= {"presence", "left", "status", "token"}


def test_notices_of_a_server_have_their_types(embedded_broker: str) -> None:
    events: list[Any] = []
    ready = threading.Event()

    def take(event: Any) -> None:
        events.append(event)
        ready.set()
        raise InterruptedError  # ends the server

    def serve() -> None:
        with pytest.raises(InterruptedError):
            _engine.serve("minisim", embedded_broker, id=5, display=False, alone=True, on_event=take)

    thread = threading.Thread(target=serve)
    thread.start()
    thread.join(10)
    assert ready.is_set()
    assert events == [{"event": "ready", "server": 5}]
    assert fits(events[0], engine_types.ServerEvent)


@pytest.mark.parametrize("title", _engine.simulations())
def test_descriptions_and_scenes_have_their_types(title: str) -> None:
    described = _engine.describe(title)
    assert fits(described, engine_types.Description)
    described["metrics"].clear()
    assert _engine.describe(title)["metrics"], "each caller has a description of its own"
    experiment = Experiment.from_mapping({"simulation": title})
    representation = experiment.representation()
    specification = representation.specification(representation.initial(Stream(1, "test")))
    from swarmwright import Controller

    episode = _engine.Episode(title, experiment.parameters, Controller(specification).json)
    assert fits(episode.scene(), engine_types.SceneFields)


def test_the_engines_defaults_are_those_of_an_experiment() -> None:
    assert Timeouts().model_dump() == _engine.TIMEOUTS
    assert Faults().to_engine_values() == _engine.FAULTS


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"timeouts": {"step": 0}}, r"timeouts\.step: must be larger than 0 seconds"),
        ({"timeouts": {"least": -1.5}}, r"timeouts\.least: must be a duration in seconds, not -1\.5"),
        (
            {"timeouts": {"discovery": "long"}},
            r"timeouts\.discovery: \"long\" \(a string\) found, expected a number",
        ),
        ({"timeouts": {"pause": 1}}, r"timeouts\.pause: unknown field `pause`, expected one of `connect`"),
        ({"faults": {"attempts": 0}}, r"faults\.attempts: must be at least 1"),
        ({"faults": {"audit": 2}}, r"faults\.audit: must be a share from 0 to 1, not 2"),
        ({"faults": {"backup": 1}}, r"faults\.backup: 1 found, expected true or false"),
        ({"requirements": {}}, r"requirements: .*dimensions"),
        (
            {"parameters": {"a": [0, {"b": float("nan")}]}},
            r"parameters\.a\[1\]\.b: NaN found, expected a ",
        ),
        ({"parameters": {"a": {1, 2}}}, r"parameters\.a: a set found, expected text, a number"),
        ({"parameters": {"a": "\ud800"}}, r"parameters\.a: text that cannot be encoded as UTF-8"),
    ],
)
def test_wrong_values_are_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(_engine.InputError, match=message):
        _engine.Pool(NOWHERE, **{**POOL, **arguments})


def test_values_nested_too_deeply_are_refused() -> None:
    endless: dict[str, Any] = {}
    endless["again"] = endless
    with pytest.raises(_engine.InputError, match="is nested too deeply"):
        _engine.parameter_mistakes("minisim", endless)


def test_parameters_arrive_as_they_are() -> None:
    """As they come out of JSON: tuples are lists, numbers that no integer of 64 bits holds are floats."""
    from swarmwright.simulations.host import Host
    from tests.python.simulations.troubled import Walk

    seen: list[dict[str, Any]] = []

    class Recording(Host):
        def reset(self, parameters: dict[str, Any], controller: str | None = None) -> Any:
            seen.append(parameters)
            return super().reset({}, controller)

    given = {
        "whole": 2**53 + 1,
        "largest": 2**64 - 1,
        "least": -(2**63),
        "beyond": 2**64,
        "float": 0.1,
        "one": 1.0,
        "tiny": 5e-324,
        "zero": -0.0,
        "flag": True,
        "none": None,
        "text": "ä\u2028\x00",
        "items": (1, [2.5, {}]),
        "nested": {1: "a", None: "b", False: "c"},
        "array": np.float64(0.25),
    }
    controller = Experiment.from_mapping({"simulation": Walk}).representation()
    genomes = np.zeros((1, controller.genome_size), np.float32)
    weights = controller.weights(genomes)
    _engine.evaluate_host(Recording(Walk), given, controller.architecture(), weights, [2**64 - 1])
    (found,) = seen
    expected = {
        **given,
        "beyond": float(2**64),
        "items": [1, [2.5, {}]],
        "nested": {"1": "a", "null": "b", "false": "c"},
        "array": 0.25,
        "seed": 2**64 - 1,
    }
    assert found == expected
    assert {key: type(value) for key, value in found.items()} == {
        key: type(value) for key, value in expected.items()
    }
    assert str(found["zero"]) == "-0.0"


@pytest.mark.slow
def test_what_listens_gets_dicts(tmp_path: Any) -> None:
    """From the pool to the listeners of a run, as logs and figures get them."""
    told: list[Any] = []
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "servers": 1, "method": {"population": 6, "generations": 2}}
    )
    with reports.listening(told.append):
        optimize(experiment, out=tmp_path / "run")
    assert told
    assert all(fits(report, engine_types.Report) for report in told)
    with pytest.raises(InputError, match="broker"):
        evaluate(experiment, np.zeros((1, experiment.genome_size)), broker="nowhere://x")


def test_a_server_waits_as_long_by_default_as_a_tool() -> None:
    from swarmwright.cli.serve import command

    (option,) = (one for one in command.params if one.name == "step_timeout")
    assert option.default == _engine.TIMEOUTS["step"]
