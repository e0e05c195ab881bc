"""Machines of modules in the form in which AutoMoDe is called: `--nstates 2 --s0 4 --att0 5 ..`."""

from typing import Any

from swarmwright.core.errors import InputError
from swarmwright.core.modules import (
    BEHAVIOUR_PARAMETERS,
    BEHAVIOURS,
    CONDITIONS,
    MOST_STATES,
    MOST_TRANSITIONS,
)

_SHORT_NAMES = {"exploration": "rwm", "attraction": "att", "repulsion": "rep"}
"""What AutoMoDe calls the parameters of behaviours."""


def machine_of(text: str) -> dict[str, Any]:
    """Return a machine as a mapping, see `modules.states_from`. Raises InputError with what is wrong."""
    values = _Values(text)
    count = values.choice("nstates", MOST_STATES + 1)
    states = []
    for index in range(count):
        behaviour = BEHAVIOURS[values.choice(f"s{index}", len(BEHAVIOURS))]
        state: dict[str, Any] = {"behaviour": behaviour}
        if behaviour in _SHORT_NAMES:
            state[BEHAVIOUR_PARAMETERS[behaviour]] = values.whole(f"{_SHORT_NAMES[behaviour]}{index}")
        transitions = values.choice(f"n{index}", MOST_TRANSITIONS + 1, "0")
        found = [_transition(values, index, f"{index}x{k}", count) for k in range(transitions)]
        states.append({**state, "transitions": [one for one in found if one]})
    values.end()
    return {"states": states}


def _transition(values: "_Values", source: int, place: str, states: int) -> dict[str, Any]:
    """Return a transition; nothing for one that leads nowhere, which AutoMoDe leaves out."""
    target = values.choice(f"n{place}", MOST_STATES)
    condition = CONDITIONS[values.choice(f"c{place}", len(CONDITIONS))]
    if "neighbours" in condition:
        parameters: dict[str, Any] = {"xi": values.whole(f"p{place}"), "eta": values.number(f"w{place}")}
    else:
        parameters = {"probability": values.number(f"p{place}")}
        values.number(f"w{place}", "0")
    if target >= states - 1:
        return {}
    # Targets count the other states.
    return {"to": target + (target >= source), "condition": condition, **parameters}


class _Values:
    """The parameters that have not been asked for."""

    def __init__(self, text: str) -> None:
        words = text.split()
        if len(words) % 2 or any(not name.startswith("--") for name in words[::2]):
            raise InputError(f"{text[:60]!r}: expected pairs such as --nstates 2 --s0 4 --att0 5")
        self._values = dict(zip(words[::2], words[1::2], strict=True))
        if len(self._values) < len(words) // 2:
            raise InputError(f"{text[:60]!r}: a parameter is given twice")

    def number(self, name: str, default: str | None = None) -> float:
        """Return a number."""
        given = self._values.pop(f"--{name}", default)
        if given is None:
            raise InputError(f"--{name}: is missing; expected a number")
        try:
            return float(given)
        except ValueError:
            raise InputError(f"--{name}: {given!r} found, expected a number") from None

    def whole(self, name: str) -> int:
        """Return the whole part of a number, as AutoMoDe takes it."""
        number = self.number(name)
        if not abs(number) < 1e9:  # NaN and infinity among others
            raise InputError(f"--{name}: {number:g} found, which is not possible")
        return int(number)

    def choice(self, name: str, count: int, default: str | None = None) -> int:
        """Return an integer below `count`."""
        found = self.number(name, default)
        if not 0 <= found < count or found != int(found):
            raise InputError(f"--{name}: expected an integer from 0 to {count - 1}, and found {found:g}")
        return int(found)

    def end(self) -> None:
        """Raise InputError if there are others."""
        if self._values:
            raise InputError(f"{next(iter(self._values))}: is not a part of this machine")
