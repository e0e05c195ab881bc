"""The conformance kit for tests."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmwright.conformance import Report


def check_server(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that a simulation server follows every rule of the protocol; return the report.

    command: command that starts it, with {broker} and {id}. options: those of
    `swarmwright.conformance.check_server`.

    Raises AssertionError with each violated rule and the sent, received and expected messages.
    """
    from swarmwright.conformance import check_server as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report


def check_optimizer(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that an optimization tool follows every rule of the protocol; return the report.

    command: command that starts it, with {broker} or {experiment}. options: those of
    `swarmwright.conformance.check_optimizer`.

    Raises AssertionError with each violated rule and the sent, received and expected messages.
    """
    from swarmwright.conformance import check_optimizer as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report
