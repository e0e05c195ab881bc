"""Results as JUnit XML, which build servers show."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from swarmwright.common.errors import RunError
from swarmwright.conformance.results import Report, Result, explained

_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(report: Report, path: Path, groups: Mapping[str, str]) -> None:
    """Write a suite for each group of rules, a case for each rule.

    Raises RunError when the file cannot be written.
    """
    root = Element("testsuites", name=_text(report.peer), **_figures(report.results))
    for group, title in groups.items():
        results = [result for result in report.results if result.id.partition(".")[0] == group]
        if not results:
            continue
        suite = SubElement(root, "testsuite", name=f"{group} {title}", **_figures(results))
        for result in results:
            _case(suite, result, f"conformance.{group}")
    indent(root)
    try:
        ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise RunError(f"--junit: {path}: {error.strerror}") from None


def _case(suite: Element, result: Result, name: str) -> None:
    case = SubElement(
        suite, "testcase", classname=name, name=f"{result.id} {result.rule}", time=f"{result.seconds:.3f}"
    )
    properties = SubElement(case, "properties")
    SubElement(properties, "property", name="source", value=_text(result.source))
    if result.status in {"failed", "died"}:
        kind = "failure" if result.status == "failed" else "error"
        SubElement(case, kind, message=_text(result.came)).text = _text(explained(result))
    elif result.status in {"skipped", "not run"}:
        SubElement(case, "skipped", message=_text(f"{result.status}: {result.detail}"))
    elif result.detail:
        SubElement(case, "system-out").text = _text(result.detail)


def _figures(results: list[Result]) -> Any:  # noqa: ANN401 - attributes, as the library wants them
    def count(*statuses: str) -> str:
        return str(sum(result.status in statuses for result in results))

    return {
        "tests": str(len(results)),
        "failures": count("failed"),
        "errors": count("died"),
        "skipped": count("skipped", "not run"),
        "time": f"{sum(result.seconds for result in results):.3f}",
    }


def _text(text: str) -> str:
    """Without what XML cannot hold."""
    return _FORBIDDEN.sub("?", text)
