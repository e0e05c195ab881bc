"""Runs many episodes with a command over its standard input and output, a JSON object in each line.

    to it:    {"reset": {"parameters": {"steps": 30}, "seed": 7}, "id": 1}
    from it:  {"sensors": [[0.5, -1.0], [0.1, 2.0]], "id": 1}
    to it:    {"actuators": [[0.25], [-1.0]], "id": 2}
    from it:  {"sensors": [[0.4, -1.0], [0.2, 1.0]], "id": 2}
    ..        {"done": true, "fitness": -0.31, "metrics": {"arrived": 2}, "id": 3}

`sensors` has a row for each agent. `acting` beside it lists the agents that act next, by default all; in
`actuators`, the rows of other agents are 0. `{"error": "reason"}` fails the episode. `"warning": "text"` in
an answer is logged once for a server. The command must end at the end of its standard input. Lines that do
not begin with { are ordinary output.

A second answer to a message fails the episode. Answers may repeat the `id` of their message; either all
answers of a process do, or none. With ids, a second answer is always recognised, and one to the last message
of an episode is harmless. Without ids, a late second answer is mistaken for the answer to the next message,
and so on: the controller acts on old sensors, the fitness is wrong, and the program announces the end of the
episode twice, which fails the episode. If that is noticed only when the next episode begins, a warning is
logged and the process is replaced. To notice it earlier, this module waits briefly for second answers.

A warning is also logged, and the process replaced, if it ends with an exit status other than 0, or reports an
error, after an episode. This never fails an episode, because which one would depend on timing.
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
    CapturedOutput,
    CommandFailure,
    ExitReport,
    Limits,
    ProcessEnded,
    Processes,
    ReportedFailure,
    Watch,
    check_end,
)

ID = "id"
"""Key of a message's number, which answers may repeat."""
_CLOSE_EPISODES = 5
"""Number of episodes, at the start and after a second answer, with longer waits."""
_STEPS_AT_END = 1.5
"""Wait at the end of an episode, relative to the longest step, in which a second answer should arrive."""
_LONGEST_AT_END_S = 1.0
_SHARE_AT_END, _SHARE_OF_STEP = 0.1, 0.02
"""Longest wait after the first episodes, relative to the time of an episode and of a step."""
_LONGEST_LOOK_S = 0.002
"""Longest wait in a step after the first episodes, in seconds."""
_CLOSE_LOOKS_S = 0.2
"""Longest total wait in the steps of one of the first episodes, in seconds."""
SETTLE_S, SUSPECT_S = 0.02, 0.2
"""Shortest wait at the end of one of the first episodes, and of an episode after a second answer, in
seconds."""
_SHORTEST_LOOK_S = 0.0002
"""Shorter waits are skipped: the system's shortest is about 0.1 ms."""


class MessageIds:
    """Numbers of the messages to a process, from 1."""

    def __init__(self) -> None:
        self.are_repeated = False
        """Whether the program's answers repeat them."""
        self._last = self._reset = 0

    def next(self, *, is_reset: bool) -> int:
        """Return the number of the next message; is_reset: whether the message begins an episode."""
        self._last += 1
        if is_reset:
            self._reset = self._last
        return self._last

    def accepts(self, answer: dict[str, Any]) -> bool:
        """Return whether this answers the last message; False for repeated ones.

        An error is accepted unless it has the number of a message of a previous episode, because programs may
        report errors without knowing the message.

        Raises CommandFailure for an answer to another message of this episode, or if some answers lack a
        number.
        """
        is_error = "error" in answer
        if ID not in answer:
            if self.are_repeated and not is_error:
                raise CommandFailure(
                    f'answered message {self._last} without its "{ID}", unlike earlier messages'
                )
            return True
        number = answer.pop(ID)
        if number == self._last and not isinstance(number, bool):
            self.are_repeated = True
            return True
        if self.are_repeated and isinstance(number, int):
            if 0 < number < self._reset:
                return False
            if number < self._last and not is_error:
                raise CommandFailure(f"answered message {number} twice")
        if is_error:
            return True
        raise CommandFailure(
            f'answered with the "{ID}" {repr(number)[:40]}, expected {self._last}, the number of the message'
            "; repeat it in all answers, or omit the key from all"
        )


class WaitTimes:
    """Times to wait for second answers of programs that do not repeat ids."""

    def __init__(self) -> None:
        self._close = _CLOSE_EPISODES + 1  # decremented at the beginning of each episode
        self._is_suspect = False
        self._longest_s = self._episode_s = self._looked_s = 0.0

    @property
    def are_close(self) -> bool:
        """Whether this is one of the first episodes, at the start or after a second answer."""
        return self._close > 0

    def begin_episode(self) -> None:
        """Start the next episode."""
        self._close = max(self._close - 1, 0)
        self._is_suspect = self._is_suspect and self._close > 0
        self._longest_s = self._episode_s = self._looked_s = 0.0

    def suspect(self) -> None:
        """Wait longer in the next episodes, after a second answer."""
        self._close, self._is_suspect = _CLOSE_EPISODES + 1, True

    def seconds(self, taken_s: float, *, is_reset: bool, is_end: bool) -> float:
        """Return the seconds to wait for a second answer after an answer; 0 for not at all.

        Args:
            taken_s: seconds until the answer came.
            is_reset: whether it answers the message that begins the episode.
            is_end: whether it ends the episode.
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
"""Largest number of bytes per read."""
_LONGEST_LINE_BYTES = 1 << 26
"""Largest size of an answer in bytes."""
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_BEGINNING = 60
"""Largest size of an answer in a message in bytes."""


def is_answer(line: bytes | bytearray) -> bool:
    """Return whether a line, or its beginning, is an answer rather than other output."""
    return line.lstrip().startswith(b"{")


class Lines:
    """Buffered output of a command, split into lines."""

    def __init__(self) -> None:
        self._rest = bytearray()
        self._searched = 0

    def add(self, data: bytes) -> None:
        """Add output that was read."""
        self._rest += data

    @property
    def are_empty(self) -> bool:
        """Whether the buffer is empty."""
        return not self._rest

    @property
    def begin_answer(self) -> bool:
        """Whether the buffer begins with an answer, or the beginning of one."""
        return is_answer(self._rest)

    @property
    def beginning(self) -> str:
        """The beginning of the buffer, shortened."""
        return self._rest[:_BEGINNING].split(b"\n")[0].decode("utf-8", "replace")

    def put_back(self, line: bytes) -> None:
        """Put a line back to the beginning of the buffer."""
        self._rest[:0] = line

    def take(self) -> bytes | None:
        """Return the next line, or the beginning of a long line that is not an answer; None if there is none.

        Raises CommandFailure for an answer that is too long.
        """
        if self._rest.startswith(_BYTE_ORDER_MARK):  # some programs write it first
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
"""Largest number of characters of a command's warning."""
_ENCODER = json.JSONEncoder(separators=(",", ":"))
_log = logging.getLogger("swarmwright")
_SURPLUS_S = 0.05
"""Seconds to wait for the answer to a reset after an answer that may be the previous episode's end."""
_LINE_END_S = 0.2
"""Seconds to wait for the rest of an unexpected line."""
_GRACE_S = 2.0
"""Seconds that a process has to end after its standard input is closed."""


@dataclass(frozen=True)
class Start:
    """Arguments for starting the process."""

    command: Sequence[str]
    folder: Path
    environment: Mapping[str, str]


class Dialogue:
    """A process that runs episodes one after the other, and is replaced when necessary.

    Args:
        processes: starts it.
        start: called before a process is started.
        limits: limits of an episode.
        recycle: most episodes of a process; 0 for any number.
    """

    def __init__(
        self, processes: Processes, start: Callable[[], Start], limits: Limits, recycle: int
    ) -> None:
        self._processes, self._start, self._limits, self._recycle = processes, start, limits, recycle
        self._pipes: tuple[int, int, int] | None = None
        """Its standard input, output and error."""
        self._ended: ExitReport | None = None
        self._episodes = 0
        self._lines = Lines()
        self._ids = MessageIds()
        self._wait_times = WaitTimes()
        self._logged: set[str] = set()
        """Warnings that have been logged."""
        self.printed = CapturedOutput(0)

    def reset(self, parameters: Mapping[str, Any], seed: int) -> dict[str, Any]:
        """Start an episode; return the command's answer.

        Raises CommandFailure for any failure, like the other methods; the process is then ended.
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
            self._start_process()
        self._watch.restart()
        self._episodes += 1
        self._wait_times.begin_episode()
        late: CommandFailure | None = None
        ended: ExitReport | None = None
        try:
            answer = self.ask(message)
            if fresh or answer.get("done") is not True or self._ids.are_repeated:
                return answer
            if not self._has_surplus(_SURPLUS_S if self._wait_times.are_close else 0.0):
                return answer
            # The answer is the previous episode's end, sent twice.
            self._end_for_surplus()
        except (ProcessEnded, ReportedFailure) as failure:
            # The previous episode may be the cause. A failure of this episode will occur again.
            if fresh:
                raise
            late, ended = failure, self._ended
        self._start_process()
        self._episodes = 1
        answer = self.ask(message)
        if isinstance(late, ReportedFailure):
            self._warn_of_late_error(late.reason)
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
                seconds = self._wait_times.seconds(time.monotonic() - began, is_reset=is_reset, is_end=is_end)
                if not (is_reset and is_end):  # `reset` checks for second answers of the previous episode
                    self._look_for_surplus(seconds, is_end=is_end)
            return answer
        except BaseException as error:
            self.abandon(0.0 if not isinstance(error, CommandFailure) else 0.5)
            raise

    def _answer(self) -> dict[str, Any]:
        """Return the answer to the last message."""
        while True:
            answer = self._parse_answer(self._line())
            if self._ids.accepts(answer):
                return self._check_errors(answer)
            if "error" in answer:
                self._warn_of_late_error(answer["error"])

    def _warn_of_late_error(self, error: object) -> None:
        """Warn of an error that the command reports after an episode that has already been counted."""
        self._warn("the command reports an error after the end of an episode: %s", error)

    def _look_for_surplus(self, seconds: float, *, is_end: bool) -> None:
        """Raise CommandFailure for a second answer within these seconds; log an error after the end."""
        if not self._has_surplus(seconds):
            return
        try:
            self._refuse_surplus()
        except ReportedFailure as failure:
            if not is_end:
                raise
            self._warn_of_late_error(failure.reason)
            self.abandon()

    def _check_end_between(self, ended: ExitReport | None) -> None:
        """Warn of a process that has failed after an episode, perhaps because of an unexpected message."""
        if ended is None or not ended.status or self._ids.are_repeated:
            return
        try:
            check_end(ended, self._limits)
        except CommandFailure as failure:
            self._warn_of_doubt(f"{failure} after the end of an episode")

    def _has_surplus(self, patience: float = 0.0) -> bool:
        """Return whether there is an unexpected answer."""
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
            remaining_s = max(deadline - time.monotonic(), 0.0)
            # The rest of endless output is read while waiting for an answer.
            if self._ended is not None or (has_read and not remaining_s):
                return False
            if not self._read_more(remaining_s):
                return False
            has_read = True

    def _read_more(self, patience: float) -> bool:
        """Read output for at most `patience` seconds; return False if there was none, or at its end."""
        assert self._pipes is not None
        # Not with poll, whose times are whole milliseconds.
        if not select.select([self._pipes[1]], [], [], patience)[0]:
            return False
        data = os.read(self._pipes[1], CHUNK_BYTES)
        self._lines.add(data)
        return bool(data)

    def _refuse_surplus(self) -> NoReturn:
        """Raise CommandFailure for an unexpected answer, which may be an error."""
        text = self._lines.beginning
        if (reported := self._surplus_error()) is not None:
            raise ReportedFailure(reported)
        self._wait_times.suspect()
        raise CommandFailure(f"answered a message twice: {text}")

    def _surplus_error(self) -> str | None:
        """Read an unexpected answer; return the error that it reports, or None.

        Its line may come in pieces, as programs without buffering write the line end separately.
        """
        deadline = time.monotonic() + _LINE_END_S
        while (line := self._lines.take()) is None:
            remaining_s = deadline - time.monotonic()
            if remaining_s <= 0 or self._ended is not None or not self._read_more(remaining_s):
                return None
        answer = self._parse_answer(line)
        return str(answer["error"]) if "error" in answer else None

    def _end_for_surplus(self) -> None:
        """End a process whose next answers would be those to earlier messages."""
        text, reported = self._lines.beginning, None
        with contextlib.suppress(CommandFailure):  # a line that is not JSON
            reported = self._surplus_error()
        if reported is not None:
            self._warn_of_late_error(reported)
        else:
            self._warn_of_doubt(f"sent another answer after the end of an episode ({text})")
        self.abandon()

    def _warn_of_doubt(self, event: str) -> None:
        """Warn that a previous episode, which has been counted, may be wrong."""
        self._wait_times.suspect()
        self._warn(
            "the command %s: it may have answered a message twice, which would make the fitness of that "
            "episode "
            f'wrong; its process is replaced. Repeat the "{ID}" of messages in answers to rule this out',
            event,
        )

    def _warn(self, text: str, detail: object) -> None:
        """Log a warning, the first one of each kind."""
        if text not in self._logged:
            self._logged.add(text)
            _log.warning(text, escape_line(str(detail)[:_LONGEST_WARNING]))

    def _parse_answer(self, line: bytes) -> dict[str, Any]:
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError) as error:
            text = line[:60].decode("utf-8", "replace")
            raise CommandFailure(f"wrote a line that is not valid JSON: {text}: {error}") from None
        if not isinstance(answer, dict):
            raise CommandFailure("wrote a line that is not a JSON object")
        return answer

    def _check_errors(self, answer: dict[str, Any]) -> dict[str, Any]:
        """Raise ReportedFailure for an error of the current episode; log a warning."""
        if "error" in answer:
            raise ReportedFailure(str(answer["error"]))
        warning = answer.pop("warning", None)
        if isinstance(warning, str):
            self._warn("the command reports: %s", warning)
        return answer

    def _start_process(self) -> None:
        start = self._start()
        inner = [os.pipe() for _ in range(3)]
        theirs = (inner[0][0], inner[1][1], inner[2][1])
        ours = (inner[0][1], inner[1][0], inner[2][0])
        self._ended, self._episodes = None, 0
        self._lines, self._ids = Lines(), MessageIds()
        self.printed = CapturedOutput(self._limits.most_output)
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
                return  # the reason is reported while waiting for the answer

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
                f"{failure}; its answer {self._lines.beginning} has no line end; write it, and flush the "
                "output"
            ) from None

    def _wait(self, also: int | None = None) -> None:
        """Wait until output can be read, or a descriptor written; read the output."""
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
        """Kill the process, because its state is unknown."""
        if self._pipes is not None and self._ended is None:
            self._processes.kill(patience)
            with contextlib.suppress(OSError):
                os.set_blocking(self._pipes[2], False)
                while self.printed.read(self._pipes[2]):
                    pass
        self.printed.end()
        self._close_pipes()

    def close(self) -> None:
        """End the process: close its standard input, and kill it after a while."""
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
