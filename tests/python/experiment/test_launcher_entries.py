"""What experiments and the command line say about launchers."""

from pathlib import Path
from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.servers.evaluation.base import resolve_servers
from swarmwright.servers.launchers import LAUNCHERS
from swarmwright.servers.launchers.process import ProcessOptions


def loaded(servers: Any) -> Experiment:
    return Experiment.from_mapping({"simulation": "minisim", "servers": servers})


def test_a_mapping_a_list_and_a_text_mean_the_same() -> None:
    expected = (ProcessOptions(count=3),)
    assert loaded({"launcher": "process", "count": 3}).servers == expected
    assert loaded([{"launcher": "process", "count": 3}]).servers == expected
    assert loaded("process:3").servers == expected
    assert loaded(["process:3"]).servers == expected


def test_an_experiment_is_written_and_read_again(tmp_path: Path) -> None:
    made = loaded({"launcher": "process", "count": 3, "environment": {"OMP_NUM_THREADS": "1"}})
    made.save(tmp_path / "experiment.yaml")
    assert Experiment.load(tmp_path / "experiment.yaml") == made


def test_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    file = tmp_path / "lab" / "experiment.yaml"
    file.parent.mkdir()
    file.write_text("simulation: minisim\nservers: {launcher: process, credentials: server.env}\n")
    servers = Experiment.load(file).servers
    assert isinstance(servers, tuple)
    assert servers[0].credentials == str(tmp_path / "lab" / "server.env")


def test_the_number_on_the_command_line_keeps_other_options() -> None:
    made = loaded({"launcher": "process", "count": 3, "start_timeout": 7.0})
    assert resolve_servers(made, "process:5") == (ProcessOptions(count=5, start_timeout=7.0),)
    assert resolve_servers(made, "process:2..9") == (ProcessOptions(min=2, max=9, start_timeout=7.0),)
    assert resolve_servers(made, None) == made.servers
    assert resolve_servers(made, 4) == 4


def test_another_launcher_on_the_command_line_keeps_the_files_of_the_simulation() -> None:
    made = loaded({"launcher": "ssh", "hosts": ["one"], "files": ["maps/*.json"]})
    assert resolve_servers(made, "process:5") == (ProcessOptions(count=5, files=["maps/*.json"]),)
    assert resolve_servers(made, {"launcher": "process", "files": []}) == (ProcessOptions(files=[]),)
    there = {"launcher": "process", "code": "/code"}
    assert resolve_servers(made, there) == (ProcessOptions(code="/code"),)
    assert resolve_servers(made, "local") == "local"


@pytest.mark.parametrize(
    ("servers", "message"),
    [
        ({"launcher": "proces"}, "servers.launcher: unknown launcher 'proces'; did you mean 'process'?"),
        ({"count": 3}, "servers.launcher: is missing; available: "),
        ({"launcher": "process", "cuont": 3}, "servers.cuont: unknown key; did you mean 'count'?"),
        ({"launcher": "process", "count": 0}, "servers.count: must be at least 1, not 0"),
        ({"launcher": "process", "count": "3"}, "servers.count: must be an integer, not '3'"),
        (
            [{"launcher": "process"}, 3],
            r"servers[1]: must be a launcher, such as {launcher: slurm, count: 4}",
        ),
        (["process:1", "process:2"], "servers: has two entries for process"),
        ({"launcher": "process", "min": 3, "max": 2}, "servers.min: 3 exceeds max: 2"),
        ({"launcher": "process", "min": 3}, "servers: min needs max"),
        ({"launcher": "process", "count": 3, "max": 9}, "servers: give either count, or min and max"),
        ({"launcher": "process", "budget": 9.0}, "servers: budget needs cost_per_hour"),
        ("process:1,process:2", "servers: has two entries for process"),
        ("process:3..2", "servers: process:3..2: min: 3 exceeds max: 2"),
        ([], "servers: must have a launcher"),
        (
            "process:many",
            "servers: must be a launcher with a number of servers, such as slurm:4 or slurm:4..200",
        ),
        ("sevral", "servers: must be auto, local, in-process, a number of servers or a launcher"),
    ],
)
def test_mistakes_are_explained(servers: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        loaded(servers)
    assert str(caught.value).startswith(message)


def test_a_launcher_without_a_number_is_known_from_the_experiment() -> None:
    experiment = loaded({"launcher": "process", "count": 3})
    with pytest.raises(InputError, match=r"not 'process'; leave it out to start those of the experiment$"):
        resolve_servers(experiment, "process")


@pytest.mark.parametrize(
    ("servers", "message"),
    [
        ("foo", "servers: must be auto, local, in-process, a number, or a launcher with a number of servers"),
        ("locl", "servers: must be auto, local, in-process, a number, or a launcher"),
        ("process:2,foo", "servers: must be a launcher with a number of servers"),
    ],
)
def test_mistakes_in_arguments_are_explained(servers: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        resolve_servers(Experiment.from_mapping({"simulation": "minisim"}), servers)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("servers", ["process:0", "process:3..2"])
def test_a_wrong_number_is_corrected_where_it_is(servers: str) -> None:
    with pytest.raises(InputError) as caught:
        resolve_servers(Experiment.from_mapping({"simulation": "minisim"}), servers)
    assert "in the experiment" not in str(caught.value)


def test_the_schema_knows_every_launcher() -> None:
    schema = Experiment.json_schema()
    for kind in LAUNCHERS.names():
        variant = schema["$defs"][f"Launcher{kind}"]
        assert variant["properties"]["launcher"]["const"] == kind
        assert all("description" in one for name, one in variant["properties"].items() if name != "launcher")


def test_a_wrong_number_of_servers_suggests_no_launcher() -> None:
    with pytest.raises(InputError) as caught:
        loaded("process:-3")
    assert "did you mean" not in str(caught.value)
