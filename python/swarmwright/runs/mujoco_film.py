"""Write a video of robots in three dimensions: `python -m swarmwright.runs.mujoco_film RUN FILE.gif`.

MuJoCo renders an episode of a run's best controller. Without a screen, set the environment variable MUJOCO_GL
to osmesa (Debian's package libosmesa6) or egl (libegl1).
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
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.run import Run
from swarmwright.simulations.loading import load
from swarmwright.simulations.mujoco import cannot_draw, undrawable
from swarmwright.simulations.mujoco._robots import Robots
from swarmwright.simulations.parameters import fill_parameters, parse_parameters

# After swarmwright.simulations.mujoco, which imports it even if it cannot draw.
import mujoco  # isort: skip

COLORS = 200
LAST_FRAME_MS = 1500


def render_frames(
    robots: Robots, controller: Controller, parameters: dict[str, object], seed: int, size: tuple[int, int]
) -> list[Image.Image]:
    """Run an episode and return a picture of every second step.

    Args:
        robots: the simulation.
        controller: controller of every robot.
        parameters: all parameters of the simulation.
        seed: seed of the episode.
        size: width and height in pixels.
    """
    sensors: Any = robots.reset(parameters, seed)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0, -robots.arena.depth / 20, 0.2)
    camera.distance = 1.25 * max(robots.arena.width, robots.arena.depth)
    camera.azimuth, camera.elevation = 90, -55
    pictures = []
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
                pictures.append(Image.fromarray(renderer.render()))
            if robots.done():
                return pictures
            actions = controller(np.asarray(sensors, np.float32))
            acting = robots.acting()
            if acting is not None:
                actions = np.where(np.asarray(acting)[:, None], actions, np.float32(0))
            sensors = robots.step(actions)
            step += 1
    finally:
        renderer.close()


def write(run: Run, path: Path, *, episode: int = 0, size: tuple[int, int] = (480, 360)) -> None:
    """Write a GIF of the best controller of a run, at twice the real speed.

    Args:
        run: the run.
        path: path of the file, which ends with .gif.
        episode: index of an episode of the best controller's generation, from 0.
        size: width and height in pixels.

    Raises InputError when the run has another simulation or lacks the episode, the file is not a GIF, or
    MuJoCo cannot draw on this machine; OSError when the file cannot be written.
    """
    if path.suffix.lower() != ".gif":
        raise InputError(f"{path}: the video is a GIF; choose a file name that ends with .gif")
    kind = load(resolve_experiment(run, run.best.generation).simulation)
    if not issubclass(kind, Robots):
        raise InputError(f"{run.path}: {run.experiment.label} is not a MuJoCo robot simulation")
    parameters = dict(run.experiment.parameters)
    parameters.pop("seed", None)
    values = fill_parameters(parse_parameters(kind.parameters, kind.__name__), parameters)
    seeds = run.seeds(run.best.generation)
    if not 0 <= episode < len(seeds):
        raise InputError(
            f"episode: {episode}: candidates of {run.path} have {len(seeds)} episode(s); choose a number "
            f"from 0 to {len(seeds) - 1}"
        )
    pictures = render_frames(kind(), run.best.controller, values, seeds[episode], size)
    # Include rare colours: robots are small.
    palette = _join_pictures(pictures[:: max(1, len(pictures) // 4)]).quantize(COLORS)
    indexed = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    durations = [round(1000 * kind.frame_seconds)] * (len(indexed) - 1) + [LAST_FRAME_MS]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=durations, loop=0, optimize=True)


def _join_pictures(pictures: list[Image.Image]) -> Image.Image:
    """Join pictures of the same size side by side."""
    width, height = pictures[0].size
    strip = Image.new("RGB", (width * len(pictures), height))
    for index, picture in enumerate(pictures):
        strip.paste(picture, (width * index, 0))
    return strip


@click.command()
@click.argument("run", type=click.Path(path_type=Path))
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--episode", type=click.IntRange(0), default=0, help="Index of the episode.")
def main(run: Path, file: Path, episode: int) -> None:
    """Write an animation of the best controller of a RUN to FILE.gif."""
    try:
        write(Run.open(run), file, episode=episode)
    except (SwarmwrightError, OSError) as error:
        click.echo(f"swarmwright: {escape_line(str(error))}", err=True)
        sys.exit(2 if isinstance(error, InputError) else 1)


if __name__ == "__main__":
    main()
