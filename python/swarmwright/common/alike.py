"""Names of the same thing that are written differently, in a file and in a simulation."""

import unicodedata
from collections.abc import Sequence


def folded(name: str) -> str:
    """Return a name as it is compared: `goal x`, `goal_x` and `goalX` are the same.

    Letters and digits of all scripts count, others do not; it is empty for a name without any.
    """
    return "".join(one for one in unicodedata.normalize("NFKC", name).casefold() if one.isalnum())


def alike(name: str, names: Sequence[str]) -> list[int]:
    """Return the indices of the names that a name may stand for: exactly the same ones, or else alike ones.

    More than one: the name is ambiguous. A name without letters and digits is like no other one.
    """
    same = [index for index, one in enumerate(names) if one == name]
    if same:
        return same
    key = folded(name)
    return [index for index, one in enumerate(names) if folded(one) == key] if key else []
