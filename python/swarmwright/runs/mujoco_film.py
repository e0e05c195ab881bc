"""A video of robots in three dimensions: `python -m swarmwright.runs.mujoco_film RUN FILE.gif`.

The best controller of a run is played in one of its episodes and rendered by MuJoCo. Where there is no screen
the environment variable MUJOCO_GL says how: osmesa (Debian's package libosmesa6), or egl (libegl1).
"""

import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from PIL import Image

from swarmwright.common.errors import InputError, SwarmwrightError
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.controller import Controller
from swarmwright.runs.code import used_for
from swarmwright.runs.run import Run
from swarmwright.simulations.loading import load
from swarmwright.simulations.mujoco import undrawable
from swarmwright.simulations.mujoco._library import cannot_draw
from swarmwright.simulations.mujoco._robots import Robots
from swarmwright.simulations.parameters import fill_parameters, parse_parameters

# After swarmwright.simulations.mujoco, which imports it also where it cannot draw.
import mujoco  # isort: skip

COLORS = 200
LAST_FRAME_MS = 1500  # milliseconds


def frames(
    robots: Robots, controller: Controller, parameters: dict[str, object], seed: int, size: tuple[int, int]
) -> list[Image.Image]:
    """Run an episode and return a picture of every second step.

    Args:
        robots: the simulation.
        controller: of every robot.
        parameters: all of the simulation's.
        seed: of the episode.
        size: width and height in pixels.
    """
    seen: Any = robots.reset(parameters, seed)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0, -robots.arena.depth / 20, 0.2)
    camera.distance = 1.25 * max(robots.arena.width, robots.arena.depth)
    camera.azimuth, camera.elevation = 90, -55
    found = []
    if undrawable is not None:
        raise cannot_draw(undrawable) from undrawable
    try:
        renderer = mujoco.Renderer(robots.model, size[1], size[0])
    except (mujoco.FatalError, ImportError, AttributeError, OSError, RuntimeError) as error:
        raise cannot_draw(error) from error
    try:
        step = 0
        while True:
            if step % 2 == 0 or robots.done():
                renderer.update_scene(robots.data, camera)
                found.append(Image.fromarray(renderer.render()))
            if robots.done():
                return found
            actions = controller(np.asarray(seen, np.float32))
            acting = robots.acting()
            if acting is not None:
                actions = np.where(np.asarray(acting)[:, None], actions, np.float32(0))
            seen = robots.step(actions)
            step += 1
    finally:
        renderer.close()


def write(run: Run, path: Path, *, episode: int = 0, size: tuple[int, int] = (480, 360)) -> None:
    """Write a GIF of the best controller of a run, twice as fast as real time.

    Args:
        run: whose best controller is shown.
        path: of the file, which ends with .gif.
        episode: number of the episode, from 0, among those of the best controller's generation.
        size: width and height in pixels.

    Raises InputError when the run is of another simulation or has no such episode, the file is not a GIF, or
    nothing can be drawn here, OSError.
    """
    if path.suffix.lower() != ".gif":
        raise InputError(f"{path}: the video is a GIF; give a name that ends with .gif")
    kind = load(used_for(run, run.best.generation).simulation)
    if not issubclass(kind, Robots):
        raise InputError(f"{run.path}: {run.experiment.label} is not a MuJoCo robot simulation")
    parameters = dict(run.experiment.parameters)
    parameters.pop("seed", None)
    values = fill_parameters(parse_parameters(kind.parameters, kind.__name__), parameters)
    seeds = run.seeds(run.best.generation)
    if not 0 <= episode < len(seeds):
        raise InputError(
            f"episode: {episode}: {run.path} has {len(seeds)} episode(s) of a candidate; give a number from "
            f"0 to {len(seeds) - 1}"
        )
    pictures = frames(kind(), run.best.controller, values, seeds[episode], size)
    # Include rare colours: robots are small.
    palette = _strip(pictures[:: max(1, len(pictures) // 4)]).quantize(COLORS)
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [round(1000 * kind.frame_seconds)] * (len(indexed) - 1) + [LAST_FRAME_MS]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=durations, loop=0, optimize=True)


def _strip(pictures: list[Image.Image]) -> Image.Image:
    """Put pictures of one size side by side."""
    width, height = pictures[0].size
    strip = Image.new("RGB", (width * len(pictures), height))
    for place, picture in enumerate(pictures):
        strip.paste(picture, (width * place, 0))
    return strip


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--episode", type=click.IntRange(0), default=0, help="One of the run's.")
def main(run: Path, file: Path, episode: int) -> None:
    """Write a FILE.gif of the best controller of a RUN."""
    try:
        write(Run.open(run), file, episode=episode)
    except (SwarmwrightError, OSError) as error:
        click.echo(f"swarmwright: {escape_line(str(error))}", err=True)
        sys.exit(2 if isinstance(error, InputError) else 1)


if __name__ == "__main__":
    main()
