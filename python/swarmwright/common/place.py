"""Paths that stay right when a process changes its working folder."""

from contextlib import suppress
from pathlib import Path


class Place:
    """What a path named when it was given, wherever the process works later."""

    def __init__(self, given: Path) -> None:
        self._given = given
        self._working = None if given.is_absolute() else _working_folder()

    @property
    def path(self) -> Path:
        """The path: as it was given where that is right, absolute where the working folder is another one."""
        stays = self._working is None or self._working == _working_folder()
        return self._given if stays else self.absolute

    @property
    def absolute(self) -> Path:
        """The absolute path."""
        return self._given if self._working is None else self._working / self._given


def _working_folder() -> Path | None:
    """Return the working folder; None when it was deleted."""
    with suppress(OSError):
        return Path.cwd()
    return None
