"""The conformance kit as checks of tests."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmwright.conformance import Report


def check_server(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that a simulation server keeps every rule of the protocol; return the report.

    command: what starts it, with {broker} and {id} in it. options: as of
    `swarmwright.conformance.check_server`.

    Raises AssertionError that names each rule that is broken, what was sent, what came and what was expected.
    """
    from swarmwright.conformance import check_server as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report


def check_optimizer(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that an optimization tool keeps every rule of the protocol; return the report.

    command: what starts it, with {broker} or {experiment} in it. options: as of
    `swarmwright.conformance.check_optimizer`.

    Raises AssertionError that names each rule that is broken, what was sent, what came and what was expected.
    """
    from swarmwright.conformance import check_optimizer as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report
