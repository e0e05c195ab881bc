"""Controllers of the kind `mealy_fsm` as SCXML."""

import keyword
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

_NO_WORD = re.compile(r"[^A-Za-z0-9_]+")
_HEAD = (
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" '
    'name="controller" initial="state0">'
)
_ECMASCRIPT = (
    "break case catch class const continue debugger default delete do else enum export extends false finally "
    "for function if implements import in instanceof interface let new null package private protected public "
    "return static super switch this throw true try typeof var void while with yield await arguments eval "
    "undefined NaN Infinity"
)
"""Reserved words of the data model, also in strict mode and modules."""
_SCXML = "In"  # its other names begin with underscores, which are stripped
# Conditions are read back as Python expressions, so Python's keywords are reserved, too.
_RESERVED = frozenset(f"{_ECMASCRIPT} {_SCXML}".split()) | frozenset(keyword.kwlist)


def to_scxml(
    specification: Mapping[str, Any],
    sensors: Sequence[str],
    actuators: Sequence[str],
    facts: Sequence[str] = (),
) -> str:
    """Convert a controller to a state machine in SCXML.

    Each row of its table is a transition on the event `step`: in each control step, sensors are set, then the
    event is sent.

    Args:
        specification: specification of the kind mealy_fsm.
        sensors: their names.
        actuators: their names.
        facts: lines of a comment at the top.
    """
    states, thresholds = int(specification["states"]), specification["thresholds"]
    # States and data share the identifiers of the document.
    words = make_identifiers([*sensors, *actuators], [f"state{state}" for state in range(states)])
    senses, acts = words[: len(sensors)], words[len(sensors) :]
    rows = np.array(specification["weights"], dtype=np.float32).reshape(states, -1, 1 + len(acts))
    combinations = np.indices([len(ends) + 1 for ends in thresholds]).reshape(len(thresholds), -1).T.tolist()
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<!--"]
    lines += [f"  {re.sub('-(?=-)', '- ', fact)}" for fact in facts]
    lines += [
        "  In each control step: set the sensors, send the event step, read the actuators.",
        "-->",
        _HEAD,
        "  <datamodel>",
        *(f"    <data id={quoteattr(name)}/>" for name in senses),
        *(f'    <data id={quoteattr(name)} expr="0"/>' for name in acts),
        "  </datamodel>",
    ]
    for state in range(states):
        lines.append(f'  <state id="state{state}">')
        for row, intervals in zip(rows[state], combinations, strict=True):
            tests = [
                text
                for name, ends, interval in zip(senses, thresholds, intervals, strict=True)
                if (text := _test(name, ends, interval))
            ]
            condition = f" cond={quoteattr(' && '.join(tests))}" if tests else ""
            target = min(max(math.floor(float(row[0])), 0), states - 1)
            lines.append(f'    <transition event="step"{condition} target="state{target}">')
            lines += [
                f'      <assign location={quoteattr(name)} expr="{_number(value)}"/>'
                for name, value in zip(acts, np.clip(row[1:], -1, 1), strict=True)
            ]
            lines.append("    </transition>")
        lines.append("  </state>")
    return "\n".join([*lines, "</scxml>"]) + "\n"


def _test(name: str, ends: Sequence[float], interval: int) -> str:
    """Return the condition that a sensor is in an interval, including its upper limit."""
    tests = [f"{name} > {_number(ends[interval - 1])}"] if interval else []
    if interval < len(ends):
        tests.append(f"{name} <= {_number(ends[interval])}")
    return " && ".join(tests)


def _number(value: float) -> str:
    """Return the shortest text that is this float32 when it is read as a float64 and rounded."""
    # The float64 of the same value: a comparison in ECMAScript then has the same result as one of float32.
    return repr(float(np.float32(value)))


def make_identifiers(names: Sequence[str], others: Collection[str] = ()) -> list[str]:
    """Return unique identifiers that are valid in expressions.

    Reserved names get an underscore at the end, which readers ignore.

    Args:
        names: of sensors and actuators.
        others: identifiers already in use.
    """
    reserved = _RESERVED.union(others)
    result: list[str] = []
    used: set[str] = set()
    for name in names:
        word = _NO_WORD.sub("_", name).strip("_") or "value"
        word = f"_{word}" if word[0].isdigit() else f"{word}_" if word in reserved else word
        unique, count = word, 2
        while unique.lower().replace("_", "") in used:
            unique, count = f"{word}_{count}", count + 1
        used.add(unique.lower().replace("_", ""))
        result.append(unique)
    return result
