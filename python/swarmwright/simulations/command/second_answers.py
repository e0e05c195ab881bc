"""Second answers to a message: recognised by the ids of messages, else waited for.

A second answer is taken for the answer to the next message where it comes after that was sent, and so on up
to the end: the controller then acts on old sensors, and the fitness is wrong. Only answers that repeat the
`id` of their message show it for certain.
"""

from typing import Any

from swarmwright.simulations.command.failure import CommandFailure

ID = "id"
"""Key of a message's number, which answers repeat."""
_CLOSE_EPISODES = 5
"""In so many episodes, at the start and after a second answer, one is waited for longer."""
_STEPS_AT_END = 1.5
"""Of the longest step's time: within it comes the answer to a message that was sent too often."""
_LONGEST_AT_END_S = 1.0
_SHARE_AT_END, _SHARE_OF_STEP = 0.1, 0.02
"""Of an episode's and of a step's time, which a look takes at most after the first episodes."""
_LONGEST_LOOK_S = 0.002
"""Seconds of such a look in a step."""
_CLOSE_LOOKS_S = 0.2
"""Seconds of the looks in the steps of one of the first episodes, together."""
SETTLE_S, SUSPECT_S = 0.02, 0.2
"""Seconds, at least, of the look at the end of one of the first episodes; of one after a second answer."""
_SHORTEST_LOOK_S = 0.0002
"""The shortest wait of the system is about 0.1 ms."""


class MessageIds:
    """Numbers of the messages to one process, from 1 on."""

    def __init__(self) -> None:
        self.are_repeated = False
        """Whether the program's answers have them."""
        self._last = self._reset = 0

    def next(self, *, is_reset: bool) -> int:
        """Return the number of the next message; is_reset: whether that begins an episode."""
        self._last += 1
        if is_reset:
            self._reset = self._last
        return self._last

    def takes(self, answer: dict[str, Any]) -> bool:
        """Whether this answers the last message; False for a second answer in an episode that has ended.

        An error counts unless it has the number of a message of an episode that has ended: programs report
        errors from where the message is not known.

        Raises CommandFailure for an answer to another message of this episode, or where some have no number.
        """
        is_error = "error" in answer
        if ID not in answer:
            if self.are_repeated and not is_error:
                raise CommandFailure(
                    f'answered message {self._last} without its "{ID}", unlike others before'
                )
            return True
        found = answer.pop(ID)
        if found == self._last and not isinstance(found, bool):
            self.are_repeated = True
            return True
        if self.are_repeated and isinstance(found, int):
            if 0 < found < self._reset:
                return False
            if found < self._last and not is_error:
                raise CommandFailure(f"answered message {found} twice")
        if is_error:
            return True
        raise CommandFailure(
            f'answered with the "{ID}" {repr(found)[:40]}, expected {self._last}, the number of the message: '
            "have answers repeat it, or leave the key out of all"
        )


class Looks:
    """How long a second answer is waited for, which programs send without ids."""

    def __init__(self) -> None:
        self._close = _CLOSE_EPISODES + 1  # less 1 at the beginning of each
        self._is_suspect = False
        self._longest_s = self._episode_s = self._looked_s = 0.0

    @property
    def are_close(self) -> bool:
        """Whether this is one of the first episodes, or of those after a second answer."""
        return self._close > 0

    def begin_episode(self) -> None:
        """Begin with the next episode."""
        self._close = max(self._close - 1, 0)
        self._is_suspect = self._is_suspect and self._close > 0
        self._longest_s = self._episode_s = self._looked_s = 0.0

    def suspect(self) -> None:
        """Look closely in the next episodes: there was a second answer."""
        self._close, self._is_suspect = _CLOSE_EPISODES + 1, True

    def seconds(self, taken_s: float, *, is_reset: bool, is_end: bool) -> float:
        """Return how long to wait after an answer; 0 for not at all.

        Args:
            taken_s: seconds until it came.
            is_reset: whether it was to the message that begins the episode.
            is_end: whether it has ended the episode.
        """
        self._episode_s += taken_s
        if not is_reset:
            self._longest_s = max(self._longest_s, taken_s)
        if is_end:
            look = _STEPS_AT_END * self._longest_s
            if self._close:
                look = max(look, SUSPECT_S if self._is_suspect else SETTLE_S)
            else:
                look = min(look, _SHARE_AT_END * self._episode_s)
            look = min(look, _LONGEST_AT_END_S)
        elif self._close:
            look = min(taken_s, _CLOSE_LOOKS_S - self._looked_s)
            self._looked_s += look
        else:
            look = 0.0 if is_reset else min(taken_s * _SHARE_OF_STEP, _LONGEST_LOOK_S)
        return look if look >= _SHORTEST_LOOK_S else 0.0
