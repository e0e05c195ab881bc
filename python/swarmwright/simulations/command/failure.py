"""Why an evaluation by a command has failed."""


class CommandFailure(Exception):  # noqa: N818 - it is the reason of a failed evaluation
    """An episode has failed; the message is a line, without the program's output."""


class ProcessEnded(CommandFailure):
    """The process has ended by itself, and not well."""


class ReportedFailure(CommandFailure):
    """The program has answered that the episode failed; `reason` is what it says."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"reports: {reason}")
        self.reason = reason
