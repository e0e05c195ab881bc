"""A replay as a page that notebooks display."""

import html
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.display.page import format_page
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
    html: str
    """The page: a self-contained HTML document."""

    @classmethod
    def of(cls, run: "Run", *, speed: float = 1.0, **options: Any) -> Self:  # noqa: ANN401 - as `Replay.of` takes it
        """Compute the episode; see `Run.replay`."""
        replay = Replay.of(run, **options)
        recording = replay.recording()
        return cls(
            replay.title,
            recording.fitness,
            format_page([replay.part(recording)], caption=replay.caption(recording), speed=speed),
        )

    @check_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write the page for a browser; `swarmwright replay --save` writes pictures and videos.

        Raises InputError for a suffix other than .html, and when the file cannot be written.
        """
        if Path(path).suffix.lower() not in {".html", ".htm"}:
            raise InputError(
                f"path: {path}: must end with .html; use `swarmwright replay --save` for other formats"
            )
        write_text(path, self.html)

    def _repr_html_(self) -> str:
        """Return a frame that isolates the page from the scripts and styles of the notebook."""
        return (
            f'<iframe title="{html.escape(self.title)}" srcdoc="{html.escape(self.html)}" '
            'sandbox="allow-scripts" width="100%" height="620" style="border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        """Return the title and the fitness."""
        return f"<ReplayPage {self.title}, fitness {self.fitness + 0.0:.6g}>"
