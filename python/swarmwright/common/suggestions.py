"""Near misses of names: the same name written differently, and did you mean."""

import unicodedata
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Self

_MOST_NAMES = 1000
"""Names that are compared by their spelling; more, as hostile files have, would take seconds each time."""
_SHORTEST_WORD = 3
"""Letters of a word that is looked for in names."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the `nearest` of `known`, or "" when none is near."""
    near = nearest(name, known)
    return "" if near is None else f"; did you mean '{near}'?"


def suggest_or_list(name: str, known: Iterable[str], words: str = "available") -> str:
    """Return "; did you mean 'x'?", or "; available: a, b" where none is near; words: instead of that one."""
    names = list(known)
    return did_you_mean(name, names) or f"; {words}: {', '.join(names) or 'none'}"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the one of `known` that was meant; None when none is near.

    A name that begins or ends with the word, speedAgents for speed, is nearer than one that is spelt alike.
    """
    names = list(known)
    same = alike(name, names)
    if same:
        return names[same[0]]
    longer = [candidate for candidate in names[:_MOST_NAMES] if _has_word(candidate, name.casefold())]
    return min(longer, key=len) if longer else similar(name, names[:_MOST_NAMES])


def similar(name: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the one of `known` with the most similar spelling; None when none is similar.

    cutoff: least similarity, 0 to 1.
    """
    by_folded = {candidate.casefold(): candidate for candidate in known}
    near = get_close_matches(name.casefold(), by_folded, n=1, cutoff=cutoff)
    return by_folded[near[0]] if near else None


def _has_word(candidate: str, word: str) -> bool:
    """Return whether a name begins or ends with a word, as numAgents does with num and agents."""
    whole = candidate.casefold()
    if len(word) < _SHORTEST_WORD or len(whole) != len(candidate) or len(whole) <= len(word):
        return False
    if whole.startswith(word):
        return True
    first, before = candidate[-len(word)], candidate[-len(word) - 1]
    return whole.endswith(word) and (first.isupper() or not before.isalnum())


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """Say that `name` is not a known `what`, with the nearest known name and the list of all."""
    names = sorted(known)
    hint = did_you_mean(name, names) or ";"
    return f"unknown {what} {name!r}{hint} available: {', '.join(names)}"


class UnknownKey(str):
    """A message about a key that is not known where it stands.

    Args:
        subject: what is said of it, "unknown key".
        hint: what follows, "; did you mean 'population'?".
    """

    __slots__ = ("subject",)

    subject: str

    def __new__(cls, subject: str, hint: str = "") -> Self:
        """Return the message."""
        message = super().__new__(cls, subject + hint)
        message.subject = subject
        return message


def unknown_key(key: str, known: Iterable[str]) -> UnknownKey:
    """Say that a file has no such key, with the nearest known one or the list of all, in their order."""
    return UnknownKey("unknown key", suggest_or_list(key, known, "known keys"))


def fold_name(name: str) -> str:
    """Return a name as it is compared: `goal x`, `goal_x` and `goalX` are the same.

    Letters and digits of all scripts count, others do not; it is empty for a name without any.
    """
    return "".join(
        character for character in unicodedata.normalize("NFKC", name).casefold() if character.isalnum()
    )


def alike(name: str, names: Sequence[str]) -> list[int]:
    """Return the indices of the names that a name may stand for: exactly the same ones, or else alike ones.

    More than one: the name is ambiguous. A name without letters and digits is like no other one.
    """
    same = [index for index, other in enumerate(names) if other == name]
    if same:
        return same
    key = fold_name(name)
    return [index for index, other in enumerate(names) if fold_name(other) == key] if key else []
