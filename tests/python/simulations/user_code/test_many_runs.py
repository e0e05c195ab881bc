"""Runs of different code are kept apart where several are looked at."""

from pathlib import Path

import pytest

from swarmwright import InputError, Run, RunError, compare, optimize
from swarmwright.analysis.sweep import Executor, Sweep, list_tasks
from swarmwright.servers.supervision.local_servers import LocalServers
from swarmwright.simulations.user_code.changes import list_files
from tests.python.simulations.user_code.conftest import edit

pytestmark = pytest.mark.slow


def test_a_sweep_is_of_one_code(project: Path) -> None:
    (project / "sweep.yaml").write_text(
        "experiment: gather.yaml\ngrid: {method.population: [4]}\nseeds: 2\nout: out\n"
    )
    sweep = Sweep.load("sweep.yaml")
    first, second = list_tasks(sweep)
    with Executor(sweep) as executor:
        executor.run(first)
        assert first.open_run() is not None
        edit(project / "helper.py", "0.1", "0.25")
        with pytest.raises(InputError, match=r"helper\.py was edited(.|\n)*Runs of different code"):
            executor.run(first)
        edit(project / "helper.py", "0.25", "0.1")
        assert executor.run(first).state == "done"
        assert executor.run(second).state == "done"


def test_runs_of_different_code_are_no_group(project: Path) -> None:
    runs = [optimize("gather.yaml", seed=seed, out=project / f"old-{seed}") for seed in (1, 2)]
    assert len(compare(runs).groups) == 1
    edit(project / "helper.py", "0.1", "0.25")
    runs += [optimize("gather.yaml", seed=seed, out=project / f"new-{seed}") for seed in (1, 2)]
    groups = compare([Run.open(run.path) for run in runs], order="given")
    assert [[run.path.name for run in one.runs] for one in groups.groups] == [
        ["old-1", "old-2"],
        ["new-1", "new-2"],
    ]
    assert all(one.label.startswith("code ") for one in groups.groups)
    assert any("different code" in line for line in groups.notes)


def test_servers_of_a_run_have_one_code(project: Path, embedded_broker: str) -> None:
    name = f"{project}/gather.py:Gather"
    settings = {"simulation": name, "broker": embedded_broker, "prefix": "", "step_timeout": 5.0}
    files = list_files(name)
    assert sorted(map(Path, files)) == [project / "gather.py", project / "helper.py"]
    with LocalServers([{**settings, "id": 1, "files": files}]) as servers:
        assert len(servers.pids) == 1
        edit(project / "helper.py", "0.1", "0.25")
        with (
            pytest.raises(RunError, match=r"helper\.py: was edited since this run was started"),
            LocalServers([{**settings, "id": 2, "files": files}]),
        ):
            pytest.fail("started with other code")
