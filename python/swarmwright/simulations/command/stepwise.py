"""Talks with a command over its standard input and output, a JSON object a line, through many episodes.

    to it:    {"reset": {"parameters": {"steps": 30}, "seed": 7}, "id": 1}
    from it:  {"sensors": [[0.5, -1.0], [0.1, 2.0]], "id": 1}
    to it:    {"actuators": [[0.25], [-1.0]], "id": 2}
    from it:  {"sensors": [[0.4, -1.0], [0.2, 1.0]], "id": 2}
    ..        {"done": true, "fitness": -0.31, "metrics": {"arrived": 2}, "id": 3}

`sensors` has a row for each agent. `acting` beside it lists the agents whose actuators are wanted next, by
default all; rows of `actuators` of others are 0. `{"error": "why"}` fails the episode. `"warning": "text"`
in an answer is logged, the first one of a server. At the end of its standard input the command is to end.
Lines that do not begin with { are output like any other.

A second answer to a message fails the episode. The `id` is optional in answers, in all of a process or none.
With it, a second answer is recognised whenever it comes, and one to the last message of an episode does no
harm. Without it, one that comes late is taken for that to the next message: the
program is then one message behind, and says the end of the episode twice, which fails the episode, too. Where
that is seen only when the next episode begins, there is a warning, and the process is replaced.

So it is where the process ends with another exit status than 0, or reports an error, after an episode. That
never fails an episode: which one would depend on when it is seen.

Lines of a command's standard output: which are answers, and what has come of the next one.

Second answers to a message: recognised by the ids of messages, else waited for.

A second answer is taken for the answer to the next message where it comes after that was sent, and so on up
to the end: the controller then acts on old sensors, and the fitness is wrong. Only answers that repeat the
`id` of their message show it for certain.
"""

import contextlib
import json
import logging
import os
import select
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from swarmwright.common.untrusted import escape_line
from swarmwright.simulations.command.process import (
    CommandFailure,
    Ended,
    Limits,
    Printed,
    ProcessEnded,
    Processes,
    ReportedFailure,
    Watch,
    check_end,
)

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


_LONGEST_WARNING = 1000
"""Characters of a command's warning that are logged."""
_ENCODER = json.JSONEncoder(separators=(",", ":"))
_log = logging.getLogger("swarmwright")
_SURPLUS_S = 0.05
"""Seconds in which the answer to a reset comes that seems to be the end of the episode before."""
_LINE_END_S = 0.2
"""Seconds in which the rest of a line comes that nothing was asked for."""
_GRACE_S = 2.0
"""Seconds that a process has to end when its standard input is closed."""


@dataclass(frozen=True)
class Start:
    """How the process is started."""

    command: Sequence[str]
    folder: Path
    environment: Mapping[str, str]


class Dialogue:
    """One process at a time, which runs episodes in turn.

    Args:
        processes: which start it.
        start: called before a process is started.
        limits: of an episode.
        recycle: episodes of a process; 0 for any number.
    """

    def __init__(
        self, processes: Processes, start: Callable[[], Start], limits: Limits, recycle: int
    ) -> None:
        self._processes, self._start, self._limits, self._recycle = processes, start, limits, recycle
        self._pipes: tuple[int, int, int] | None = None
        """Its standard input, output and error."""
        self._ended: Ended | None = None
        self._episodes = 0
        self._lines = Lines()
        self._ids = MessageIds()
        self._looks = Looks()
        self._logged: set[str] = set()
        """Warnings, of which each is logged once."""
        self.printed = Printed(0)

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Begin an episode; return what the command answers.

        Raises CommandFailure for any failure, as the other methods; the process is then ended.
        """
        message = {"reset": {"parameters": dict(parameters), "seed": seed}}
        if self._pipes is not None and (
            self._has_ended() or (self._recycle and self._episodes >= self._recycle)
        ):
            self._check_end_between(self._ended)
            self.close()
        if self._pipes is not None and not self._ids.are_repeated and self._has_surplus():
            self._end_for_surplus()
        fresh = self._pipes is None
        if fresh:
            self._begin()
        self._watch.begin_again()
        self._episodes += 1
        self._looks.begin_episode()
        late: CommandFailure | None = None
        ended: Ended | None = None
        try:
            answer = self.ask(message)
            if fresh or answer.get("done") is not True or self._ids.are_repeated:
                return answer
            if not self._has_surplus(_SURPLUS_S if self._looks.are_close else 0.0):
                return answer
            # What came is the end of the episode before, said twice.
            self._end_for_surplus()
        except (ProcessEnded, ReportedFailure) as failure:
            # It may be because of the episode before. What this one causes comes again.
            if fresh:
                raise
            late, ended = failure, self._ended
        self._begin()
        self._episodes = 1
        answer = self.ask(message)
        if isinstance(late, ReportedFailure):
            self._note_late(late.reason)
        elif late is not None:
            self._check_end_between(ended)
        return answer

    def ask(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Send a message and return the answer."""
        try:
            assert self._pipes is not None
            if not self._ids.are_repeated and self._has_surplus():
                self._refuse_surplus()
            began, is_reset = time.monotonic(), "reset" in message
            numbered = {**message, ID: self._ids.next(is_reset=is_reset)}
            self._write(f"{_ENCODER.encode(numbered)}\n".encode())
            answer = self._answer()
            if not self._ids.are_repeated:
                is_end = answer.get("done") is True
                seconds = self._looks.seconds(time.monotonic() - began, is_reset=is_reset, is_end=is_end)
                if not (is_reset and is_end):  # `reset` looks for what belongs to the episode before
                    self._look_for_surplus(seconds, is_end=is_end)
            return answer
        except BaseException as error:
            self.abandon(0.0 if not isinstance(error, CommandFailure) else 0.5)
            raise

    def _answer(self) -> dict[str, Any]:
        """Return the answer to the last message."""
        while True:
            answer = self._parsed(self._line())
            if self._ids.takes(answer):
                return self._accepted(answer)
            if "error" in answer:
                self._note_late(answer["error"])

    def _note_late(self, error: object) -> None:
        """Warn of an error that the command reports after the end of an episode, which has been counted."""
        self._warn("the command reports an error after the end of an episode: %s", error)

    def _look_for_surplus(self, seconds: float, *, is_end: bool) -> None:
        """Raise CommandFailure for a second answer within so many seconds; log an error after the end."""
        if not self._has_surplus(seconds):
            return
        try:
            self._refuse_surplus()
        except ReportedFailure as failure:
            if not is_end:
                raise
            self._note_late(failure.reason)
            self.abandon()

    def _check_end_between(self, ended: Ended | None) -> None:
        """Warn of a process that has failed after an episode, perhaps at a message that it did not expect."""
        if ended is None or not ended.status or self._ids.are_repeated:
            return
        try:
            check_end(ended, self._limits)
        except CommandFailure as failure:
            self._doubt(f"{failure} after the end of an episode")

    def _has_surplus(self, patience: float = 0.0) -> bool:
        """Whether there is an answer although nothing was asked."""
        assert self._pipes is not None
        if not patience and self._lines.are_empty and not self._answers.poll(0):
            return False
        deadline = time.monotonic() + patience
        has_read = False
        while True:
            while (line := self._lines.take()) is not None:
                if is_answer(line):
                    self._lines.put_back(line)
                    return True
                self.printed.take(line)
            if self._lines.begin_answer:
                return True
            left = max(deadline - time.monotonic(), 0.0)
            # Of what is printed without end, the rest is read when an answer is waited for.
            if self._ended is not None or (has_read and not left):
                return False
            if not self._read_more(left):
                return False
            has_read = True

    def _read_more(self, patience: float) -> bool:
        """Read what comes within so many seconds; False for nothing, or the end of the output."""
        assert self._pipes is not None
        # Not by poll, whose times are whole milliseconds.
        if not select.select([self._pipes[1]], [], [], patience)[0]:
            return False
        data = os.read(self._pipes[1], CHUNK_BYTES)
        self._lines.add(data)
        return bool(data)

    def _refuse_surplus(self) -> NoReturn:
        """Raise CommandFailure for an answer that nothing was asked for: an error may come at any time."""
        text = self._lines.beginning
        if (reported := self._surplus_error()) is not None:
            raise ReportedFailure(reported)
        self._looks.suspect()
        raise CommandFailure(f"answered a message twice: {text}")

    def _surplus_error(self) -> str | None:
        """Take an answer that nothing was asked for; return the error that it reports, None if it does not.

        Its line may come in pieces: programs that do not buffer write the line end apart.
        """
        deadline = time.monotonic() + _LINE_END_S
        while (line := self._lines.take()) is None:
            left = deadline - time.monotonic()
            if left <= 0 or self._ended is not None or not self._read_more(left):
                return None
        answer = self._parsed(line)
        return str(answer["error"]) if "error" in answer else None

    def _end_for_surplus(self) -> None:
        """End a process whose next answers would be those to earlier messages."""
        text, reported = self._lines.beginning, None
        with contextlib.suppress(CommandFailure):  # of a line that is no JSON
            reported = self._surplus_error()
        if reported is not None:
            self._note_late(reported)
        else:
            self._doubt(f"sent another answer after the end of an episode ({text})")
        self.abandon()

    def _doubt(self, what: str) -> None:
        """Warn of what was seen too late: the episode has been counted."""
        self._looks.suspect()
        self._warn(
            "the command %s: it may have answered a message twice, so that the fitness of that episode may "
            f'be wrong; another process goes on; if its answers repeat the "{ID}" of their messages, none is '
            "taken for another",
            what,
        )

    def _warn(self, text: str, what: object) -> None:
        """Log a warning, the first one of each kind."""
        if text not in self._logged:
            self._logged.add(text)
            _log.warning(text, escape_line(str(what)[:_LONGEST_WARNING]))

    def _parsed(self, line: bytes) -> dict[str, Any]:
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError) as error:
            text = line[:60].decode("utf-8", "replace")
            raise CommandFailure(f"wrote a line that is not valid JSON: {text}: {error}") from None
        if not isinstance(answer, dict):
            raise CommandFailure("wrote a line that is not a JSON object")
        return answer

    def _accepted(self, answer: dict[str, Any]) -> dict[str, Any]:
        """Raise ReportedFailure for an error of the episode under way; log a warning."""
        if "error" in answer:
            raise ReportedFailure(str(answer["error"]))
        warning = answer.pop("warning", None)
        if isinstance(warning, str):
            self._warn("the command reports: %s", warning)
        return answer

    def _begin(self) -> None:
        start = self._start()
        inner = [os.pipe() for _ in range(3)]
        theirs = (inner[0][0], inner[1][1], inner[2][1])
        ours = (inner[0][1], inner[1][0], inner[2][0])
        self._ended, self._episodes = None, 0
        self._lines, self._ids = Lines(), MessageIds()
        self.printed = Printed(self._limits.most_output)
        self._watch = Watch(start.folder, self._limits, self._processes)
        try:
            self._processes.start(
                start.command, start.folder, start.environment, self._limits.largest, theirs
            )
        except BaseException:
            for descriptor in ours:
                os.close(descriptor)
            raise
        finally:
            for descriptor in theirs:
                os.close(descriptor)
        self._pipes = ours
        os.set_blocking(ours[0], False)
        self._answers: select.poll = select.poll()
        self._answers.register(ours[1], select.POLLIN)
        self._poll = select.poll()
        for descriptor in (ours[1], ours[2], self._processes.channel.fileno()):
            self._poll.register(descriptor, select.POLLIN)

    def _write(self, data: bytes) -> None:
        assert self._pipes is not None
        rest = memoryview(data)
        while rest:
            try:
                rest = rest[os.write(self._pipes[0], rest) :]
            except BlockingIOError:
                self._wait(also=self._pipes[0])
            except BrokenPipeError:
                return  # why is found out when the answer is waited for

    def _line(self) -> bytes:
        """Return the next line that is an answer."""
        while True:
            line = self._lines.take()
            if line is None:
                if self._ended is not None:
                    check_end(self._ended, self._limits)
                    raise ProcessEnded("ended in the middle of an episode, with exit status 0")
                self._wait()
                self._check_limits()
            elif is_answer(line):
                return line
            else:
                self.printed.take(line)

    def _check_limits(self) -> None:
        try:
            self._watch.check(self.printed)
        except CommandFailure as failure:
            if not self._lines.begin_answer:
                raise
            raise CommandFailure(
                f"{failure}; its answer {self._lines.beginning} has no line end: write one, and flush the "
                "output"
            ) from None

    def _wait(self, also: int | None = None) -> None:
        """Wait until something can be read, or a descriptor written; read it."""
        assert self._pipes is not None
        if also is not None:
            self._poll.register(also, select.POLLOUT)
        try:
            ready = self._poll.poll(self._watch.pause * 1000 + 1)
        finally:
            if also is not None:
                self._poll.unregister(also)
        if also is not None:
            self._watch.check(self.printed)
        for descriptor, _ in ready:
            if descriptor == self._pipes[1]:
                data = os.read(descriptor, CHUNK_BYTES)
                self._lines.add(data)
                if not data:
                    self._poll.unregister(descriptor)
            elif descriptor == self._pipes[2]:
                if not self.printed.read(descriptor):
                    self._poll.unregister(descriptor)
            elif descriptor != also:
                self._note_end()

    def _note_end(self) -> None:
        assert self._pipes is not None
        self._ended = self._processes.report()
        self._poll.unregister(self._processes.channel)
        for descriptor in self._pipes[1:]:
            os.set_blocking(descriptor, False)
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._pipes[1], CHUNK_BYTES):
                self._lines.add(data)
        with contextlib.suppress(BlockingIOError):
            while self.printed.read(self._pipes[2]):
                pass
        self.printed.end()

    def _has_ended(self) -> bool:
        if self._ended is None and select.select([self._processes.channel], [], [], 0)[0]:
            self._note_end()
        return self._ended is not None

    def abandon(self, patience: float = 0.5) -> None:
        """End the process: its state is unknown."""
        if self._pipes is not None and self._ended is None:
            self._processes.kill(patience)
            with contextlib.suppress(OSError):
                os.set_blocking(self._pipes[2], False)
                while self.printed.read(self._pipes[2]):
                    pass
        self.printed.end()
        self._close_pipes()

    def close(self) -> None:
        """End the process: its standard input is closed, and after a while it is killed."""
        if self._pipes is None:
            return
        if self._ended is None:
            os.close(self._pipes[0])
            self._pipes = (-1, *self._pipes[1:])
            if select.select([self._processes.channel], [], [], _GRACE_S)[0]:
                with contextlib.suppress(CommandFailure, OSError):
                    self._note_end()  # it may have printed something at its end
            else:
                self._processes.kill()
        self._close_pipes()

    def _close_pipes(self) -> None:
        for pipe in self._pipes or ():
            if pipe >= 0:
                os.close(pipe)
        self._pipes = None
