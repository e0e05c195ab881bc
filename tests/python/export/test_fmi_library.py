"""The library of FMUs, which a checkout compiles when it is first needed: by a real make with small rules."""

import logging
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.common.errors import RunError
from swarmwright.export import simulation_fmu


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the source, where the library has not been compiled."""
    (tmp_path / "engine" / "bindings" / "fmi").mkdir(parents=True)
    (tmp_path / "engine" / "bindings" / "fmi" / "Cargo.toml").touch()
    monkeypatch.setattr(simulation_fmu, "_CHECKOUT", tmp_path)
    monkeypatch.setattr(simulation_fmu, "FILE", tmp_path / "fmi.so")
    return tmp_path


@pytest.mark.slow
def test_it_is_compiled_once_and_announced(checkout: Path, caplog: pytest.LogCaptureFixture) -> None:
    (checkout / "Makefile").write_text("fmi:\n\t@echo $(MAKELEVEL) >> times; echo library > fmi.so\n")
    with caplog.at_level(logging.INFO, "swarmwright.progress"):
        assert [simulation_fmu.read_library() for _ in range(2)] == [b"library\n"] * 2
    assert (checkout / "times").read_text() == "0\n"
    (said,) = (record.getMessage() for record in caplog.records)
    assert said.startswith("compiling the library of FMUs of simulations, once")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recipe", "words"),
    [("echo 'no \x1b[1mcargo' >&2; exit 3", r"no \x1b[1mcargo"), ("true", "it printed nothing")],
)
def test_what_fails_is_said(checkout: Path, recipe: str, words: str) -> None:
    (checkout / "Makefile").write_text(f"fmi:\n\t@{recipe}\n")
    with pytest.raises(RunError, match="cannot be compiled: `make fmi` failed: ") as failed:
        simulation_fmu.read_library()
    assert words in str(failed.value)


@pytest.mark.slow
def test_without_make(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(checkout))
    with pytest.raises(RunError, match="`make` not found"):
        simulation_fmu.read_library()


def test_without_the_source(checkout: Path) -> None:
    (checkout / "engine" / "bindings" / "fmi" / "Cargo.toml").unlink()
    with pytest.raises(InputError, match="reinstall Swarmwright"):
        simulation_fmu.read_library()
