"""`make demo`: the picture of the README is what its experiment evolves."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from swarmwright import Experiment, optimize
from swarmwright.runs.replay import Replay

PICTURE = Path("docs") / "images" / "demo.gif"
SAME = 0.004
"""Share of pixels that other versions of matplotlib and Pillow may draw differently. Runs with other seeds
differ in 0.018 and more, other candidates of the same run as well; with the same versions nothing differs."""

FEW_FRAMES = 600.0
"""Speed: the last frame is the same at any."""


def last_frame(file: Path) -> NDArray[np.uint8]:
    with Image.open(file) as film:
        film.seek(getattr(film, "n_frames") - 1)  # noqa: B009 - GIF has it, the base class does not
        return np.asarray(film.convert("RGB"))


def differing(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Return the share of pixels with another color."""
    assert one.shape == other.shape
    return float((np.abs(one.astype(int) - other).max(axis=2) > 32).mean())


@pytest.mark.journey
@pytest.mark.timeout(120)
def test_the_picture_of_the_readme_is_of_the_demo(root: Path, tmp_path: Path) -> None:
    """Records are the same on any number of servers, so this evolves in one process."""
    assert f'src="{PICTURE}"' in (root / "README.md").read_text(encoding="utf-8")
    recipe = (root / "Makefile").read_text(encoding="utf-8").split("\ndemo: ")[1].split("\n\n")[0]
    file = re.search(r" optimize (\S+) ", recipe)
    assert file is not None
    experiment = Experiment.load(root / file[1], settings=["validate=false"])
    run = optimize(experiment, servers="in-process", out=tmp_path / "run")
    history = run.history
    assert history[-1].mean > 4 * history[0].mean, "fitness grows visibly"
    committed = last_frame(root / PICTURE)
    Replay.of(run).save(tmp_path / "best.gif", speed=FEW_FRAMES)
    assert differing(last_frame(tmp_path / "best.gif"), committed) < SAME, (
        f"run `make demo`, look at build/demo/swarm.gif, and copy it to {PICTURE}"
    )
    Replay.of(run, generation=0).save(tmp_path / "first.gif", speed=FEW_FRAMES)
    assert differing(last_frame(tmp_path / "first.gif"), committed) > 2 * SAME, "another controller shows"
