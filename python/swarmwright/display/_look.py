"""How things look: the one table of shapes and colours for pages, stills, animations and films."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from swarmwright.display._scene import Body, Scene

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
"""Colours of bodies on a light ground, by name; pages have them as CSS variables."""
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
"""The same on a dark ground."""
OTHERS = ("other-1", "other-2", "other-3", "other-4")
"""Colours of unknown kinds and states, in the order in which they are seen."""

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
"""Shapes of unknown kinds, in the order in which they are seen."""

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
"""What fills a cell of a grid, one unit wide and high."""
MOVING = ("agent", "defender")
"""What leaves a trail."""
SHADES = 16


class Look(NamedTuple):
    """A shape and the name of a colour."""

    shape: str
    color: str


class Marker(NamedTuple):
    """How matplotlib draws it: area in points squared, layer (higher is above)."""

    color: str
    marker: str
    size: float
    layer: float


class Looks:
    """How the bodies of an episode look, the same in all its scenes and on everything that shows it.

    Kinds and states of KNOWN look as there. A kind that is not there gets a shape, and a state that is not
    there a colour, in the order in which they are first seen, so that no two look alike as long as there
    are shapes and colours.
    """

    def __init__(self, scenes: Iterable[Scene]) -> None:
        self._looks: dict[tuple[str, str], Look] = {}
        self._shapes = {kind: shape for (kind, _), (shape, _) in reversed(KNOWN.items())}
        self._unknown = 0
        for scene in scenes:
            for body in scene.bodies:
                self._add(body.kind, body.state)

    def _add(self, kind: str, state: str) -> None:
        if (kind, state) in self._looks:
            return
        known = KNOWN.get((kind, state))
        if known is not None:
            self._looks[kind, state] = Look(*known)
            return
        if kind not in self._shapes:
            strangers = len(self._shapes) - len({kind for kind, _ in KNOWN})
            self._shapes[kind] = _FREE_SHAPES[strangers % len(_FREE_SHAPES)]
        color = OTHERS[self._unknown % len(OTHERS)]
        self._unknown += 1
        self._looks[kind, state] = Look(self._shapes[kind], color)

    def __getitem__(self, body: Body) -> Look:
        """Return the look of a body of the episode."""
        return self._looks[body.kind, body.state]

    def color(self, body: Body) -> str:
        """Return a body's colour on a light ground, as '#0072B2'."""
        return LIGHT[self[body].color]

    def plain(self) -> dict[str, dict[str, str]]:
        """Return label -> shape and name of the colour, in the order in which they are seen."""
        return {
            label(kind, state): {"shape": look.shape, "color": look.color}
            for (kind, state), look in self._looks.items()
        }

    def marker(self, body: Body, agent_size: float) -> Marker:
        """Return how matplotlib draws a body."""
        look = self[body]
        size, layer = {
            "agent": (agent_size, 4.0),
            "defender": (max(agent_size, 30.0), 3.0),
            "goal": (190.0, 2.5),
            "exit": (60.0, 1.6),
            "blockade": (45.0, 1.6),
            "obstacle": (12.0, 1.6),
        }.get(body.kind, (40.0, 2.5))
        return Marker(LIGHT[look.color], SHAPES[look.shape][0], size, layer)


def css() -> str:
    """Return the colours of bodies as CSS, for light and dark."""

    def variables(colors: dict[str, str]) -> str:
        return " ".join(f"--{name}: {value.lower()};" for name, value in colors.items())

    dark = variables(DARK)
    return (
        f":root {{ {variables(LIGHT)} }}\n"
        f'@media (prefers-color-scheme: dark) {{ :root:not([data-theme="light"]) {{ {dark} }} }}\n'
        f':root[data-theme="dark"] {{ {dark} }}'
    )


def agent_size(scene: Scene) -> float:
    """Marker area of an agent in points squared: smaller the more there are."""
    return min(max(1800.0 / max(len(scene.of_kind("agent")), 1), 8.0), 90.0)


def label(kind: str, state: str) -> str:
    """What legends call a body."""
    return f"{kind}, {state}" if state else kind


def rgb(color: str) -> tuple[int, int, int]:
    """'#0072B2' -> (0, 114, 178)."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def mixed(color: str, ground: str, share: float) -> str:
    """A colour thinned with its background; share 1 is the colour, 0 the background."""
    channels = (round(b + share * (c - b)) for c, b in zip(rgb(color), rgb(ground), strict=True))
    return "#" + "".join(f"{channel:02X}" for channel in channels)


def palette() -> list[int]:
    """Every colour of a picture with its shades, as red, green, blue, red, ... (0..255)."""
    shaded: Sequence[str] = list(dict.fromkeys([*LIGHT.values(), INK, BORDER]))
    colors = [rgb(mixed(color, FIELD, 1 - i / SHADES)) for color in shaded for i in range(SHADES)]
    colors += [rgb(PAPER), rgb(FIELD), rgb(GRID), rgb(mixed(GRID, FIELD, 0.5))]
    return [channel for color in colors for channel in color]
