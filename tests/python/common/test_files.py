"""Files that a person or an experiment names: only regular ones, of a size that can be meant."""

import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmwright import Controller, Experiment, InputError, frevo, sweep
from swarmwright.common import yaml
from swarmwright.common.files import read_bytes, suggest_file, write_whole
from swarmwright.servers.broker.mosquitto import set_password

Read = Callable[[Path], object]
Named = Callable[[Path, Path], Path]

READERS: dict[str, Read] = {
    "experiment": Experiment.load,
    "sweep": lambda path: sweep(path, out=path.parent / "out"),
    "controller": Controller.load,
    "session": frevo.load,
    "result": frevo.score,
    "field": lambda path: Experiment.from_mapping(
        {"simulation": "emergency_exit", "parameters": {"field": str(path)}}
    ),
    "start_from": lambda path: Experiment.from_mapping({"simulation": "minisim", "start_from": str(path)}),
    "password file": lambda path: set_password(path, "somebody", "secret"),
}


@pytest.fixture(params=["a pipe", "a device", "a socket"])
def odd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """What is no regular file: reading it would wait for ever, or never end."""
    kind: str = request.param
    path = tmp_path / "odd"
    with socket.socket(socket.AF_UNIX) as listening:
        if kind == "a pipe":
            os.mkfifo(path)
        elif kind == "a device":
            path.symlink_to("/dev/zero")
        else:
            listening.bind(str(path))
        yield path, kind


@pytest.mark.timeout(20)
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused(reader: str, odd: tuple[Path, str]) -> None:
    path, kind = odd
    with pytest.raises(InputError, match=f"odd: is {kind}; expected a file"):
        READERS[reader](path)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("reader", [name for name in READERS if name != "password file"])
def test_a_file_that_is_too_large_is_not_read(reader: str, tmp_path: Path) -> None:
    path = tmp_path / "large"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # takes no room on the disk
    with pytest.raises(InputError, match=r"large: is larger than \d+ MiB"):
        READERS[reader](path)


@pytest.mark.timeout(20)
def test_a_java_object_that_is_no_file(odd: tuple[Path, str], tmp_path: Path) -> None:
    path, kind = odd
    session = Path(__file__).parents[2] / "data" / "frevo" / "emergency_exit_stadium.zse"
    field = tmp_path / "Stadium.ser"
    path.rename(field)
    with pytest.raises(InputError, match=f"is {kind}; expected a file"):
        frevo.load(session, field=field)


@pytest.mark.slow
def test_a_program_says_so(odd: tuple[Path, str], program: Any) -> None:
    path, kind = odd
    for command in ("optimize", "simulate", "sweep", "import", "score"):
        refused = program(command, path)
        said = f"swarmwright: {path}: is {kind}; expected a file\n"
        assert (refused.returncode, refused.stderr) == (2, said)


def test_as_much_is_read_as_there_may_be(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(bytes(1 << 20))
    assert read_bytes(path, 1 << 20) == bytes(1 << 20)
    path.write_bytes(bytes((1 << 20) + 1))
    with pytest.raises(InputError, match="larger than 1 MiB"):
        read_bytes(path, 1 << 20)
    assert read_bytes(Path("/proc/self/cmdline"), 1 << 20), "which says of itself that it is empty"
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path, 1)
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "nothing", 1)


def test_values_of_a_yaml_file_are_counted_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    composed = []
    compose = yaml._Composer.compose_node

    def counted(self: Any, *place: Any) -> Any:
        composed.append(place)
        return compose(self, *place)

    monkeypatch.setattr(yaml._Composer, "compose_node", counted)
    monkeypatch.setattr(yaml, "_MOST_VALUES", 100)
    (tmp_path / "x.yaml").write_text("a: [" + "1," * 10_000 + "]\n")
    with pytest.raises(InputError, match=r"x\.yaml: .*more than 100 values"):
        yaml.read(tmp_path / "x.yaml")
    assert len(composed) < 300


def test_a_file_that_cannot_be_written_as_a_whole_stays_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "fitness.png"
    write_whole(file, b"first")

    def full(path: Path, _: bytes) -> int:
        path.touch()
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match="No space"):
            write_whole(file, b"second")
    assert (file.read_bytes(), list(tmp_path.iterdir())) == (b"first", [file])
    link = tmp_path / "link.png"
    link.symlink_to(file)
    write_whole(link, b"third")
    assert (file.read_bytes(), link.is_symlink()) == (b"third", True)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("mision.yaml", "; did you mean 'mission.yml'?"),
        ("robto.json", "; did you mean 'robot.json'?"),
        ("mission.json", ""),
        ("motion.yaml", "; did you mean 'mission.yml'?"),
        ("none.json", ""),
        ("nowhere/mission.yml", ""),
    ],
)
def test_the_nearest_file_of_the_same_kind(name: str, found: str, tmp_path: Path) -> None:
    for one in ("mission.yml", "robot.json", "mision"):
        (tmp_path / one).touch()
    assert suggest_file(tmp_path / name) == found
