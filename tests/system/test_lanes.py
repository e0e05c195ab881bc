"""Requests fill the lanes that a server announces."""

from collections import defaultdict
from pathlib import Path

from swarmwright import _engine
from tests.system.conftest import Experiment, Launch
from tests.system.runs import attempts, record

WIDTHS = {"portable": 1, "avx2": 8, "avx512": 16}
"""Episodes in a vector, of the arena; one at a time where vectors are short."""
EXPERIMENT = """\
simulation: arena
parameters: {duration: 240}
controller: {kind: evostick}
method: {kind: random_search, population: 96, generations: 2}
ranking: {episodes: 1}
mode: offloaded
validate: false
"""


def test_a_server_of_the_arena_computes_vectors_of_episodes(
    launch: Launch, experiment: Experiment, tmp_path: Path
) -> None:
    path = experiment(EXPERIMENT)
    for servers, out in (("2", "served"), ("in-process", "here")):
        program = launch("optimize", path, "--servers", servers, "--out", out)
        assert program.wait(60) == 0, program.stderr
    assert record(tmp_path / "served") == record(tmp_path / "here")
    sizes: dict[tuple[int, float], int] = defaultdict(int)
    for attempt in attempts(tmp_path / "served"):
        sizes[attempt["server"], attempt["started"]] += attempt["candidates"] * attempt["episodes"]
    # An average, as the first requests of a server and the last ones of a generation are smaller.
    assert sum(sizes.values()) / len(sizes) >= WIDTHS[_engine.levels()[-1]] / 2
