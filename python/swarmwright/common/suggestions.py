"""Suggestions for mistyped names."""

import unicodedata
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Self

_MOST_NAMES = 1000
"""Largest number of names to compare by spelling; more, as in hostile files, would take seconds."""
_SHORTEST_WORD = 3
"""Smallest number of letters of a word to search in names."""


def did_you_mean(name: str, candidates: Iterable[str]) -> str:
    """Return "; did you mean 'x'?" for the `nearest` candidate, or "" if none is similar."""
    match = nearest(name, candidates)
    return "" if match is None else f"; did you mean '{match}'?"


def suggest_or_list(name: str, candidates: Iterable[str], words: str = "available") -> str:
    """Return "; did you mean 'x'?", or if none is similar "; available: a, b" with `words` before it."""
    names = list(candidates)
    return did_you_mean(name, names) or f"; {words}: {', '.join(names) or 'none'}"


def nearest(name: str, candidates: Iterable[str]) -> str | None:
    """Return the candidate most similar to a name; None if none is similar.

    A candidate that begins or ends with the name (speedAgents for speed) precedes similar spellings.
    """
    names = list(candidates)
    equal = alike(name, names)
    if equal:
        return names[equal[0]]
    longer = [candidate for candidate in names[:_MOST_NAMES] if _has_word(candidate, name.casefold())]
    return min(longer, key=len) if longer else similar(name, names[:_MOST_NAMES])


def similar(name: str, candidates: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the candidate with the most similar spelling; None if none is similar.

    cutoff: least similarity, 0 to 1.
    """
    by_folded = {candidate.casefold(): candidate for candidate in candidates}
    matches = get_close_matches(name.casefold(), by_folded, n=1, cutoff=cutoff)
    return by_folded[matches[0]] if matches else None


def _has_word(candidate: str, word: str) -> bool:
    """Return whether a name begins or ends with a word, such as numAgents with num and agents."""
    whole = candidate.casefold()
    if len(word) < _SHORTEST_WORD or len(whole) != len(candidate) or len(whole) <= len(word):
        return False
    if whole.startswith(word):
        return True
    first, before = candidate[-len(word)], candidate[-len(word) - 1]
    return whole.endswith(word) and (first.isupper() or not before.isalnum())


def unknown(noun: str, name: str, candidates: Iterable[str]) -> str:
    """Return a message on an unknown name of a `noun`, with the nearest name and the list of all."""
    names = sorted(candidates)
    hint = did_you_mean(name, names) or ";"
    return f"unknown {noun} {name!r}{hint} available: {', '.join(names)}"


class UnknownKey(str):
    """A message on an unknown key.

    Args:
        subject: beginning of the message, "unknown key".
        hint: the rest, "; did you mean 'population'?".
    """

    __slots__ = ("subject",)

    subject: str

    def __new__(cls, subject: str, hint: str = "") -> Self:
        """Return the message."""
        message = super().__new__(cls, subject + hint)
        message.subject = subject
        return message


def unknown_key(key: str, candidates: Iterable[str]) -> UnknownKey:
    """Return a message on an unknown key of a file, with the nearest key or the list of all, in order."""
    return UnknownKey("unknown key", suggest_or_list(key, candidates, "known keys"))


def fold_name(name: str) -> str:
    """Normalize a name for comparison: `goal x`, `goal_x` and `goalX` are the same.

    Only letters and digits of all scripts count; without any, the result is empty.
    """
    return "".join(
        character for character in unicodedata.normalize("NFKC", name).casefold() if character.isalnum()
    )


def alike(name: str, names: Sequence[str]) -> list[int]:
    """Return the indices of the names that a name may mean: equal ones, or else equivalent ones.

    With several, the name is ambiguous. A name without letters and digits has no equivalents.
    """
    equal = [index for index, candidate in enumerate(names) if candidate == name]
    if equal:
        return equal
    key = fold_name(name)
    return [index for index, candidate in enumerate(names) if fold_name(candidate) == key] if key else []
