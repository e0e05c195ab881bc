"""Pictures of robots with headings on a floor with colours, and what their legends say."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.path import Path as Line
from PIL import Image

from swarmwright import InputError
from swarmwright.controllers.machines import machines_of
from swarmwright.display import Bodies, Body, Part, Ray, Recording, Scale, Scene, Shown, Style
from swarmwright.display._look import (
    BLUE,
    FIELD,
    FLOOR,
    INK,
    LIGHT,
    VALUES,
    Looks,
    lighten,
    mix,
    to_rgb,
    value_colors,
)
from swarmwright.display.drawing import Picture
from swarmwright.display.files import save
from swarmwright.display.machines import state_color
from tests.python.display.test_page_swarm import MODULES, TEAM, lit, swarm


def count(image: Any, color: str) -> int:
    """Pixels of exactly this colour."""
    pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    return int((pixels == to_rgb(color)).all(axis=1).sum())


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
    assert legend(picture) == ["agent", "black floor (goal)", "grey floor", "wall", "lamp"]
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


def test_bodies_with_a_heading_and_without_a_radius_are_as_large_as_marks() -> None:
    def drawn(bodies: int, radius: float) -> int:
        places = np.linspace(1, 9, bodies)
        flock = Bodies(places, places, "bird", radius=radius, heading=np.zeros(bodies))
        recording = Recording((Scene(10, 10, 0, "", flock),), (0.0,), 0.1)
        picture = Picture(recording, dpi=100)
        color = Looks(recording.scenes).marker(("bird", ""), 90.0)[0]
        return count(picture.image(recording.scenes[0], 0.0), color) // bodies

    assert 80 < drawn(5, 0.0) < 200  # pixels of each
    assert drawn(5, 0.0) > 4 * drawn(500, 0.0) > 0
    assert drawn(5, 0.01) < 20


def test_rays_and_links_are_drawn_where_they_are_wanted() -> None:
    recording = swarm()
    drawn = {
        # The map; legends differ.
        name: np.asarray(Picture(recording, dpi=100, shown=shown).image(recording.scenes[9], 9.0))[:670]
        for name, shown in {
            "none": Shown(trails=False),
            "rays": Shown(trails=False, rays=True),
            "links": Shown(trails=False, links=True),
        }.items()
    }
    for name in ("rays", "links"):
        changed = abs(drawn[name].astype(int) - drawn["none"]).sum(axis=2) > 30
        assert changed.sum() > 20, name


def test_legends_name_rays_and_links_where_they_are_drawn() -> None:
    recording = swarm()
    both = legend(Picture(recording, dpi=80, shown=Shown(rays=True, links=True)))
    assert both[-2:] == ["sensor ray", "message heard"]
    assert legend(Picture(recording, dpi=80)) == both[:-2]


def test_the_legend_shows_rays_in_a_colour_that_they_have() -> None:
    ray = Ray(angle=0.0, length=0.5, reading=0.0)
    for value in (None, 0.0, 1.0):
        body = Body("agent", 0.5, 1.0, heading=0.0, radius=0.1, rays=[ray], value=value)
        scene = Scene(2, 2, 0, "", [body], scale=Scale("load", 0.0, 1.0))
        picture = Picture(Recording((scene,), (0.0,), 0.1), dpi=80, shown=Shown(rays=True))
        (mark,) = dict(picture._key.entries)["sensor ray"]
        color = BLUE if value is None else VALUES[-1 if value else 0]
        assert to_hex(mark.get_markeredgecolor()).upper() == color


@pytest.mark.parametrize("shown", [Shown(rays=True), Shown(links=True)], ids=["rays", "links"])
def test_thin_lines_are_seen_on_a_black_floor(shown: Shown) -> None:
    ray = Ray(angle=0.0, length=0.5, reading=0.0)
    bodies = [Body("agent", 0.5, 1.0, heading=0.0, radius=0.1, rays=[ray]), Body("agent", 1.5, 1.0)]
    scene = Scene(2, 2, 0, "", bodies, floor=0.0, links=[(0, 1)])
    picture = Picture(Recording((scene,), (0.0,), 0.1), dpi=100, shown=shown)
    pixels = np.asarray(picture.image(scene, 0.0)).astype(int)
    across = picture.figure.axes[0].transData.transform([(0.8, 1.0)])[0].round().astype(int)
    column = pixels[pixels.shape[0] - across[1] - 4 : pixels.shape[0] - across[1] + 4, across[0]].sum(axis=1)
    assert column.max() > column.min() + 200


def test_labels_cover_no_robots_and_are_left_out_where_they_would() -> None:
    def labelled(others: Sequence[tuple[float, float]]) -> list[Any]:
        bodies = [Body("agent", 1.0, 1.0, heading=0.0, radius=0.1, label="middle")]
        bodies += [Body("agent", x, y, heading=0.0, radius=0.1) for x, y in others]
        scene = Scene(2, 2, 0, "", bodies)
        picture = Picture(Recording((scene,), (0.0,), 0.1), dpi=100)
        picture.draw(scene, 0.0)
        return [
            text.get_window_extent().transformed(picture.figure.axes[0].transData.inverted())
            for text in picture.figure.axes[0].texts
            if text.get_text() == "middle"
        ]

    (alone,) = labelled([])
    assert alone.x0 > 1.0
    assert alone.y0 > 1.0
    (aside,) = labelled([(1.2, 1.1)])
    assert aside.x1 < 1.0
    around = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    assert labelled([(1 + 0.22 * np.cos(angle), 1 + 0.22 * np.sin(angle)) for angle in around]) == []


def test_trails_have_the_colours_of_the_values_on_the_way() -> None:
    scenes = tuple(
        Scene(4, 2, step, "", Bodies([step + 0.5], [1.0], heading=[0.0], value=[step]), scale=Scale("", 0, 3))
        for step in range(4)
    )
    recording = Recording(scenes, (0.0,) * 4, 0.1)
    picture = Picture(recording, dpi=100, shown=Shown(labels=False))
    trails = next(one for one in picture.draw(scenes[3], 3.0) if isinstance(one, LineCollection))
    colors = np.asarray(trails.get_colors())[:, :3]
    assert len({tuple(color) for color in colors}) == 4
    # The trail is thinned with the ground.
    first = np.array(to_rgb(mix(VALUES[0], FIELD, 0.65))) / 255
    np.testing.assert_allclose(colors[0], first, atol=0.01)


def test_trails_end_at_the_edge_of_the_map() -> None:
    scenes = tuple(Scene(4, 2, step, "", Bodies([2.0 + 2 * step], [1.0], heading=[0.0])) for step in range(3))
    picture = Picture(Recording(scenes, (0.0,) * 3, 0.1), dpi=100)
    trails = next(one for one in picture.draw(scenes[2], 2.0) if isinstance(one, LineCollection))
    edge = trails.get_clip_box()
    assert edge is not None
    right = picture.figure.axes[0].transData.transform((4, 0))[0]
    assert edge.x1 == pytest.approx(right)


@pytest.mark.parametrize(("step", "state"), [(5, 0), (15, 1)])
def test_robots_have_the_colour_of_their_controllers_state(step: int, state: int) -> None:
    recording = swarm()
    shown = Shown(trails=False, colors="controller")
    picture = Picture(Part(recording, "", machines_of(MODULES)), dpi=100, shown=shown)
    assert legend(picture)[:3] == ["agent", "0 exploration", "1 stop"]
    image = picture.image(recording.scenes[step], float(step)).crop((0, 0, 700, 600))
    assert [count(image, state_color(one)) > 300 for one in (0, 1)] == [state == 0, state == 1]


def test_kinds_of_a_team_without_states_keep_their_colours() -> None:
    recording = swarm()
    assert recording.trace is not None
    assert recording.trace.states is not None
    scenes = []
    for scene in recording.scenes:
        found = Bodies.from_bodies(scene.bodies)
        names = ["scouts"] * 3 + ["carriers"] * 3
        bodies = Bodies(found.x, found.y, state=names, radius=0.05, heading=0.0)
        scenes.append(replace(scene, bodies=bodies))
    states = recording.trace.states.copy()
    states[:, 3:] = -1
    recording = replace(recording, scenes=tuple(scenes), trace=replace(recording.trace, states=states))
    picture = Picture(recording, dpi=100, shown=Shown(trails=False, colors="controller"))
    edges = {
        name: drawn[0].get_markeredgecolor() == INK and drawn[0].get_markerfacecolor() == FIELD
        for name, drawn in picture._key.entries
        if name.startswith("agent")
    }
    assert edges == {"agent, scouts": True, "agent, carriers": False}
    image = picture.image(recording.scenes[5], 5.0).crop((0, 0, 700, 600))
    carriers = "#" + "".join(f"{round(255 * part):02X}" for part in picture._colors["agent", "carriers"])
    assert count(image, carriers) > 200
    assert count(image, LIGHT["free"]) > 200, "state 0"


def _named(recording: Recording, names: Sequence[str]) -> Recording:
    """The same recording with a state of each body."""
    scenes = []
    for scene in recording.scenes:
        found = Bodies.from_bodies(scene.bodies)
        bodies = Bodies(found.x, found.y, found.has("agent").size * ["agent"], names, 0.05, 0.0, found.value)
        scenes.append(replace(scene, bodies=bodies))
    return replace(recording, scenes=tuple(scenes))


def test_groups_of_a_team_have_colours_of_their_own() -> None:
    recording = _named(swarm(), ["carriers"] * 3 + ["scouts"] * 3)
    assert recording.trace is not None
    part = Part(recording, "", machines_of(TEAM))
    picture = Picture(part, dpi=100, shown=Shown(trails=False, colors="controller"))
    assert legend(picture)[:5] == [
        "agent", "scouts 0 exploration", "scouts 1 stop", "carriers 0 exploration", "carriers 1 stop",
    ]  # fmt: skip
    for step, state in ((5, 0), (15, 1)):
        colors = picture._colors_of(Bodies.from_bodies(recording.scenes[step].bodies), step)
        expected = [state_color(state + 2)] * 3 + [state_color(state)] * 3
        assert np.allclose(colors * 255, [to_rgb(color) for color in expected]), "by name, not by number"
    assert len({drawn[0].get_color() for _, drawn in picture._key.entries[:5]}) == 5


def test_no_two_entries_of_a_legend_look_alike() -> None:
    recording = _named(swarm(values=True), ["near", "far"] * 3)
    assert legend(Picture(recording, dpi=100))[:2] == ["agent", "black floor (goal)"]
    plain = Picture(recording, dpi=100, shown=Shown(colors="state"))
    assert legend(plain)[:2] == ["agent, near", "agent, far"]


def test_kinds_of_agents_stand_alone_in_legends() -> None:
    recording = _named(swarm(), ["scouts", "scouts, stopped"] + ["lost"] * 4)
    assert legend(Picture(Part(recording, "", machines_of(TEAM)), dpi=100))[:3] == [
        "scouts", "scouts, stopped", "agent, lost",
    ]  # fmt: skip


def test_legends_show_discs_with_a_line_for_bodies_with_a_heading() -> None:
    bodies = Bodies([1, 2], [1, 1], ["bird", "nest"], radius=0.1, heading=[0.0, np.nan])
    picture = Picture(Recording((Scene(4, 2, 0, "", bodies),), (0.0,), 0.1), dpi=100)
    (bird, (disc, line)), (nest, (symbol,)) = picture._key.entries
    assert (bird, disc.get_marker()) == ("bird", "o")
    marker = line.get_marker()
    assert isinstance(marker, Line)
    assert len(np.asarray(marker.vertices)) == 2
    assert (nest, symbol.get_marker()) == ("nest", "p")


def test_the_grid_is_below_patches() -> None:
    recording = replace(swarm(), scenes=swarm().scenes[:1], fitness_so_far=(0.0,))
    picture = Picture(recording, dpi=100, shown=Shown(labels=False))
    image = np.asarray(picture.image(recording.scenes[0], 0.0))
    # A line of the grid, at y = 1, goes through the middle of the patch.
    column, row = picture.figure.axes[0].transData.transform((1.5, 1.0)).round().astype(int)
    middle = image[len(image) - row - 5 : len(image) - row + 5, column - 20 : column + 20]
    assert (middle == to_rgb(FLOOR["light"][0])).all()


def test_seconds_are_shown_where_a_step_is_known_to_last() -> None:
    recording = swarm()
    picture = Picture(Part(recording, "", step_seconds=0.1), dpi=100)
    picture.draw(recording.scenes[25], 25.0)
    texts = [text.get_text() for text in picture.figure.axes[0].texts]
    assert "step 25 of 40, 2.5 s   fitness 25" in texts


@pytest.mark.slow
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
    assert f"--own-1: {lighten('#7B3294').lower()};" in page


def test_dark_colours_are_lightened_on_dark_pages() -> None:
    def brightness(color: str) -> float:
        return float(np.dot(to_rgb(color), (0.2126, 0.7152, 0.0722)))

    assert brightness(lighten("#000000")) > 100
    assert lighten("#FFFF00") == "#FFFF00"


def test_several_episodes_are_for_pages(tmp_path: Path) -> None:
    parts = [Part(swarm(2), "a", machines_of(MODULES)), Part(swarm(3), "b", machines_of(MODULES))]
    with pytest.raises(InputError, match=r"x.gif: only a page, FILE.html, can show several episodes"):
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
