"""What was probably meant by the name of a simulation."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, optimize
from swarmwright.simulations.near_names import unknown_simulation

SOURCE = """
from swarmwright import Simulation
raise RuntimeError("is not imported")

class Pursuit(Simulation):
    title = "hunt"
"""


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (
            "hunt",
            "unknown simulation 'hunt'; did you mean 'chase.py:Pursuit'? available: arena, emergency_exit",
        ),
        ("Pursuit", "did you mean 'chase.py:Pursuit'?"),
        ("gym:Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("gymnasiun:Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("Acrobot-v1", "did you mean 'gymnasium:Acrobot-v1'?"),
        ("minisin", "did you mean 'minisim'?"),
        ("zzz", "unknown simulation 'zzz'; available: arena, emergency_exit, minisim"),
    ],
)
def test_the_whole_name_is_told(name: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(SOURCE)
    (tmp_path / "damaged.py").write_text("class")
    assert words in unknown_simulation(name, tmp_path)
    (tmp_path / "one.yaml").write_text(f"simulation: {name}\n")
    with pytest.raises(InputError) as raised:
        optimize(Experiment.load(tmp_path / "one.yaml"), servers="local", out=tmp_path / "run")
    assert words in str(raised.value)


def test_a_file_that_is_misspelt(tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(SOURCE)
    with pytest.raises(InputError, match=r"chas.py: there is no such file; did you mean 'chase.py'\?$"):
        Experiment.from_mapping({"simulation": f"{tmp_path / 'chas.py'}:Pursuit"})


@pytest.mark.parametrize(("source", "name"), [(SOURCE, "chase.py:Pursuit"), ("", "chase.py:CLASS")])
def test_a_class_in_the_place_of_an_experiment(source: str, name: str, tmp_path: Path) -> None:
    (tmp_path / "chase.py").write_text(source)
    with pytest.raises(InputError, match=rf"is a program in Python, .* the line 'simulation: {name}'$"):
        Experiment.load(tmp_path / "chase.py")
