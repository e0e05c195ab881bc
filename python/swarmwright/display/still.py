"""An episode as a still that shows all trajectories (PNG)."""

import io
from collections.abc import Sequence
from pathlib import Path

from swarmwright.core.plain_figures import plain
from swarmwright.display._caption import Caption
from swarmwright.display._episode import Recording
from swarmwright.display._shown import Shown
from swarmwright.display.drawing import Picture


@plain()
def write(
    recording: Recording,
    path: Path,
    *,
    caption: Caption,  # noqa: ARG001
    speed: float = 1.0,  # noqa: ARG001
    shown: Shown | None = None,
    state_names: Sequence[str] = (),
) -> None:
    """Write a PNG of 1008 pixels in width. Raises OSError."""
    picture = Picture(recording, dpi=144, shown=shown, state_names=state_names)
    picture.draw(recording.scenes[-1], len(recording.scenes) - 1)
    buffer = io.BytesIO()
    picture.figure.savefig(buffer, format="png")
    path.write_bytes(buffer.getvalue())
