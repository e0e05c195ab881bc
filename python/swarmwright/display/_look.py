"""Shapes and colours shared by pages, stills, animations and videos."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.display._scene import Bodies, Patch, Scene, Style
from swarmwright.display.machines import DISTINCT_STATES, STATE_COLORS, state_color

# Okabe and Ito's palette, safe for colour-blind readers.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#8C8C8C"
INK, BORDER, GRID, FIELD, PAPER = "#222222", "#555555", "#E4E4DE", "#FAFAF7", "#FFFFFF"
LIGHT = {
    "free": BLUE,
    "good": GREEN,
    "lost": GREY,
    "defender": RED,
    "exit": ORANGE,
    "blockade": BORDER,
    "other-1": "#CC79A7",
    "other-2": "#56B4E9",
    "other-3": "#B59A00",
    "other-4": "#222222",
}
"""Colours of bodies on a light background, by name; CSS variables on pages."""
DARK = {
    "free": "#56B4E9",
    "good": "#2BBF93",
    "lost": "#8F979E",
    "defender": "#F0803C",
    "exit": "#F0B840",
    "blockade": "#7B858E",
    "other-1": "#D994BB",
    "other-2": "#9AD4F5",
    "other-3": "#D8C54A",
    "other-4": "#ECEFF1",
}
"""The same for a dark background."""
FLOOR = {"light": ("#2E2E2E", "#D0D0C9", "#FFFFFF"), "dark": ("#000000", "#3D444B", "#D5D9DC")}
"""Black, middle grey and white floor on a light and a dark background; robots are visible on all of them."""
VALUES = ("#440154", "#3B528B", "#21918C", "#5EC962", "#FDE725")
"""Colours from the smallest to the largest value (viridis)."""
STATES_LIGHT = {f"state-{state}": color for state, color in enumerate(STATE_COLORS)}
"""Colours of controller states on a light background."""
STATES_DARK = {
    "state-0": "#56B4E9",
    "state-1": "#AA4433",
    "state-2": "#BBFF00",
    "state-3": "#7744FF",
    "state-4": "#FF99AA",
    "state-5": "#885577",
    "state-6": "#EEDD88",
    "state-7": "#FF4411",
    "state-8": "#6611FF",
    "state-9": "#3355CC",
    "state-10": "#446633",
    "state-11": "#EEEE00",
    "state-12": "#FF1155",
    "state-13": "#AA0088",
    "state-14": "#CCEEAA",
    "state-15": "#EE11FF",
    "state-16": "#AAFF88",
    "state-17": "#9955BB",
    "state-18": "#776600",
    "state-19": "#BB7766",
    "state-20": "#8888BB",
    "state-21": "#AA4477",
    "state-22": "#9900BB",
    "state-23": "#00DD77",
}
"""The same for a dark background."""
STATES = tuple(STATES_LIGHT)
"""Colours of controller states in order; they repeat for more states."""
OTHERS = ("other-1", "other-2", "other-3", "other-4")
"""Colours of unknown kinds and states in order of appearance; terminals have only these."""
_UNKNOWN = (*OTHERS, *STATES[DISTINCT_STATES:])
"""The same, with colours for more kinds and states."""

SHAPES = {
    "circle": ("o", "M1 0A1 1 0 1 1-1 0A1 1 0 1 1 1 0Z"),
    "cross": (
        "X",
        "M-.95-.55-.55-.95 0-.4 .55-.95 .95-.55 .4 0 .95 .55 .55 .95 0 .4-.55 .95-.95 .55-.4 0Z",
    ),
    "triangle": ("^", "M0-1.1 1 .8-1 .8Z"),
    "star": ("*", "M0-1.2 .27-.37 1.14-.37 .44 .14 .71 .97 0 .46-.71 .97-.44 .14-1.14-.37-.27-.37Z"),
    "square": ("s", "M-1-1H1V1H-1Z"),
    "diamond": ("D", "M0-1.1 1.1 0 0 1.1-1.1 0Z"),
    "pentagon": ("p", "M0-1.1 1.05-.34 .65 .89-.65 .89-1.05-.34Z"),
    "hexagon": ("h", "M0-1.1 .95-.55 .95 .55 0 1.1-.95 .55-.95-.55Z"),
}
"""Each shape as matplotlib's marker and as an SVG path around (0, 0) with radius 1."""
_FREE_SHAPES = ("diamond", "pentagon", "hexagon")
"""Shapes of unknown kinds in order of appearance."""

KNOWN = {
    ("agent", ""): ("circle", "free"),
    ("agent", "free"): ("circle", "free"),
    ("agent", "arrived"): ("circle", "good"),
    ("agent", "out"): ("circle", "good"),
    ("agent", "caught"): ("cross", "lost"),
    ("agent", "crashed"): ("cross", "lost"),
    ("defender", ""): ("triangle", "defender"),
    ("goal", ""): ("star", "good"),
    ("exit", ""): ("square", "exit"),
    ("blockade", ""): ("square", "blockade"),
    ("obstacle", ""): ("circle", "blockade"),
}
"""Shape and colour by kind and state."""
CELLS = ("blockade", "exit")
"""Kinds that fill a cell of a grid, one unit wide and high."""
MOVING = ("agent", "defender")
"""Kinds that leave a trail."""
LED = "led"
"""The kind of LEDs on robots; LEDs without a state are off and not drawn."""
STRETCH = "wall"
"""The kind of coloured wall sections; with a heading they are lines, without an entry in legends."""
RAY_WIDTH, LINK_WIDTH = 0.9, 0.8
"""Widths of lines in pictures, points."""
HALO_WIDTH, HALO_SHARE = 1.6, 0.6
"""Width in points and opacity of the light line below thin rays and links."""
SHADES = 16


class Look(NamedTuple):
    """A shape and the name of a colour."""

    shape: str
    color: str


class Marker(NamedTuple):
    """A matplotlib marker: area in points squared, layer (higher is above)."""

    color: str
    marker: str
    size: float
    layer: float


class Looks:
    """Looks of the bodies of an episode, the same in all scenes and media.

    Styles of the scenes have precedence; then kinds and states of KNOWN. Unknown kinds get a shape and
    unknown states a colour in order of appearance, all different as long as there are shapes and colours.

    custom_colors: the colours of styles by generated name, for a light and a dark background.
    """

    def __init__(self, scenes: Iterable[Scene]) -> None:
        self._looks: dict[tuple[str, str], Look] = {}
        self._shapes = {kind: shape for (kind, _), (shape, _) in reversed(KNOWN.items())}
        self._unknown = 0
        self._styles: dict[tuple[str, str], Style] = {}
        self.custom_colors: dict[str, tuple[str, str]] = {}
        previous: tuple[object, object] = (None, None)
        for scene in scenes:
            for style in scene.styles:
                self._styles[style.kind, style.state] = style
            bodies = Bodies.from_bodies(scene.bodies)
            if (bodies.looks, len(self._styles)) == previous:
                continue
            previous = (bodies.looks, len(self._styles))
            for kind, state in bodies.looks:
                self._add(kind, state)

    def _add(self, kind: str, state: str) -> None:
        if (kind, state) in self._looks:
            return
        style = self._styles.get((kind, state)) or self._styles.get((kind, ""))
        color = self._name_color(style.color) if style is not None and style.color else None
        shape = style.shape if style is not None else ""
        default = KNOWN.get((kind, state))
        if default is not None:
            self._looks[kind, state] = Look(shape or default[0], color or default[1])
            return
        if not shape and kind not in self._shapes:
            strangers = len(self._shapes) - len({kind for kind, _ in KNOWN})
            self._shapes[kind] = _FREE_SHAPES[strangers % len(_FREE_SHAPES)]
        if color is None:
            color = _UNKNOWN[self._unknown % len(_UNKNOWN)]
            self._unknown += 1
        self._looks[kind, state] = Look(shape or self._shapes[kind], color)

    def _name_color(self, color: str) -> str:
        """Return the name of a style's colour, generated at its first use."""
        light = color.upper()
        for name, (existing, _) in self.custom_colors.items():
            if existing == light:
                return name
        name = f"own-{len(self.custom_colors) + 1}"
        self.custom_colors[name] = (light, lighten(light))
        return name

    def __getitem__(self, look: tuple[str, str]) -> Look:
        """Return the look of a kind and state of the episode."""
        return self._looks[look]

    def color(self, look: tuple[str, str]) -> str:
        """Return the colour of a kind and state on a light background, as '#0072B2'."""
        name = self._looks[look].color
        return self.custom_colors[name][0] if name in self.custom_colors else (LIGHT | STATES_LIGHT)[name]

    def plain(self) -> dict[str, dict[str, str]]:
        """Return label -> shape and name of the colour, in order of appearance."""
        return {
            label(kind, state): {"shape": look.shape, "color": look.color}
            for (kind, state), look in self._looks.items()
        }

    def names(self) -> list[tuple[str, str]]:
        """Return kinds and states, in order of appearance."""
        return list(self._looks)

    def marker(self, look: tuple[str, str], agent_size: float) -> Marker:
        """Return how matplotlib draws bodies of a kind and state."""
        size, layer = {
            "agent": (agent_size, 4.0),
            "defender": (max(agent_size, 30.0), 3.0),
            "goal": (190.0, 2.5),
            "exit": (60.0, 1.6),
            "blockade": (45.0, 1.6),
            "obstacle": (12.0, 1.6),
        }.get(look[0], (40.0, 2.5))
        return Marker(self.color(look), SHAPES[self._looks[look].shape][0], size, layer)


def format_css(custom_colors: Mapping[str, tuple[str, str]] | None = None) -> str:
    """Return the colours of bodies and floors as CSS for both themes; custom_colors: see `Looks`."""
    custom_colors = custom_colors or {}

    def variables(theme: str, colors: dict[str, str], theme_index: int) -> str:
        floor = {f"floor-{index}": color for index, color in enumerate(FLOOR[theme])}
        values = {f"value-{index}": color for index, color in enumerate(VALUES)}
        mine = {name: pair[theme_index] for name, pair in custom_colors.items()}
        return " ".join(f"--{n}: {v.lower()};" for n, v in {**colors, **floor, **values, **mine}.items())

    dark = variables("dark", DARK | STATES_DARK, 1)
    return (
        f":root {{ {variables('light', LIGHT | STATES_LIGHT, 0)} }}\n"
        f'@media (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
        f':root[data-theme="dark"] {{ {dark} }}'
    )


def agent_size(scene: Scene) -> float:
    """Return the marker area of an agent in points squared; it decreases with the number of agents."""
    return marker_area(int(Bodies.from_bodies(scene.bodies).has("agent").sum()))


def marker_area(count: int) -> float:
    """Return the marker area in points squared for a number of bodies."""
    return min(max(1800.0 / max(count, 1), 8.0), 90.0)


def is_moving(bodies: Bodies) -> NDArray[np.bool_]:
    """Return which bodies can leave a trail, (bodies,)."""
    return bodies.has(*MOVING) | (~np.isnan(bodies.heading) & ~bodies.has(STRETCH))


def label(kind: str, state: str, kinds: Sequence[str] = ()) -> str:
    """Return the label of a body in legends. kinds: names of kinds of agents, which are used alone."""
    if kind == "agent" and any(state == name or state.startswith(f"{name}, ") for name in kinds):
        return state
    return f"{kind}, {state}" if state else kind


def to_rgb(color: str) -> tuple[int, int, int]:
    """Convert '#0072B2' to (0, 114, 178)."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def to_hex(channels: NDArray[np.float64]) -> str:
    """Convert channels in 0..1 to '#0072B2'."""
    return "#" + "".join(f"{round(255 * float(channel)):02X}" for channel in channels)


def mix(color: str, ground: str, share: float) -> str:
    """Mix a colour with its background; share 1 is the colour, 0 the background."""
    channels = (round(b + share * (c - b)) for c, b in zip(to_rgb(color), to_rgb(ground), strict=True))
    return "#" + "".join(f"{channel:02X}" for channel in channels)


def is_bright(colors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether dark lines are more visible on colours than white lines; colors: (..., 3), 0..1."""
    return np.asarray(colors @ np.array([0.3, 0.59, 0.11]) > 0.6)


def floor_color(grey: float) -> str:
    """Return the colour of a grey floor (0 black to 1 white) on a light background."""
    black, middle, white = FLOOR["light"]
    return mix(middle, black, 2 * grey) if grey < 0.5 else mix(white, middle, 2 * grey - 1)


_NEAR_GREY = 0.01
"""Tolerance of grey levels, since 8-bit pictures have no exact half."""


def describe_floor(grey: float, names: Iterable[str]) -> str:
    """Return the label of a grey floor in legends."""
    levels = ((0.0, "black floor"), (0.5, "grey floor"), (1.0, "white floor"))
    matches = (name for level, name in levels if abs(grey - level) < _NEAR_GREY)
    color = next(matches, f"floor, grey {grey:.3g}")
    name_list = ", ".join(dict.fromkeys(name for name in names if name and f"{name} floor" != color))
    return f"{color} ({name_list})" if name_list else color


def floor_labels(*scenes: Scene) -> dict[float, str]:
    """Return the labels of the floor and its patches in scenes, by grey value."""
    names_by_grey: dict[float, list[str]] = {}
    for scene in scenes:
        for part in ([] if scene.floor is None else [floor_patch(scene)]) + list(scene.patches):
            names_by_grey.setdefault(round(float(part.grey), 3), []).append(part.name)
    return {grey: describe_floor(grey, names) for grey, names in sorted(names_by_grey.items())}


def floor_patch(scene: Scene) -> Patch:
    """Return the floor of a scene as a patch."""
    floor = scene.floor if isinstance(scene.floor, Patch) else Patch(float(scene.floor or 0.0))
    if len(floor.points):
        return floor
    return Patch.rectangle((0.0, 0.0), (scene.width, scene.height), floor.grey, floor.name)


def value_colors(shares: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the colours of relative values (0..1): (n, 3), 0..1."""
    anchors = np.array([to_rgb(color) for color in VALUES]) / 255
    at = np.linspace(0, 1, len(anchors))
    clipped = np.clip(shares, 0, 1)
    return np.stack([np.interp(clipped, at, anchors[:, channel]) for channel in range(3)], axis=1)


def lighten(color: str) -> str:
    """Lighten a colour to have enough contrast on a dark background."""
    share = 1.0
    while share > 0.1 and luminance(mix(color, PAPER, share)) < _DARK_LEAST:
        share -= 0.05
    return mix(color, PAPER, share)


_DARK_LEAST = 0.22
"""Least relative luminance on a dark background."""


def luminance(color: str) -> float:
    """Return the relative luminance of WCAG 2, 0..1."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in np.array(to_rgb(color)) / 255
    ]
    return float(0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2])


def build_palette(
    custom: Iterable[str] = (), grounds: Iterable[str] = (), *, values: bool = False, states: int = 0
) -> list[int]:
    """Return all colours of a picture with shades, as red, green, blue, red, ... (0..255); at most 256.

    custom: colours of bodies, beside the default colours. grounds: colours of the floor. values: whether
    bodies are coloured by value. states: number of controller states that determine colours.
    """
    defaults = set(LIGHT.values())
    grounds, custom = list(grounds)[:24], [color for color in custom if color not in defaults][:24]
    further = [state_color(state) for state in range(min(states, len(STATES)))]
    shaded: Sequence[str] = list(dict.fromkeys([*LIGHT.values(), INK, BORDER, *custom, *further]))
    exact = [PAPER, FIELD, GRID, mix(GRID, FIELD, 0.5), *grounds]
    if values:
        exact += [to_hex(color) for color in value_colors(_RAMP)]
    shades = min(SHADES, (256 - len(exact)) // len(shaded))
    colors = [to_rgb(mix(color, FIELD, 1 - i / shades)) for color in shaded for i in range(shades)]
    return [channel for color in [*colors, *map(to_rgb, exact)] for channel in color]


_RAMP = np.linspace(0, 1, 24)
