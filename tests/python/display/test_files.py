from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from swarmwright import InputError
from swarmwright.common import warn_once
from swarmwright.controllers.machines import machines_of
from swarmwright.display import Body, Part, Recording, Scene, Shown, record
from swarmwright.display.files import FORMATS, save
from tests.python.display.test_page_swarm import MODULES, NETWORK, TEAM


@pytest.mark.slow
@pytest.mark.parametrize("ending", FORMATS)
def test_many_bodies_and_odd_maps(tmp_path: Path, ending: str) -> None:
    random = np.random.default_rng(1)
    bodies = tuple(Body("agent", float(x), float(y), "caught", 0.0) for x, y in random.random((500, 2)))
    for width, height in ((1.0, 1.0), (1000.0, 1.0), (1.0, 1000.0)):
        recording = Recording((Scene(width, height, 0, "", bodies, grid=width == 1000),), (-1.0,), 0.0)
        file = tmp_path / f"x{ending}"
        save(recording, file)
        assert file.stat().st_size > 1000
        if ending in {".gif", ".png"}:
            with Image.open(file) as picture:
                assert 100 < picture.height < 2000


def test_endings_may_be_capitals(crossing: Any, tmp_path: Path) -> None:
    save(record(crossing), tmp_path / "x.PNG")
    with Image.open(tmp_path / "x.PNG") as picture:
        assert picture.format == "PNG"


NETWORKS = {**TEAM, "groups": TEAM["groups"][1:2], "weights": NETWORK["weights"]}


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize(
    ("controller", "why"),
    [
        (NETWORK, "a controller of the kind layered has none"),
        (TEAM, "this episode does not report them"),
        (NETWORKS, "no controller of this team has any"),
        (MODULES, "this episode does not report them"),
        ({}, "this episode does not report them"),
    ],
)
def test_colours_of_states_need_states(
    crossing: Any, tmp_path: Path, ending: str, controller: dict[str, Any], why: str
) -> None:
    part = Part(record(crossing), "", machines_of(controller))
    with pytest.raises(InputError, match=f"^colors: controller needs .*{why}; use auto"):
        save([part], tmp_path / f"x{ending}", shown=Shown(colors="controller"))
    assert not any(tmp_path.iterdir())


def test_other_endings_are_refused(crossing: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"\.html, \.gif, \.mp4 or \.png"):
        save(record(crossing), tmp_path / "x.avi")


def test_a_map_without_its_bodies_is_reported_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warn_once, "_given", set())

    def saved(x: float, radius: float = 0.0) -> list[str]:
        bodies = (Body("agent", x, 0.5), Body("agent", x, -0.5, radius=radius))
        recording = Recording((Scene(4, 3, 0, "", bodies),), (0.0,), 0.0)
        caplog.clear()
        save(recording, tmp_path / "x.html")
        return [one.getMessage() for one in caplog.records]

    assert saved(1.0) == saved(-0.5, radius=0.6) == []
    (text,) = saved(-1.0)
    assert text.startswith("all 2 bodies are outside the scene, 4 x 3, in all steps; positions ")
    assert saved(-1.0) == []


def test_a_still_that_all_agents_have_left_is_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(warn_once, "_given", set())
    scenes = tuple(
        Scene(4, 3, step, "", (Body("agent", 3.0 + step, 1.0), Body("base", 1, 1))) for step in range(3)
    )
    recording = Recording(scenes, (0.0,) * 3, 0.0)
    save(recording, tmp_path / "x.html")
    assert not caplog.records
    save(recording, tmp_path / "x.png")
    (text,) = (one.getMessage() for one in caplog.records)
    assert text.startswith(
        "all 1 agents are outside the scene, 4 x 3, in step 2, which the picture shows; use a page "
    )
