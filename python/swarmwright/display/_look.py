"""How things look: colours, markers, sizes."""

from typing import NamedTuple

from swarmwright.display._scene import Body, Scene

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#8C8C8C"
INK, BORDER, GRID, FIELD, PAPER = "#222222", "#555555", "#E4E4DE", "#FAFAF7", "#FFFFFF"
AGENT_COLORS = {"free": BLUE, "arrived": GREEN, "out": GREEN, "caught": GREY, "crashed": GREY}
CELLS = ("blockade", "exit")
"""What fills a cell of a grid, one unit wide and high."""
SHADES = 16


class Look(NamedTuple):
    """Colour, marker (matplotlib's names), marker area in points squared, layer (higher is above)."""

    color: str
    marker: str
    size: float
    layer: float


def look(kind: str, state: str, agent_size: float) -> Look:
    """How a body of this kind and state is drawn."""
    if kind == "agent":
        return Look(
            AGENT_COLORS.get(state, BLUE), "X" if state in {"caught", "crashed"} else "o", agent_size, 4.0
        )
    return {
        "defender": Look(RED, "^", max(agent_size, 30.0), 3.0),
        "goal": Look(GREEN, "*", 190.0, 2.5),
        "exit": Look(ORANGE, "s", 60.0, 1.6),
        "blockade": Look(BORDER, "s", 45.0, 1.6),
        "obstacle": Look(BORDER, "o", 12.0, 1.6),
    }.get(kind, Look(ORANGE, "D", 40.0, 2.5))


def agent_size(scene: Scene) -> float:
    """Marker area of an agent in points squared: smaller the more there are."""
    return min(max(1800.0 / max(len(scene.of_kind("agent")), 1), 8.0), 90.0)


def label(body: Body) -> str:
    """What the legend calls a body."""
    return f"{body.kind}, {body.state}" if body.kind == "agent" and body.state else body.kind


def rgb(color: str) -> tuple[int, int, int]:
    """'#0072B2' -> (0, 114, 178)."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def mixed(color: str, ground: str, share: float) -> str:
    """A colour thinned with its background; share 1 is the colour, 0 the background."""
    channels = (round(b + share * (c - b)) for c, b in zip(rgb(color), rgb(ground), strict=True))
    return "#" + "".join(f"{channel:02X}" for channel in channels)


def palette() -> list[int]:
    """Every colour of a picture with its shades, as red, green, blue, red, ... (0..255)."""
    shaded = [BLUE, ORANGE, GREEN, RED, GREY, INK, BORDER]
    colors = [rgb(mixed(color, FIELD, 1 - i / SHADES)) for color in shaded for i in range(SHADES)]
    colors += [rgb(PAPER), rgb(FIELD), rgb(GRID), rgb(mixed(GRID, FIELD, 0.5))]
    return [channel for color in colors for channel in color]
