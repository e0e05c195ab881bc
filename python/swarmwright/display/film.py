"""Videos (MP4, H.264), encoded by ffmpeg.

The ffmpeg on the path is used, or that of the package imageio-ffmpeg.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from swarmwright.common.errors import InputError, RunError
from swarmwright.display._episode import Caption, Part, Shown
from swarmwright.display.animation import compute_pace, interpolate_scenes
from swarmwright.display.drawing import Picture

if TYPE_CHECKING:
    from PIL.Image import Image

FRAME_SECONDS = 1 / 30
"""Duration of a frame of a video."""
MOST_FRAMES = 3000
LAST_FRAME_SECONDS = 2.0


def write(
    part: Part,
    path: Path,
    *,
    caption: Caption,
    speed: float = 1.0,
    shown: Shown | None = None,
) -> None:
    """Write an MP4 of 980 pixels in width that every browser plays.

    Raises InputError when there is no ffmpeg, RunError when it fails, OSError.
    """
    recording = part.recording
    step_seconds = max(recording.step_size, 0.02) / speed
    count, seconds = compute_pace(
        len(recording.scenes), step_seconds, frame_seconds=FRAME_SECONDS, most=MOST_FRAMES
    )
    picture = Picture(part, dpi=140, shown=shown)
    images = (picture.image(scene, time) for scene, time in interpolate_scenes(recording.scenes, count))
    encode(images, seconds, path, title=caption.title)


def encode(images: "Iterator[Image]", seconds: float, path: Path, *, title: str) -> None:
    """Write RGB images of one size as an MP4, each shown for `seconds`. Raises as `write`."""
    ffmpeg = _find_ffmpeg(path)
    first = next(images)
    # 4:2:0 colour needs even sides.
    width, height = first.width // 2 * 2, first.height // 2 * 2
    command = [
        ffmpeg, "-loglevel", "error", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{1 / seconds:.6f}",
        "-i", "-",
        "-an", "-c:v", "libx264", "-crf", "20", "-preset", "veryfast", "-pix_fmt", "yuv420p",
        "-metadata", f"title={title}", "-movflags", "+faststart", "-f", "mp4", str(path.absolute()),
    ]  # fmt: skip
    box = (0, 0, width, height)
    with tempfile.TemporaryFile() as output:
        encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=output)
        assert encoder.stdin is not None
        try:
            with encoder.stdin as frames:
                frames.write(first.crop(box).tobytes())
                last = first
                for last in images:
                    frames.write(last.crop(box).tobytes())
                for _ in range(round(LAST_FRAME_SECONDS / seconds)):
                    frames.write(last.crop(box).tobytes())
        except BrokenPipeError:
            pass  # its error is reported below
        except BaseException:
            encoder.kill()
            raise
        finally:
            status = encoder.wait()
        if status:
            output.seek(0)
            reason = output.read().decode(errors="replace").strip().splitlines()
            raise RunError(f"{path}: ffmpeg could not write the video: {reason[-1] if reason else status}")


def _find_ffmpeg(path: Path) -> str:
    """Find ffmpeg."""
    executable = shutil.which("ffmpeg")
    if executable:
        return executable
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError(
            f"{path}: ffmpeg, which encodes videos, was not found; install it, e.g. with "
            "'pip install imageio-ffmpeg', or write a .gif or .html"
        ) from None
