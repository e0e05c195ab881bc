"""A replay as a page that notebooks display."""

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.display import Recording
from swarmwright.display.files import FORMATS
from swarmwright.display.files import save as save_scenes
from swarmwright.display.page import format_page, format_picture_page, pack_page, pack_picture_page
from swarmwright.display.pictures import PictureRecording
from swarmwright.display.pictures import save as save_pictures
from swarmwright.experiment.settings import parameter_settings
from swarmwright.runs.replay import Replay

if TYPE_CHECKING:
    from swarmwright.runs.run import Run


@dataclass(frozen=True)
class ReplayPage:
    """An episode to play, pause, step and scrub, from `Run.replay`. A notebook shows it below the cell."""

    title: str
    """Title with the simulation, the controller and the episode."""
    fitness: float
    """Fitness of the episode."""
    seed: int
    """Seed of the simulation."""
    _replay: Replay = field(repr=False, compare=False)
    _recording: Recording | PictureRecording = field(repr=False, compare=False)
    _speed: float = field(repr=False, compare=False)

    @classmethod
    def of(
        cls,
        run: "Run",
        *,
        speed: float = 1.0,
        most_bodies: int | None = None,
        **options: Any,  # noqa: ANN401 - as `Replay.of` takes it
    ) -> Self:
        """Compute the episode; see `Run.replay`."""
        replay = Replay.of(run, **options)
        recording = replay.pictures() if replay.is_pictured else replay.recording(most_bodies)
        return cls(replay.title, recording.fitness, replay.seed, replay, recording, speed)

    @cached_property
    def html(self) -> str:
        """The page: a self-contained HTML document."""
        caption = self._replay.caption(self._recording)
        if isinstance(self._recording, PictureRecording):
            return format_picture_page(self._recording, caption=caption, speed=self._speed)
        return format_page([self._replay.part(self._recording)], caption=caption, speed=self._speed)

    @check_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write the page (.html), an animation (.gif), a video (.mp4) or a picture of all paths (.png).

        Raises InputError for another suffix, when ffmpeg is missing for a video, and when the file cannot be
        written.
        """
        file = Path(path)
        ending = file.suffix.lower()
        if ending in {".html", ".htm"}:
            write_text(file, self.html)
            return
        if ending not in FORMATS:
            raise InputError(f"path: {path}: must end with {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
        caption = self._replay.caption(self._recording)
        try:
            if isinstance(self._recording, PictureRecording):
                save_pictures(self._recording, file, caption=caption, speed=self._speed)
            else:
                part = self._replay.part(self._recording)
                save_scenes([part], file, caption=caption, speed=self._speed)
        except OSError as error:
            raise InputError(f"path: {path}: cannot be written: {error.strerror or error}") from error

    def _repr_html_(self) -> str:
        """Return a frame that isolates the page from the scripts and styles of the notebook."""
        return (
            f'<iframe title="{html.escape(self.title)}" srcdoc="{html.escape(self.html)}" '
            'sandbox="allow-scripts" width="100%" height="620" style="border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        """Return the title and the fitness."""
        return f"<ReplayPage {self.title}, fitness {self.fitness + 0.0:.6g}>"


@dataclass(frozen=True)
class PackedEpisode:
    """An episode for a player that is open: a page of `swarmwright.display.page.format_player`."""

    seed: int
    """Seed of the simulation."""
    content: bytes
    is_whole: bool
    """Whether the recording goes to the end of the episode."""


def pack_replay(
    run: "Run",
    *,
    beginning: int,
    parameters: Mapping[str, Any] | None = None,
    most_bodies: int | None = None,
    **options: Any,  # noqa: ANN401 - as `Replay.of` takes it
) -> Iterator[PackedEpisode]:
    """Yield the beginning of an episode of a run as soon as it is computed, and then the whole.

    A short episode, and one in pictures, comes as a whole only.

    Args:
        run: has the candidate.
        beginning: steps, at least 1.
        parameters: as in `Run.replay`.
        most_bodies: as in `Run.replay`.
        options: generation, candidate, episode, seed and broker, as in `Run.replay`.

    Raises the errors of `Run.replay`.
    """
    replay = Replay.of(run, settings=parameter_settings(parameters or {}), **options)
    if replay.is_pictured:
        drawn = replay.pictures()
        yield PackedEpisode(
            replay.seed, pack_picture_page(drawn, caption=replay.caption(drawn)), is_whole=True
        )
        return
    for recording, is_whole in replay.recordings(beginning, most_bodies):
        # The fitness of the episode is that at its end.
        caption = replay.caption(recording if is_whole else None)
        yield PackedEpisode(
            replay.seed, pack_page([replay.part(recording)], caption=caption), is_whole=is_whole
        )
