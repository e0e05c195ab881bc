"""Several simulation servers in one episode: a system of their FMUs, in lock-step."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from swarmwright import Experiment
from swarmwright.export.simulation_fmu import LIBRARY, Address, build_model_fmu, proxy_model
from swarmwright.simulations.fmu.instances import FmuError
from swarmwright.simulations.fmu.program import Coupled
from swarmwright.simulations.fmu.ssp import describe, read_system, write_system
from tests.conftest import ROOT
from tests.data.coupled_parts import Battery, Vehicle
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Launch

pytestmark = pytest.mark.skipif(not LIBRARY.exists(), reason="engine/bindings/fmi is not built: make fmi")
SIZE = 0.1
"""Seconds of a step of both."""
PARTS = ROOT / "tests" / "data" / "coupled_parts.py"


@pytest.mark.timeout(200)
def test_steps_are_those_of_the_parts_and_a_lost_server_is_named(
    embedded: BrokerProcess, launch: Launch, tmp_path: Path
) -> None:
    """Jacobi and Gauss-Seidel; both servers are free after each episode; how long each was waited for."""
    files, servers = {}, {}
    for number, kind in enumerate((Battery, Vehicle), 1):
        simulation = f"{PARTS}:{kind.__name__}"
        servers[kind.title] = launch("serve", simulation, "--broker", embedded.url, "--id", number, "--json")
        experiment = Experiment.from_mapping({"simulation": simulation})
        files[kind.title] = tmp_path / f"{kind.title}.fmu"
        model = proxy_model(experiment, Address(embedded.url))
        files[kind.title].write_bytes(build_model_fmu(model, fmi="3.0", name=kind.title))
    for server in servers.values():
        server.until_event("ready", seconds=100)
    force, place, thrust = (
        "battery.agent[1].sensors.sensor_1",
        "vehicle.agent[1].sensors.sensor_1",
        "battery.agent[1].actuators.actuator_1",
    )
    file = tmp_path / "system.ssp"
    file.write_bytes(write_system("system", files, [f"{force}:vehicle.agent[1].actuators.actuator_1"])[0])
    variables = describe(file).variables
    for algorithm in ("jacobi", "gauss_seidel"):
        system = Coupled(str(file), read_system(file), tmp_path / algorithm, algorithm)
        system.begin({}, 0.0, 100.0)
        battery, vehicle = Battery(), Vehicle()
        battery.reset({}, 0)
        vehicle.reset({}, 0)
        for step in range(8):
            before = battery.force
            battery.step(np.array([[0.75]], np.float32))
            used = before if algorithm == "jacobi" else battery.force
            vehicle.step(np.array([[used]], np.float32))
            system.put([variables[thrust]], [0.75])
            system.step(step * SIZE, SIZE)
            assert system.numbers([variables[force], variables[place]]) == [battery.force, vehicle.place]
        assert battery.left < 0
        assert "battery" in system.waiting_times
        assert "vehicle" in system.waiting_times
        if algorithm == "jacobi":
            system.give_up()
    os.kill(int(servers["vehicle"].events("ready")[0]["pid"]), signal.SIGKILL)
    with pytest.raises(FmuError, match=r"vehicle: .*server 2 was lost after step \d"):
        system.step(8 * SIZE, SIZE)
    system.give_up()
    with pytest.raises(FmuError, match=r'vehicle: .*no free server on .* offers "vehicle"'):
        system.begin({"vehicle.connection.discoveryTimeout": 0.5}, 0.0, 100.0)
    system.end()
