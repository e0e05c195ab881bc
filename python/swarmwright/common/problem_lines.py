"""Problems of a file from elsewhere, reported at once."""

from swarmwright.common.errors import InputError

MOST_PROBLEMS = 100
"""Of a file: nobody reads more, and a hostile file may have millions."""


class ProblemLines:
    """Lines about what is wrong, each once, in the order in which it was found."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    def __len__(self) -> int:
        return len(self._lines)

    def add(self, line: str) -> None:
        """Note a problem. Raises InputError with all of them when there are many."""
        self._lines[line] = None
        if len(self._lines) >= MOST_PROBLEMS:
            more = f"and maybe more; these are the first {MOST_PROBLEMS}"
            raise InputError("\n".join([*self._lines, more]))

    def stop(self) -> None:
        """Raise InputError if there is a problem."""
        if self._lines:
            raise InputError("\n".join(self._lines))
