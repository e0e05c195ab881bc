"""Pictures of robots with headings on a floor with colours, and what their legends say."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from swarmwright import InputError
from swarmwright.display import Bodies, Part, Recording, Scene, Shown, Style
from swarmwright.display._look import FIELD, FLOOR, INK, LIGHT, Looks, lightened, rgb, value_colors
from swarmwright.display.drawing import Picture
from swarmwright.display.files import save
from tests.python.display.test_page_swarm import MODULES, lit, swarm


def count(image: Any, color: str) -> int:
    """Pixels of exactly this colour."""
    pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    return int((pixels == rgb(color)).all(axis=1).sum())


def legend(picture: Picture) -> list[str]:
    (found,) = picture.figure.legends
    return [text.get_text() for text in found.get_texts()]


def test_floor_robots_walls_and_labels_are_drawn() -> None:
    recording = swarm()
    picture = Picture(recording, dpi=100)
    image = picture.image(recording.scenes[0], 0.0)
    black, grey, _ = FLOOR["light"]
    assert count(image, grey) > 100_000
    # A circle with a radius of 0.2 of 2 metres.
    share = count(image, black) / (count(image, grey) + count(image, black))
    assert 0.02 < share < 0.04
    robots = count(image, LIGHT["free"])
    assert robots > 500
    plain = Picture(recording, dpi=100, shown=Shown(labels=False)).image(recording.scenes[0], 0.0)
    assert count(plain, LIGHT["free"]) >= robots
    assert legend(picture) == ["agent", "black floor (goal)", "grey floor", "wall", "light"]
    texts = [text.get_text() for axes in picture.figure.axes for text in axes.texts]
    assert "Rows" in texts


def test_leds_are_marks_on_robots_and_coloured_walls_are_lines() -> None:
    recording = lit()
    picture = Picture(recording, dpi=100)
    assert legend(picture) == [
        "agent, scout", "agent, base, stopped", "wall, green", "led, red", "grey floor",
    ]  # fmt: skip
    off, on = (picture.image(recording.scenes[step], float(step)) for step in (0, 2))
    assert count(off, "#123456") == count(on, "#123456") == 0
    # In the legend, too.
    assert count(on, "#e01010") > count(off, "#e01010") + 100
    assert 500 < count(on, "#10a010") < 2000


def test_rays_and_links_are_drawn_where_they_are_wanted() -> None:
    recording = swarm()
    drawn = {
        name: np.asarray(Picture(recording, dpi=100, shown=shown).image(recording.scenes[9], 9.0)).astype(int)
        for name, shown in {
            "none": Shown(trails=False),
            "rays": Shown(trails=False, rays=True),
            "links": Shown(trails=False, links=True),
        }.items()
    }
    for name in ("rays", "links"):
        assert (abs(drawn[name] - drawn["none"]).sum(axis=2) > 30).sum() > 20, name


@pytest.mark.parametrize(("step", "color"), [(5, "free"), (15, "exit")])
def test_robots_have_the_colour_of_their_controllers_state(step: int, color: str) -> None:
    recording = swarm()
    shown = Shown(trails=False, colors="controller")
    picture = Picture(recording, dpi=100, shown=shown, state_names=["exploration", "stop"])
    assert legend(picture)[:3] == ["agent", "0 exploration", "1 stop"]
    image = picture.image(recording.scenes[step], float(step)).crop((0, 0, 700, 600))
    # The light has the same colour as state 1.
    others = 300
    assert count(image, LIGHT[color]) > others
    assert (count(image, LIGHT["free"]) > others) == (color == "free")


def test_kinds_of_a_team_without_states_keep_their_colours() -> None:
    recording = swarm()
    assert recording.trace is not None
    assert recording.trace.states is not None
    scenes = []
    for scene in recording.scenes:
        found = Bodies.of(scene.bodies)
        names = ["scouts"] * 3 + ["carriers"] * 3
        bodies = Bodies(found.x, found.y, state=names, radius=0.05, heading=0.0)
        scenes.append(replace(scene, bodies=bodies))
    states = recording.trace.states.copy()
    states[:, 3:] = -1
    recording = replace(recording, scenes=tuple(scenes), trace=replace(recording.trace, states=states))
    picture = Picture(
        recording, dpi=100, shown=Shown(trails=False, colors="controller"), state_names=["a", "b"]
    )
    edges = {
        handle.get_label(): handle.get_markeredgecolor() == INK and handle.get_markerfacecolor() == FIELD
        for handle in picture._key._handles
        if handle.get_label().startswith("agent")
    }
    assert edges == {"agent, scouts": True, "agent, carriers": False}
    image = picture.image(recording.scenes[5], 5.0).crop((0, 0, 700, 600))
    carriers = "#" + "".join(f"{round(255 * part):02X}" for part in picture._colors["agent", "carriers"])
    assert count(image, carriers) > 200
    assert count(image, LIGHT["free"]) > 200, "state 0"


def test_values_are_colours_with_a_range(tmp_path: Path) -> None:
    recording = swarm(values=True)
    picture = Picture(recording, dpi=100)
    image = picture.image(recording.scenes[0], 0.0)
    for share in (0.0, 1.0):
        color = "#" + "".join(f"{round(255 * c):02X}" for c in value_colors(np.array([share]))[0])
        assert count(image, color) > 50, share
    texts = [text.get_text() for axes in picture.figure.axes for text in axes.texts]
    assert "load, kg   0" in texts
    assert "1" in texts
    plain = Picture(recording, dpi=100, shown=Shown(colors="state"))
    assert count(plain.image(recording.scenes[0], 0.0), LIGHT["free"]) > 500
    save(recording, tmp_path / "x.gif")
    with Image.open(tmp_path / "x.gif") as film:
        assert count(film, FLOOR["light"][1]) > 30_000


def test_styles_have_their_colours_on_everything(tmp_path: Path) -> None:
    bodies = Bodies(
        [1, 2, 3],
        [1, 1, 1],
        ["robot", "robot", "depot"],
        ["", "busy", ""],
        radius=0.2,
        heading=[0, 1, np.nan],
    )
    styles = (
        Style("robot", color="#7b3294"),
        Style("robot", "busy", "#008837"),
        Style("depot", shape="hexagon"),
    )
    recording = Recording((Scene(4, 2, 0, "", bodies, styles=styles),) * 2, (0.0, 0.0), 0.1)
    assert Looks(recording.scenes).plain()["depot"]["shape"] == "hexagon"
    for ending in ("png", "gif"):
        save(recording, tmp_path / f"x.{ending}")
        with Image.open(tmp_path / f"x.{ending}") as image:
            for color in ("#7B3294", "#008837"):
                assert count(image, color) > 200, (ending, color)
    save(recording, tmp_path / "x.html")
    page = (tmp_path / "x.html").read_text()
    assert "--own-1: #7b3294;" in page
    assert f"--own-1: {lightened('#7B3294').lower()};" in page


def test_dark_colours_are_lightened_on_dark_pages() -> None:
    def brightness(color: str) -> float:
        return float(np.dot(rgb(color), (0.2126, 0.7152, 0.0722)))

    assert brightness(lightened("#000000")) > 100
    assert lightened("#FFFF00") == "#FFFF00"


def test_several_episodes_are_for_pages(tmp_path: Path) -> None:
    parts = [Part(swarm(2), "a", MODULES), Part(swarm(3), "b", MODULES)]
    with pytest.raises(InputError, match=r"x.gif: several episodes .* by a page, FILE.html"):
        save(parts, tmp_path / "x.gif")
    save(parts[:1], tmp_path / "x.png", shown=Shown(colors="controller"))
    assert (tmp_path / "x.png").stat().st_size > 5000


def test_arrays_of_bodies_are_checked() -> None:
    with pytest.raises(ValueError, match=r"y: an array of the shape \(2,\) found, expected \(3,\)"):
        Bodies([1, 2, 3], [1, 2])
    with pytest.raises(ValueError, match=r"labels: 1 found, expected 2, one for each body"):
        Bodies([1, 2], [1, 2], labels=["a"])
    with pytest.raises(ValueError, match=r"x: an array of the shape \(1, 2\) found"):
        Bodies([[1, 2]], [1, 2])
