"""What a store keeps of the sensors and actuators of a simulation, checked."""

from collections.abc import Mapping
from typing import Any

from swarmwright.common.ranges import Range


def problem_of(channels: Any) -> str | None:  # noqa: ANN401 - whatever a file says
    """Return what is wrong with channels as `catalogue.channels` describes them; None when nothing is."""
    if not isinstance(channels, Mapping) or not isinstance(channels.get("groups", {}), Mapping):
        return "a mapping was expected"
    for where in (channels, *channels.get("groups", {}).values()):
        if not isinstance(where, Mapping):
            return "groups: a mapping for each group was expected"
        for which in ("sensor", "actuator"):
            for about in ("names", "units", "ranges"):
                found = where.get(f"{which}_{about}", [])
                if not isinstance(found, list):
                    return f"{which}_{about}: a list was expected"
                if about != "ranges" and not all(isinstance(one, str) for one in found):
                    return f"{which}_{about}: texts were expected"
            try:
                _ = [Range.of(one) for one in where.get(f"{which}_ranges", [])]
            except ValueError as error:
                return f"{which}_ranges: {error}"
    seconds = channels.get("step_seconds")
    if seconds is not None and not (isinstance(seconds, int | float) and 0 < seconds < float("inf")):
        return f"step_seconds: {seconds!r} found, expected seconds above 0, or null"
    return None
