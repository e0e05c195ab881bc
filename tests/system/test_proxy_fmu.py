"""FMUs of simulation servers: FMPy drives servers in several languages, with the bits of the engine."""

import signal
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

from swarmwright import Experiment, InputError, _engine, optimize
from swarmwright.export.simulation_fmu import LIBRARY, Address, build_model_fmu, proxy_model
from tests.conftest import ROOT, free_port
from tests.fmus import Driven, driving
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Launch, Serve, ServeCpp
from tests.system.plain_server import MeasuringServer, PlainServer

pytestmark = pytest.mark.skipif(not LIBRARY.exists(), reason="engine/bindings/fmi is not built: make fmi")

PARAMETERS = {"numAgents": 3, "placement": "random", "speedDefenders": 0.4}
PYTHON = ROOT / "tests" / "python" / "simulations" / "minisim.py"
Proxy = Callable[..., Driven]


@pytest.fixture
def proxy(tmp_path: Path, cleanup: ExitStack) -> Proxy:
    """Exports the FMU of a server of Minisim, or of another simulation, and drives it."""

    def drive(url: str, fmi: str = "2.0", agents: int | None = None, **experiment: Any) -> Driven:
        experiment = {"simulation": "minisim", "parameters": PARAMETERS, **experiment}
        model = proxy_model(Experiment.from_mapping(experiment), Address(url), agents)
        file = tmp_path / f"server{len(list(tmp_path.glob('*.fmu')))}.fmu"
        file.write_bytes(build_model_fmu(model, fmi=fmi, name="server"))
        assert validate_fmu(str(file)) == []
        return cleanup.enter_context(driving(file))

    return drive


def play(world: Driven, seed: int) -> None:
    """An episode of Minisim: sensors, who acts, fitness and metrics are those of the engine, to the bit."""
    sensors, actuators = (
        [name.removeprefix("agent[1].") for name in world.references if name.startswith(f"agent[1].{one}s")]
        for one in ("sensor", "actuator")
    )
    world.begin(seed)
    episode = _engine.Episodes("minisim", PARAMETERS, [seed])
    random, made = np.random.default_rng(seed), 0
    while not episode.done:
        assert not world.flag("done")
        _, agents, sensed = episode.acting()
        acts = [agent for agent in range(3) if world.flag(f"agent[{agent + 1}].acts")]
        assert acts == list(agents)
        for agent, row in zip(agents, sensed, strict=True):
            found = world.singles([f"agent[{agent + 1}].{name}" for name in sensors])
            assert np.array_equal(np.array(found, np.float32), row)
        moves = random.uniform(-1, 1, (len(agents), 1)).astype(np.float32)
        for agent, row in zip(agents, moves, strict=True):
            world.put([f"agent[{agent + 1}].{actuators[0]}"], [float(row[0])])
        episode.step(moves)
        world.step(made)
        made += 1
    assert world.flag("done")
    assert world.double("fitness") == episode.fitness()[0]
    names = [name.removeprefix("metrics.") for name in world.references if name.startswith("metrics.")]
    metrics = [world.double(f"metrics.{name}") for name in names]
    assert np.array_equal(metrics, episode.metrics(names)[0])
    world.step(made)  # nothing changes
    assert world.double("fitness") == episode.fitness()[0]
    world.fmu.reset()


def refused(call: Callable[[], Any], world: Driven) -> str:
    """What the FMU says to a call that it reports as an error."""
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status == 3
    return world.said[-1]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_engines_server_has_the_bits_of_the_engine(
    broker: BrokerProcess, serve: Serve, proxy: Proxy, fmi: str
) -> None:
    """Through either broker, episode after episode."""
    serve(broker.url)
    world = proxy(broker.url, fmi)
    for seed in range(5):
        play(world, seed)


def test_a_server_in_cpp(embedded: BrokerProcess, serve_cpp: ServeCpp, proxy: Proxy) -> None:
    serve_cpp(embedded.url)
    world = proxy(embedded.url)
    for seed in (5, 6):
        play(world, seed)


@pytest.mark.journey
def test_a_server_in_python(embedded: BrokerProcess, launch: Launch, proxy: Proxy) -> None:
    server = launch("serve", f"{PYTHON}:Minisim", "--broker", embedded.url, "--json")
    server.until_event("ready", seconds=60)
    world = proxy(embedded.url, "3.0", simulation=f"{PYTHON}:Minisim")
    for seed in (5, 6):
        play(world, seed)


@pytest.mark.parametrize("kind_of_server", [PlainServer, MeasuringServer])
def test_a_server_that_implements_d61_alone(
    embedded: BrokerProcess, connect: Any, proxy: Proxy, kind_of_server: type[PlainServer]
) -> None:
    """No message says how many agents act: those that have arrived are missed after a time of silence."""
    server = connect(kind_of_server, embedded.url)
    world = proxy(
        embedded.url,
        agents=3,
        simulation="toy",
        requirements={"dimensions": 1},
        sensors=2,
        actuators=1,
        parameters={"starts": [3.0, -2.0, 1.0], "steps": 6},
    )
    for episode in range(2):
        world.text("starts", "[3.0, -2.0, 1.5]")
        world.begin(0)
        acted, made = [], 0
        while not world.flag("done"):
            acted.append([agent for agent in (1, 2, 3) if world.flag(f"agent[{agent}].acts")])
            for agent in acted[-1]:
                place = world.singles([f"agent[{agent}].sensors.sensor_1"])[0] * 10
                world.put([f"agent[{agent}].actuators.actuator_1"], [-1.0 if place > 0 else 1.0])
            world.step(made)
            made += 1
        assert acted == [[1, 2, 3], [1, 2], [1]]
        assert world.double("fitness") == -0.5
        assert server.episodes == episode + 1
        world.fmu.reset()


def test_instances_use_servers_of_their_own_and_let_them_go(
    embedded: BrokerProcess, serve: Serve, proxy: Proxy
) -> None:
    servers = serve(embedded.url, count=2)
    worlds = [proxy(embedded.url) for _ in range(3)]
    for world in worlds[:2]:
        world.begin(1)
    worlds[2].number("connection.discoveryTimeout", 1.5)
    said = refused(lambda: worlds[2].begin(1), worlds[2])
    assert "no free server on" in said
    assert "server 1 is used by fmu@" in said
    assert "server 2 is used by fmu@" in said
    worlds[0].fmu.reset()
    worlds[2].fmu.reset()
    worlds[2].number("connection.discoveryTimeout", 60.0)
    play(worlds[2], 3)
    worlds[1].fmu.terminate()
    worlds[0].integer("connection.server", 2)
    play(worlds[0], 4)
    assert not servers.warnings()


def test_attached_back_it_gives_the_record_of_minisim(
    embedded: BrokerProcess, serve: Serve, tmp_path: Path
) -> None:
    serve(embedded.url)
    experiment = Experiment.from_mapping({"simulation": "minisim", "parameters": PARAMETERS})
    file = tmp_path / "server.fmu"
    file.write_bytes(
        build_model_fmu(proxy_model(experiment, Address(embedded.url)), fmi="2.0", name="server")
    )
    records = []
    for simulation, parameters in (("minisim", PARAMETERS), (str(file), {})):
        run = optimize(
            Experiment.from_mapping(
                {
                    "simulation": simulation,
                    "parameters": {**parameters, "maxSteps": 9, "seed": 4},
                    "method": {"kind": "nnga", "population": 4, "generations": 2},
                    "controller": {"kind": "fully_meshed", "hidden": 2},
                    "ranking": {"episodes": 2},
                    "fitness": "fitness + arrived - 0.1 * distance - 0.01 * steps",
                    "servers": "in-process",
                }
            ),
            out=tmp_path / Path(simulation).stem,
        )
        records.append(
            [np.array(one) for one in (run.record.fitness, run.record.metrics, run.record.genomes)]
        )
    assert all(np.array_equal(one, other) for one, other in zip(*records, strict=True))


def test_a_server_that_is_killed_in_mid_episode(broker: BrokerProcess, serve: Serve, proxy: Proxy) -> None:
    servers = serve(broker.url)
    world = proxy(broker.url)
    world.begin(1)
    world.step(0)
    servers.signal_server(1, signal.SIGKILL)
    begin = time.monotonic()
    assert refused(lambda: world.step(1), world) == "server 1 was lost after step 1"
    assert "reset the FMU for another episode" in refused(lambda: world.step(1), world)
    assert time.monotonic() - begin < 20  # long before connection.stepTimeout
    world.fmu.reset()
    serve(broker.url, first=7)
    play(world, 2)


def test_a_server_that_is_silent_and_a_broker_that_goes(
    embedded: BrokerProcess, serve: Serve, proxy: Proxy
) -> None:
    servers = serve(embedded.url)
    world = proxy(embedded.url, "3.0")
    world.number("connection.stepTimeout", 0.5)
    world.begin(1)
    servers.signal_server(1, signal.SIGSTOP)
    assert refused(lambda: world.step(0), world) == (
        "server 1 sent nothing for 0.5 s after step 0 (connection.stepTimeout)"
    )
    servers.signal_server(1, signal.SIGCONT)
    world.fmu.reset()
    play(world, 5)

    world.number("connection.stepTimeout", 60.0)
    world.begin(1)
    embedded.kill()
    assert "the connection to the broker at" in refused(lambda: world.step(0), world)
    world.fmu.reset()
    assert "no broker answers at" in refused(lambda: world.begin(1), world)


def test_mistakes_are_explained(embedded: BrokerProcess, serve: Serve, proxy: Proxy, tmp_path: Path) -> None:
    serve(embedded.url)
    world = proxy(embedded.url, "3.0")
    world.number("connection.discoveryTimeout", 0.5)
    (tmp_path / "password").write_text("secret\n")
    for name, value, expected in (
        ("connection.broker", f"mqtt://127.0.0.1:{free_port()}", "no broker answers at"),
        ("connection.broker", "http://localhost", "connection.broker: broker URL"),
        ("connection.broker", "", "connection.broker is empty"),
        ("connection.prefix", "lab/#", "connection.prefix: topic prefix"),
        ("connection.prefix", "elsewhere", "no Swarmwright server is connected"),
        ("connection.simulation", "maxisim", "server 1 offers minisim"),
        ("connection.passwordFile", "/no/such/file", "connection.passwordFile: /no/such/file: No such file"),
        ("connection.passwordFile", str(tmp_path / "password"), "connection.username is empty"),
        ("placement", "nowhere", "parameter placement"),
    ):
        world.text(name, value)
        assert expected in refused(lambda: world.begin(1), world)
        world.fmu.reset()
        world.number("connection.discoveryTimeout", 0.5)
    world.integer("connection.server", 9)
    assert "server 9 on" in refused(lambda: world.begin(1), world)
    world.fmu.reset()
    world.number("connection.stepTimeout", -1.0)
    assert "connection.stepTimeout: -1 found" in refused(lambda: world.begin(1), world)
    world.fmu.reset()
    world.integer("numAgents", 4)
    assert "agent 3 (counted from 0), but the FMU has variables for 3 agents" in refused(
        lambda: world.begin(1), world
    )
    world.fmu.reset()
    assert "states cannot be saved" in refused(world.fmu.getFMUState, world)
    play(world, 1)

    other = proxy(embedded.url, agents=1, simulation="toy", requirements={"dimensions": 2}, sensors=2,
                  actuators=1, parameters={})  # fmt: skip
    other.text("connection.simulation", "minisim")
    assert "server 1 offers 4 sensors per agent, but the FMU has variables for 2" in refused(
        lambda: other.begin(1), other
    )


def test_accounts(tmp_path: Path, cleanup: ExitStack, proxy: Proxy) -> None:
    """The password is read from a file when the episode begins, and is not in the FMU."""
    broker = BrokerProcess("embedded", tmp_path / "broker", {"me": "secret"})
    cleanup.callback(broker.stop)
    broker.start()
    world = proxy(broker.url)
    assert "refuses a client without a user name" in refused(lambda: world.begin(1), world)
    (tmp_path / "password").write_text("secret\n")
    world.fmu.reset()
    world.text("connection.username", "me")
    world.text("connection.passwordFile", str(tmp_path / "password"))
    world.number("connection.discoveryTimeout", 0.5)
    assert "no Swarmwright server is connected" in refused(lambda: world.begin(1), world)


def test_what_a_server_offers_is_asked_for_or_said(embedded: BrokerProcess) -> None:
    experiment = Experiment.from_mapping({"simulation": "toy", "requirements": {"dimensions": 1}})
    with pytest.raises(InputError, match="the number of sensors is unknown, because 'toy' is not"):
        proxy_model(experiment, Address(embedded.url), 1)
    said = experiment.with_settings(["sensors=2", "actuators=1"])
    with pytest.raises(InputError, match="number of agents of 'toy' is unknown; set it with --agents"):
        proxy_model(said, Address(embedded.url))
