"""Lines of a command's standard output: which are answers, and what has come of the next one."""

from swarmwright.simulations.command.failure import CommandFailure

CHUNK_BYTES = 1 << 16
"""Read at a time."""
_LONGEST_LINE_BYTES = 1 << 26
"""Of an answer."""
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BEGINNING = 60
"""Bytes of an answer that are shown."""


def is_answer(line: bytes | bytearray) -> bool:
    """Whether a line, or its beginning, is an answer rather than other output."""
    return line.lstrip().startswith(b"{")


class Lines:
    """What was read and not taken yet."""

    def __init__(self) -> None:
        self._rest = bytearray()
        self._searched = 0

    def add(self, data: bytes) -> None:
        """Take in what was read."""
        self._rest += data

    @property
    def are_empty(self) -> bool:
        """Whether nothing is left."""
        return not self._rest

    @property
    def begin_answer(self) -> bool:
        """Whether what comes next is an answer, or its beginning."""
        return is_answer(self._rest)

    @property
    def beginning(self) -> str:
        """What comes next, cut to a few words."""
        return self._rest[:_BEGINNING].split(b"\n")[0].decode("utf-8", "replace")

    def put_back(self, line: bytes) -> None:
        """Have the line that was taken last come next again."""
        self._rest[:0] = line

    def take(self) -> bytes | None:
        """Return the next line, also the beginning of one that is too long to be an answer; None for none.

        Raises CommandFailure for an answer that is too long.
        """
        if self._rest.startswith(_BYTE_ORDER_MARK):  # some programs write it before the first line
            del self._rest[: len(_BYTE_ORDER_MARK)]
            self._searched = 0
        end = self._rest.find(b"\n", self._searched) + 1
        self._searched = len(self._rest)
        if not end and len(self._rest) > CHUNK_BYTES and not self.begin_answer:
            end = len(self._rest)
        if not end:
            if len(self._rest) > _LONGEST_LINE_BYTES:
                raise CommandFailure(f"wrote a line of more than {_LONGEST_LINE_BYTES} bytes")
            return None
        line = bytes(self._rest[:end])
        del self._rest[:end]
        self._searched = 0
        return line
