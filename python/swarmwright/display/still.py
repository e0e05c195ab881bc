"""Stills that show all trajectories (PNG)."""

import io
from pathlib import Path

from swarmwright.common.plain_figures import use_plain_settings
from swarmwright.display._episode import Caption, Part, Shown
from swarmwright.display.drawing import Picture


@use_plain_settings()
def write(
    part: Part,
    path: Path,
    *,
    caption: Caption,  # noqa: ARG001
    speed: float = 1.0,  # noqa: ARG001
    shown: Shown | None = None,
) -> None:
    """Write a PNG of 1008 pixels in width. Raises OSError."""
    picture = Picture(part, dpi=144, shown=shown, still=True)
    recording = part.recording
    picture.draw(recording.scenes[-1], len(recording.scenes) - 1)
    buffer = io.BytesIO()
    picture.figure.savefig(buffer, format="png")
    path.write_bytes(buffer.getvalue())
