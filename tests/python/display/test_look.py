"""One table says how bodies look, on pages and in pictures alike."""

import json
import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from swarmwright.display import Body, Patch, Recording, Scene
from swarmwright.display._look import (
    DARK,
    FIELD,
    KNOWN,
    LIGHT,
    OTHERS,
    SHAPES,
    STATES_DARK,
    STATES_LIGHT,
    Looks,
    build_palette,
    floor_labels,
    format_css,
    luminance,
    to_rgb,
)
from swarmwright.display._look import STATES as OF_CONTROLLERS
from swarmwright.display.drawing import Picture
from swarmwright.display.files import save
from swarmwright.display.machines import DISTINCT_STATES, STATE_COLORS, state_color

STATES = ("free", "carrying", "charging", "waiting")


def scene(step: int, *bodies: Body) -> Scene:
    return Scene(10, 6, step, "states", bodies)


@pytest.fixture
def recording() -> Recording:
    """Four agents of four states, two of them new ones, and things that nobody knows."""
    things = [Body("door", 2, 5, "open"), Body("door", 4, 5, "shut"), Body("base", 6, 5), Body("goal", 8, 5)]
    agents = [Body("agent", 2 + 2 * place, 2, state) for place, state in enumerate(STATES)]
    scenes = (scene(0, *things, *agents), scene(1, *things, *agents))
    return Recording(scenes, (0.0, 1.0), 0.1)


def test_states_and_kinds_that_nobody_knows_look_different(recording: Recording) -> None:
    looks = Looks(recording.scenes).plain()
    assert looks["agent, free"] == {"shape": "circle", "color": "free"}
    agents = [looks[f"agent, {state}"] for state in STATES]
    assert {look["shape"] for look in agents} == {"circle"}
    assert len({look["color"] for look in agents}) == len(STATES)
    assert looks["door, open"]["shape"] == looks["door, shut"]["shape"] != looks["base"]["shape"]
    assert looks["door, open"]["color"] != looks["door, shut"]["color"]
    assert looks["goal"] == {"shape": "star", "color": "good"}


def test_page_and_picture_have_the_same_colours(recording: Recording, tmp_path: Path) -> None:
    for ending in ("html", "png", "gif"):
        save(recording, tmp_path / f"x.{ending}")
    page = (tmp_path / "x.html").read_text()
    data = json.loads(re.search(r'id="episode">(.*?)</script>', page)[1])  # type: ignore[index]
    assert data["looks"] == Looks(recording.scenes).plain()
    assert set(data["shapes"]) == set(SHAPES)
    for ending in ("png", "gif"):
        with Image.open(tmp_path / f"x.{ending}") as opened:
            pixels = np.asarray(opened.convert("RGB")).reshape(-1, 3)
        for name, look in data["looks"].items():
            color = (LIGHT | STATES_LIGHT)[look["color"]]
            assert f"--{look['color']}: {color.lower()};" in page
            assert (pixels == to_rgb(color)).all(axis=1).sum() > 20, (ending, name)


def test_a_long_legend_has_several_rows_within_the_picture(recording: Recording) -> None:
    picture = Picture(recording, dpi=80)
    (legend,) = picture.figure.legends
    picture.figure.canvas.draw()
    box = legend.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= picture.figure.bbox.x1
    tops = {round(text.get_window_extent().y1) for text in legend.get_texts()}
    assert len(legend.get_texts()) == 8
    assert len(tops) > 1
    (axes,) = picture.figure.axes
    assert box.y1 < axes.get_window_extent().y0 - 10, "the numbers of the axis are between"


def test_every_colour_of_the_table_is_on_the_page_and_in_the_palette() -> None:
    style = format_css()
    shades = np.array(build_palette()).reshape(-1, 3).tolist()
    assert len(shades) <= 256
    for name in {color for _, color in KNOWN.values()} | set(OTHERS):
        assert style.count(f"--{name}: {LIGHT[name].lower()};") == 1
        assert style.count(f"--{name}: {DARK[name].lower()};") == 2
        assert list(to_rgb(LIGHT[name])) in shades
    assert {shape for shape, _ in KNOWN.values()} <= set(SHAPES)


def test_states_have_colours_that_are_told_apart() -> None:
    for table in (LIGHT | STATES_LIGHT, DARK | STATES_DARK):
        colors = [table[name] for name in OF_CONTROLLERS]
        assert len(set(colors)) == len(OF_CONTROLLERS) >= 16
        for one, other in combinations(colors, 2):
            assert np.linalg.norm(seen(one, SIGHT) - seen(other, SIGHT)) > 15, (one, other)
    assert [state_color(state) for state in (0, 8, len(OF_CONTROLLERS))] == ["#0072B2", "#221188", "#0072B2"]
    # Pages have the same ones on light ground.
    assert [(LIGHT | STATES_LIGHT)[name] for name in OF_CONTROLLERS] == list(STATE_COLORS)
    style = format_css()
    for name in STATES_LIGHT:
        assert style.count(f"--{name}: {STATES_LIGHT[name].lower()};") == 1
        assert style.count(f"--{name}: {STATES_DARK[name].lower()};") == 2
    shades = np.array(build_palette(states=16)).reshape(-1, 3).tolist()
    assert len(shades) <= 256
    assert all(list(to_rgb(state_color(state))) in shades for state in range(16))
    assert len(build_palette(["#123456"] * 16, LIGHT.values(), values=True, states=64)) <= 3 * 256


def test_many_kinds_have_colours_of_their_own(tmp_path: Path) -> None:
    kinds = [f"kind {number}" for number in range(20)]
    bodies = [Body("agent", 0.5 * place, 3, kind) for place, kind in enumerate(kinds)]
    scenes = (scene(0, *bodies), scene(1, *bodies))
    looks = Looks(scenes)
    names = {looks[body.kind, body.state].color for body in bodies}
    assert len(names) == len({looks.color((body.kind, body.state)) for body in bodies}) == len(kinds)
    style = format_css()
    assert all(f"--{name}: " in style for name in names)
    save(Recording(scenes, (0.0, 1.0), 0.1), tmp_path / "x.gif")
    with Image.open(tmp_path / "x.gif") as opened:
        pixels = np.asarray(opened.convert("RGB")).reshape(-1, 3)
    for body in bodies:
        assert (pixels == to_rgb(looks.color((body.kind, body.state)))).all(axis=1).any(), body.state


def test_legends_name_all_parts_of_the_floor_with_one_grey_value(tmp_path: Path) -> None:
    """Also where they are not there at the same time, or in episodes beside each other."""
    scenes = tuple(
        Scene(4, 4, step, "", [], patches=[Patch(0.0, ((1, 1),), 0.5, name)])
        for step, name in enumerate(["west", "east"])
    )
    assert floor_labels(*scenes) == {0.0: "black floor (west, east)"}
    save(Recording(scenes, (0.0, 1.0), 0.1), tmp_path / "x.html")
    assert "black floor (west, east)" in (tmp_path / "x.html").read_text()


def test_the_terminal_has_the_same_table(root: Path) -> None:
    glyphs = root / "engine" / "worlds" / "worlds" / "src" / "text" / "glyphs.rs"
    source = glyphs.read_text(encoding="utf-8")
    entry = re.compile(r"""\("(\w+)", "(\w*)", '(.)', '.', Color::(\w+)\)""")
    terminal = {(kind, state): (symbol, color) for kind, state, symbol, color in entry.findall(source)}
    assert set(terminal) == set(KNOWN)
    symbols: dict[str, set[str]] = {}
    for key, (shape, color) in KNOWN.items():
        symbol, named = terminal[key]
        assert named.lower() == color, key
        # What is drawn as large as it is, is a filled character.
        if key[0] not in {"exit", "blockade", "obstacle"}:
            symbols.setdefault(shape, set()).add(symbol)
    assert symbols == {"circle": {"●"}, "cross": {"✗"}, "triangle": {"▲"}, "star": {"★"}}
    others = re.search(r"const OTHERS: \[Color; 4\] = \[\s*([^\]]*?),?\s*\];", source)
    assert others is not None
    names = [name.strip().removeprefix("Color::Other") for name in others[1].split(",")]
    assert [f"other-{number}" for number in names] == list(OTHERS)


# Viénot, Brettel and Mollon 1999: what people without red or green cones see, in linear RGB.
SIGHT = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
BLIND = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def seen(color: str, matrix: list[list[float]]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """A colour in CIE Lab, as it is seen through a matrix."""
    share = np.array(to_rgb(color)) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    through = np.clip(np.array(matrix) @ linear, 0, 1)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ through
    f = np.cbrt(xyz / [0.9505, 1.0, 1.089])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", BLIND)
def test_colours_of_states_are_told_apart_without_red_or_green(kind: str) -> None:
    # What has the same shape: circles of agents, known states and others.
    names = ["free", "good", *OTHERS]
    for one, other in combinations(names, 2):
        apart = np.linalg.norm(seen(LIGHT[one], BLIND[kind]) - seen(LIGHT[other], BLIND[kind]))
        assert apart > 12, (one, other, apart)
    for one, other in combinations([state_color(state) for state in range(8, 24)], 2):
        assert np.linalg.norm(seen(one, BLIND[kind]) - seen(other, BLIND[kind])) > 12, (one, other)
    for name in LIGHT:
        assert np.linalg.norm(seen(LIGHT[name], BLIND[kind]) - seen(FIELD, BLIND[kind])) > 25, name


# Machado, Oliveira and Fernandes 2009, severity 1.0, in linear RGB.
MACHADO = {
    "normal": SIGHT,
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.01182, 0.04294, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.3039],
    ],
}


@pytest.mark.parametrize("table", [LIGHT | STATES_LIGHT, DARK | STATES_DARK], ids=["light", "dark"])
@pytest.mark.parametrize("kind", MACHADO)
def test_the_first_eight_colours_of_states_are_told_apart_by_all(kind: str, table: dict[str, str]) -> None:
    sight = MACHADO[kind]
    for one, other in combinations(OF_CONTROLLERS[:DISTINCT_STATES], 2):
        apart = np.linalg.norm(seen(table[one], sight) - seen(table[other], sight))
        assert apart >= 25, (one, other, apart)


@pytest.mark.parametrize(
    ("table", "grounds"),
    [(STATES_LIGHT, (FIELD, "#FFFFFF")), (STATES_DARK, ("#1E2328", "#000000"))],
    ids=["light", "dark"],
)
def test_the_first_eight_colours_of_states_are_seen_on_their_ground(
    table: dict[str, str], grounds: tuple[str, ...]
) -> None:
    for name in OF_CONTROLLERS[:DISTINCT_STATES]:
        for ground in grounds:
            dark, light = sorted(luminance(color) for color in (table[name], ground))
            assert (light + 0.05) / (dark + 0.05) >= 2, (name, ground)


def test_no_state_looks_like_a_lamp() -> None:
    for table in (LIGHT | STATES_LIGHT, DARK | STATES_DARK):
        for name in OF_CONTROLLERS[:DISTINCT_STATES]:
            assert np.linalg.norm(seen(table[name], SIGHT) - seen(table["exit"], SIGHT)) > 25, name
