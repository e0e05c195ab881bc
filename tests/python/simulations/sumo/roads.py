"""Networks, routes and configurations of SUMO for tests."""

import math
from pathlib import Path

SIDES = {"n": (0, 1), "e": (1, 0), "s": (0, -1), "w": (-1, 0)}


def written(folder: Path, network: str, routes: str, step: float = 0.5) -> str:
    """Write a configuration; return its path."""
    (folder / "net.xml").write_text(network)
    (folder / "rou.xml").write_text(f"<routes>{routes}</routes>")
    (folder / "town.sumocfg").write_text(
        '<configuration><net-file value="net.xml"/><route-files value="rou.xml"/>'
        f'<step-length value="{step}"/><collision.action value="warn"/></configuration>'
    )
    return str(folder / "town.sumocfg")


def ring(length: float = 230.0) -> str:
    """A ring of one lane and four edges, e0 to e3; 30 m/s are allowed."""
    radius = length / math.tau

    def at(part: float) -> str:
        return (
            f"{radius * (1 + math.cos(part * math.tau)):.2f},{radius * (1 + math.sin(part * math.tau)):.2f}"
        )

    boundary = f'netOffset="0,0" convBoundary="0,0,{2 * radius},{2 * radius}" origBoundary="0,0,1,1"'
    lines = [f'<location {boundary} projParameter="!"/>']
    for i in range(4):
        shape = " ".join(at((i + j / 8) / 4) for j in range(9))
        lane = f'<lane id="e{i}_0" index="0" speed="30" length="{length / 4}" shape="{shape}"/>'
        lines.append(f'<edge id="e{i}" from="n{i}" to="n{(i + 1) % 4}">{lane}</edge>')
    for i in range(4):
        x, y = at(i / 4).split(",")
        lines.append(
            f'<junction id="n{i}" type="unregulated" x="{x}" y="{y}" incLanes="e{(i - 1) % 4}_0" '
            'intLanes=""/>'
        )
    lines += [
        f'<connection from="e{i}" to="e{(i + 1) % 4}" fromLane="0" toLane="0" dir="s" state="M"/>'
        for i in range(4)
    ]
    return f'<net version="1.20">{"".join(lines)}</net>'


def drivers(length: float, kinds: list[str], sigma: float = 0.5) -> str:
    """One vehicle after the other on a ring, v0, v1, .., of the types agent or human."""
    types = "".join(
        f'<vType id="{kind}" carFollowModel="IDM" accel="1.3" decel="2" sigma="{sigma}" minGap="2.5"/>'
        for kind in ("agent", "human")
    )
    vehicles = []
    for number, kind in enumerate(kinds):
        edge, place = divmod(number * length / len(kinds), length / 4)
        edges = " ".join(f"e{(int(edge) + i) % 4}" for i in range(4))
        vehicles.append(
            f'<vehicle id="v{number}" type="{kind}" depart="0" departPos="{place:.2f}" departSpeed="0">'
            f'<route edges="{edges}" repeat="1000"/></vehicle>'
        )
    return types + "".join(vehicles)


def crossing(light: bool = True) -> str:
    """Two roads of 200 m that cross in the middle at a light, c, green to north and south at first."""
    lines = [
        '<location netOffset="0,0" convBoundary="0,0,200,200" origBoundary="0,0,1,1" projParameter="!"/>'
    ]
    for side, (x, y) in SIDES.items():
        beside = (1.6 * y, -1.6 * x)  # to the right of who leaves
        near, far = [(100 + far * x, 100 + far * y) for far in (7.2, 100.0)]
        out = [f"{px + beside[0]},{py + beside[1]}" for px, py in (near, far)]
        back = [f"{px - beside[0]},{py - beside[1]}" for px, py in (far, near)]
        for name, ends, shape in ((f"c_{side}", ("c", side), out), (f"{side}_c", (side, "c"), back)):
            lane = f'<lane id="{name}_0" index="0" speed="13.89" length="92.8" shape="{" ".join(shape)}"/>'
            lines.append(f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}">{lane}</edge>')
    if light:
        phases = (("42", "GrGr"), ("3", "yryr"), ("42", "rGrG"), ("3", "ryry"))
        states = "".join(f'<phase duration="{seconds}" state="{state}"/>' for seconds, state in phases)
        lines.append(f'<tlLogic id="c" type="static" programID="0" offset="0">{states}</tlLogic>')
    requests = "".join(
        f'<request index="{index}" response="{response}" foes="{foes}"/>'
        for index, (response, foes) in enumerate([("0000", "1010"), ("0101", "0101")] * 2)
    )
    kind = "traffic_light" if light else "priority"
    incoming = " ".join(f"{side}_c_0" for side in SIDES)
    corners = "93,93 107,93 107,107 93,107"
    lines.append(
        f'<junction id="c" type="{kind}" x="100" y="100" incLanes="{incoming}" intLanes="" shape="{corners}">'
        f"{requests}</junction>"
    )
    for side, (x, y) in SIDES.items():
        lines.append(
            f'<junction id="{side}" type="dead_end" x="{100 + 100 * x}" y="{100 + 100 * y}" '
            f'incLanes="c_{side}_0" intLanes=""/>'
        )
    for index, (side, opposite) in enumerate(zip("nesw", "swne", strict=True)):
        signal = f'tl="c" linkIndex="{index}"' if light else ""
        lines.append(
            f'<connection from="{side}_c" to="c_{opposite}" fromLane="0" toLane="0" {signal} dir="s" '
            f'state="{"Oo"[index % 2]}"/>'
        )
    return f'<net version="1.20">{"".join(lines)}</net>'


def flows(north: float, west: float) -> str:
    """Vehicles from the north to the south and from the west to the east, by chance, so many in a second."""
    return "".join(
        f'<flow id="{start}" from="{start}_c" to="c_{end}" begin="0" end="10000" probability="{share}"/>'
        for start, end, share in (("n", "s", north), ("w", "e", west))
        if share > 0
    )
