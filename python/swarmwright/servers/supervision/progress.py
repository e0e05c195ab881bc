"""Shared memory in which a server process records its work, and which outlives it."""

import os
import struct
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import Self

_NUMBERS = struct.Struct("<6Q")
_ALL = 2**64 - 1


@dataclass(frozen=True)
class Sample:
    """A snapshot of a server's work; see `_engine.serve`."""

    request: int = 0
    first: int = 0
    """Index of the first candidate in the request."""
    candidates: int = 0
    """Number of candidates; 0 outside a request."""
    episode: int | None = None
    """Index of the episode in the request; None for all of them. Without candidates: None when idle, else
    episodes are being stepped, whose numbers only the tool knows."""
    ended: int = 0
    """Evaluations finished since the process started."""
    beats: int = 0
    """Signs of life."""

    @classmethod
    def read(cls, file: int) -> Self:
        """Read a sample from an open file."""
        data = os.pread(file, _NUMBERS.size, 0)
        if len(data) < _NUMBERS.size:
            return cls()
        request, first, candidates, episode, ended, beats = _NUMBERS.unpack(data)
        return cls(request, first, candidates, None if episode == _ALL else episode, ended, beats)

    @property
    def is_at_work(self) -> bool:
        """Whether the server was computing."""
        return self.candidates > 0 or self.episode is not None

    @property
    def is_stepped(self) -> bool:
        """Whether episodes were being stepped."""
        return self.is_at_work and not self.candidates

    def continues(self, before: Self) -> bool:
        """Whether the server still works on the request or stepped episodes of an earlier sample."""
        if before.candidates:
            return self.candidates > 0 and self.request == before.request
        return before.is_stepped and self.is_stepped and self.ended == before.ended

    @property
    def position(self) -> tuple[int, int, int, int | None] | None:
        """The current work, as `_engine.Supervision.ended` takes it, or None."""
        return (self.request, self.first, self.candidates, self.episode) if self.candidates else None


class Progress:
    """The shared memory of one process."""

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
