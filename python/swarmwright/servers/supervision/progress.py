"""Shared memory in which a server process notes its work, and which outlives it."""

import os
import struct
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import Self

_NUMBERS = struct.Struct("<6Q")
_ALL = 2**64 - 1


@dataclass(frozen=True)
class Sample:
    """What a server was computing when it was looked at; see `_engine.serve`."""

    request: int = 0
    first: int = 0
    """Index of the first candidate in the request."""
    candidates: int = 0
    """0 when nothing of a request was being computed."""
    episode: int | None = None
    """Index of the episode in the request; None for all of them. Without candidates: None when nothing was
    computed, else episodes were stepped, of which only the tool knows which ones."""
    ended: int = 0
    """Evaluations that have ended since the process started."""
    beats: int = 0
    """Signs of life."""

    @classmethod
    def read(cls, file: int) -> Self:
        """Return what stands in an open file."""
        data = os.pread(file, _NUMBERS.size, 0)
        if len(data) < _NUMBERS.size:
            return cls()
        request, first, candidates, episode, ended, beats = _NUMBERS.unpack(data)
        return cls(request, first, candidates, None if episode == _ALL else episode, ended, beats)

    @property
    def is_at_work(self) -> bool:
        """Whether something was being computed."""
        return self.candidates > 0 or self.episode is not None

    @property
    def is_stepped(self) -> bool:
        """Whether episodes were being stepped."""
        return self.is_at_work and not self.candidates

    def goes_on_with(self, before: Self) -> bool:
        """Whether the request or the stepped episodes of a sample before were still being computed."""
        if before.candidates:
            return self.candidates > 0 and self.request == before.request
        return before.is_stepped and self.is_stepped and self.ended == before.ended

    @property
    def place(self) -> tuple[int, int, int, int | None] | None:
        """What was computed, as `_engine.Supervision.ended` takes it; None for nothing."""
        return (self.request, self.first, self.candidates, self.episode) if self.candidates else None


class Progress:
    """The memory of one process."""

    def __init__(self) -> None:
        if hasattr(os, "memfd_create"):
            self.file = os.memfd_create("swarmwright")
        else:
            with TemporaryFile() as file:
                self.file = os.dup(file.fileno())

    def read(self) -> Sample:
        """Return the current content."""
        return Sample.read(self.file)

    def close(self) -> None:
        """Release the memory."""
        os.close(self.file)
