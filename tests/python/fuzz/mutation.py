"""Inputs that are nearly right: golden ones with a few bytes changed, moved, repeated, cut off."""

import os
from collections.abc import Callable, Sequence
from typing import TypeVar

from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st

Test = TypeVar("Test", bound=Callable[..., object])

FEW = 40
"""Inputs of each test when SWARMWRIGHT_FUZZ, which `make fuzz` sets, says no other number."""

_LIMIT = 1 << 16
_CHANGES = 5
_LONGEST = 40


def fuzz(share: int = 1) -> Callable[[Test], Test]:
    """Settings of a fuzz test; `share`: one of so many inputs, where each takes long."""
    examples = max(1, int(os.environ.get("SWARMWRIGHT_FUZZ", FEW)) // share)
    return settings(
        max_examples=examples,
        deadline=None,
        database=None,
        phases=[Phase.explicit, Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )


@st.composite
def mutated(draw: st.DrawFn, corpus: Sequence[bytes], tokens: Sequence[bytes]) -> bytes:
    """One of the corpus, changed in up to five places. `tokens` are what the format has of its own."""
    data = bytearray(draw(st.sampled_from(list(corpus))))
    for _ in range(draw(st.integers(0, _CHANGES))):
        at = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, min(_LONGEST, len(data) - at)))
        match draw(st.sampled_from(["byte", "cut", "repeat", "token", "replace", "end", "other"])):
            case "byte" if at < len(data):
                data[at] = draw(st.integers(0, 255))
            case "cut":
                del data[at : at + length]
            case "repeat":
                data[at:at] = data[at : at + length] * draw(st.integers(1, 4))
            case "token":
                data[at:at] = draw(st.sampled_from(list(tokens)))
            case "replace":
                data[at : at + length] = draw(st.sampled_from(list(tokens)) | st.binary(max_size=8))
            case "end":
                del data[at:]
            case "other":
                other = draw(st.sampled_from(list(corpus)))
                data[at:] = other[draw(st.integers(0, len(other))) :]
    return bytes(data[:_LIMIT])
