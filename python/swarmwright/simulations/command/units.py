"""Rows of a log that hold the units of its columns."""

import re
from collections.abc import Sequence

_PREFIX = "(?:da|[YZEPTGMkhdcm\u00b5\u03bcunpfazy])?"
_UNIT = (
    r"(?:%|\u00b0[CF]?|deg(?:rees?)?|rad(?:ians?)?|rpm|px|pixels?|steps?|ticks?|min|h|d|hours?|days?|sec|secs|seconds?"
    r"|met(?:er|re)s?|count|bool|"
    + _PREFIX
    + r"(?:mol|cd|rad|sr|Hz|Pa|Wh|Ah|eV|bar|bit|byte|bps|lx|lm|dB|dBm|ohm"
    r"|[smgAKNJWVCFHTLB\u03a9]))(?:\^?-?\d|[\u00b2\u00b3])?"
)
_PRODUCT = rf"(?:1/)?{_UNIT}(?:[ */.\u00b7]{_UNIT})*"
_CELL = re.compile(rf"\s*(?:[-\u2013]?|{_PRODUCT}|\[[^\[\]\d]*(?:{_PRODUCT})?\]|\((?:-|{_PRODUCT})\))\s*")

_NUMBER = re.compile(r"\s*[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf)\s*", re.IGNORECASE)


def is_row(values: Sequence[str], following: Sequence[str]) -> bool:
    """Return whether a row has units, such as m/s, [rad] or %, and the next one numbers."""
    return (
        any(value.strip(" -\u2013") for value in values)
        and all(map(_CELL.fullmatch, values))
        and any(map(_NUMBER.fullmatch, following))
    )
