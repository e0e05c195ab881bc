"""Environments that are named as if they were classes of simulations."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError

GYMNASIUM = """
import gymnasium

class Maze(gymnasium.Env):
    pass
"""
REGISTERED = (
    GYMNASIUM
    + """
gymnasium.register("Large-v2", entry_point="{stem}:Maze")
"""
)
PETTINGZOO = """
from pettingzoo import ParallelEnv

class Maze(ParallelEnv):
    pass
"""


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            GYMNASIUM,
            r"Maze is a Gymnasium environment, .*\('Maze-v0', entry_point='{stem}:Maze'\), and",
        ),
        (REGISTERED, r"Maze is a Gymnasium environment, .*: write gymnasium:{stem}:Large-v2; see docs"),
        (PETTINGZOO, r"Maze is a PettingZoo environment, .* and write pettingzoo:{stem}; see docs"),
        ("class Maze: pass", r"Maze is not a subclass of swarmwright.Simulation$"),
        ("def Maze(): pass", r"Maze is not a subclass of swarmwright.Simulation$"),
    ],
    ids=["gymnasium", "registered", "pettingzoo", "another class", "function"],
)
def test_how_an_environment_is_named_instead(
    source: str, words: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    stem = f"world_{request.node.callspec.id.replace(' ', '_')}"
    path = tmp_path / f"{stem}.py"
    path.write_text(source.replace("{stem}", stem))
    with pytest.raises(InputError, match=words.replace("{stem}", stem)):
        Experiment.from_mapping({"simulation": f"{path}:Maze"})
