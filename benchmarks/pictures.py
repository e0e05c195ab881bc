"""The same episode in every simulator that is installed, at the same times, side by side.

`python -m benchmarks.pictures FOLDER [--mission NAME] [--design NAME] [--seed N] [--times A,B]` plays an
episode of a controller that `benchmarks.missions` designs (FOLDER keeps the designs of both) in every
simulator, from the scenes that they send, and draws FOLDER/simulators.png: a row for each simulator.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.missions import (
    BUDGET,
    CONTROLLERS,
    FIRST_SEED,
    MISSIONS,
    TICKS_PER_SECOND,
    chosen,
    design,
    there,
)
from benchmarks.places import PLACES, Place, running
from benchmarks.processes import Broker, embedded
from swarmwright import Run
from swarmwright.controllers.controller import Controller
from swarmwright.display import Bodies, Recording, Scene
from swarmwright.display._look import to_rgb
from swarmwright.display.drawing import draw_ground, draw_robots
from swarmwright.display.figures.style import COLORS, INK, new_figure
from swarmwright.runs.replay import Replay

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TIMES = "0,10,30,60"
"""Seconds."""
PANEL = 2.6
"""Width of a picture, inches."""
TRAIL_SECONDS = 3


def played(run: Run, place: Place, seed: int, broker: Broker) -> Recording:
    """Play an episode of the best controller of a run in a simulator."""
    controller = Controller(run.best.specification)
    address = None if place.command is None else broker.url
    replay = Replay(
        run=run,
        controller=controller,
        source=run.path,
        seed=seed,
        experiment=there(run, place),
        broker=address,
    )
    return replay.recording()


def draw(recordings: Mapping[str, Recording], times: Sequence[float]) -> "Figure":
    """Draw a row for each simulator, a column for each time."""
    first = next(iter(recordings.values())).scenes[0]
    height = PANEL * first.height / first.width
    figure = new_figure(PANEL * len(times) + 0.5, (height + 0.1) * len(recordings) + 0.3)
    fields = figure.subplots(len(recordings), len(times), squeeze=False)
    for row, (name, recording) in zip(fields, recordings.items(), strict=True):
        for field, seconds in zip(row, times, strict=True):
            index = min(round(seconds * TICKS_PER_SECOND), len(recording.scenes) - 1)
            _panel(field, recording.scenes[max(0, index - TRAIL_SECONDS * TICKS_PER_SECOND) : index + 1])
        row[0].set_ylabel(name, fontsize=13, color=INK)
    for field, seconds in zip(fields[0], times, strict=True):
        field.set_title(f"{seconds:g} s", fontsize=13, color=INK)
    return figure


def _panel(field: "Axes", scenes: Sequence[Scene]) -> None:
    """Draw a scene, with the ways of robots in those before it."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    scene = scenes[-1]
    field.set(xlim=(0, scene.width), ylim=(0, scene.height), aspect="equal", xticks=[], yticks=[])
    for side in field.spines.values():
        side.set_visible(False)
    for drawn in draw_ground(field, scene):
        if isinstance(drawn, Line2D) and drawn.get_marker() == "o":  # a lamp hides what is below it
            drawn.set_markersize(3)
    bodies = Bodies.from_bodies(scene.bodies)
    agents = bodies.has("agent")
    ways = np.array([[(body.x, body.y) for body in Bodies.from_bodies(one.bodies)] for one in scenes])[
        :, agents
    ]
    color = np.array(to_rgb(COLORS[0])) / 255
    field.add_collection(
        LineCollection(list(ways.transpose(1, 0, 2)), colors=color, alpha=0.45, linewidths=0.8, zorder=2.0)
    )
    scale = 72 * PANEL / scene.width
    draw_robots(field, bodies, agents, np.tile(color, (int(agents.sum()), 1)), scale, valued=False)


def main() -> None:
    """Draw what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pictures", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--mission", choices=MISSIONS, default=MISSIONS[0], help="default: %(default)s")
    parser.add_argument("--design", choices=CONTROLLERS, default=CONTROLLERS[0], help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, metavar="N", help="default: %(default)s")
    parser.add_argument("--times", default=TIMES, metavar="A,B", help="seconds; default: %(default)s")
    parser.add_argument("--budget", type=int, default=BUDGET, metavar="N", help="default: %(default)s")
    names = [place.name for place in PLACES]
    parser.add_argument("--simulators", default=",".join(names), metavar="A,B", help="default: %(default)s")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    wanted = chosen(arguments.simulators, names, "simulator")
    run = design(arguments.folder, arguments.mission, arguments.design, arguments.budget)
    recordings = {}
    with embedded() as broker:
        for place in PLACES:
            if place.name not in wanted:
                continue
            why = place.missing()
            if why is not None:
                print(f"{place.name} is skipped: {why}", file=sys.stderr, flush=True)
                continue
            with running(place, broker):
                recordings[place.name] = played(run, place, arguments.seed, broker)
            fitness = recordings[place.name].fitness
            print(f"{place.name}: fitness {fitness:.4g}", flush=True)
    figure = draw(recordings, [float(one) for one in arguments.times.split(",")])
    figure.savefig(arguments.folder / "simulators.png", dpi=100)


if __name__ == "__main__":
    main()
