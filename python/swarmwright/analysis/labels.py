"""Labels: short descriptions of what distinguishes groups of runs, or variants of a sweep."""

import json
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from swarmwright.common.simulation_names import label_of
from swarmwright.common.values import flatten
from swarmwright.experiment.experiment import Experiment
from swarmwright.simulations.user_code.parts import SECTIONS

_LONGEST_VALUE = 24
"""Largest number of characters of a value in a label."""
_HEAD = 8
"""Characters that are kept of a value's beginning if a later part of it is shown."""
_CHARACTERS_BEFORE = 12
"""Largest number of characters before a difference at which the shown part begins."""


class Wording:
    """Texts for the values that distinguish groups; different values of a key have different texts.

    Args:
        groups: keys of the experiment that differ, with their values, for each group.
    """

    def __init__(self, groups: Sequence[Mapping[str, Any]]) -> None:
        values: dict[str, dict[str, Any]] = defaultdict(dict)
        for differs in groups:
            for key, value in differs.items():
                values[key][_identity(value)] = value
        self._texts = {key: _texts(key, distinct) for key, distinct in values.items()}

    def words(self, differs: Mapping[str, Any], among: Mapping[str, Any]) -> Iterator[str]:
        """Yield a text for each key: only the value for kinds, other values with the name of their key.

        among: all keys of the group, whose names must be unique.
        """
        for key, value in differs.items():
            text = self._texts[key][_identity(value)]
            yield text if _is_kind(key) else f"{_shortest(key, among)} {text}"


def labels_of(
    groups: Sequence[Mapping[str, Any]], kinds: Sequence[Mapping[str, Any]] | None = None
) -> list[str]:
    """Return labels of groups from the values of the differing keys in each of them.

    Keys that do not distinguish groups are omitted, see `telling`.
    """
    distinguishing = telling(groups, kinds)
    wording = Wording(distinguishing)
    return [", ".join(wording.words(differs, differs)) for differs in distinguishing]


def telling(
    groups: Sequence[Mapping[str, Any]], kinds: Sequence[Mapping[str, Any]] | None = None
) -> Sequence[Mapping[str, Any]]:
    """Return groups without the keys that have the same value in all of them.

    An option of a component is omitted if it is equal in all groups with its kind, since other kinds do not
    have it. The groups are returned unchanged if they would become equal, or if one would have no keys.

    kinds: keys of each group, including kinds that do not differ; by default the groups themselves, in which
    an omitted kind may be any.
    """
    kinds = groups if kinds is None else kinds
    values: dict[tuple[str, Any], list[str]] = defaultdict(list)
    for group, kinds_of_group in zip(groups, kinds, strict=True):
        for key, value in group.items():
            values[key, kind_of(key, kinds_of_group)].append(_identity(value))
    sizes = {key: Counter(kind_of(key, kinds_of_group) for kinds_of_group in kinds) for key, _ in values}
    constant = {
        (key, kind)
        for (key, kind), texts in values.items()
        if len(set(texts)) == 1 and len(texts) == sizes[key][kind] + (0 if kind is None else sizes[key][None])
    }
    reduced = [
        {key: value for key, value in group.items() if (key, kind_of(key, kinds_of_group)) not in constant}
        for group, kinds_of_group in zip(groups, kinds, strict=True)
    ]
    distinct = {_identity(label) for label in reduced}
    return (
        reduced if all(reduced) and len(distinct) == len({_identity(group) for group in groups}) else groups
    )


def kind_of(key: str, values: Mapping[str, Any]) -> str | None:
    """Return the kind of the component that has a key as an option; None if there is none, or for a kind.

    values: values of the experiment's keys, including kinds.
    """
    section, _, last = key.rpartition(".")
    first = key.partition(".")[0]
    kind_key = f"{first if first in SECTIONS else section}.kind"
    if section == "code":  # the code of a component, which its kind names, or of the simulation
        kind_key = "simulation" if last == "simulation" else f"{last}.kind"
    kind = None if key == kind_key else values.get(kind_key)
    return kind if isinstance(kind, str) else None


def label_alone(values: Mapping[str, Any]) -> str:
    """Return a label of a variant from its own values, which are cut after 24 characters.

    It does not depend on other variants, and must not change between versions, since names of folders are
    made of it.
    """
    words = []
    for key, value in values.items():
        if _is_kind(key):
            words.append(str(value))
        else:
            text = _identity(value) if isinstance(value, Mapping) else _text(key, value)
            words.append(f"{_shortest(key, values)} {_cut(text)}")
    return ", ".join(words)


def name_of(experiment: Experiment) -> str:
    """Return the label of a single group: simulation and method."""
    return f"{experiment.label}, {label_of(experiment.method.kind)}"


def abbreviations(texts: Collection[str]) -> dict[str, str]:
    """Return a short form of each text; different texts have different forms.

    A long text is cut. If several would have the same form, they show their beginning and the part in which
    they differ; if these look like others, they are not shortened.
    """
    forms = {text: _cut(text) for text in texts}
    waiting = _find_shared_forms(texts, forms)
    while waiting:
        together = waiting.pop()
        start = _common_beginning(together)
        for text in together:
            forms[text] = _from(text, start)
        waiting += _find_shared_forms(together, forms)
    for together in _find_shared_forms(texts, forms):
        forms.update((text, text) for text in together)
    return forms


def _common_beginning(texts: Collection[str]) -> int:
    """Return the length of the texts' common prefix, which is that of the smallest and the largest."""
    first, last = min(texts), max(texts)
    pairs = enumerate(zip(first, last, strict=False))
    return next((index for index, (left, right) in pairs if left != right), len(first))


def _find_shared_forms(texts: Collection[str], forms: Mapping[str, str]) -> list[list[str]]:
    """Return the lists of texts that share a form."""
    texts_by_form = defaultdict(list)
    for text in texts:
        texts_by_form[forms[text]].append(text)
    return [together for together in texts_by_form.values() if len(together) > 1]


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 1]}…"


def _from(text: str, start: int) -> str:
    """Return the beginning of a text, and the part from the word that contains a position."""
    word = next(
        (at for sign in " /" if (at := text.rfind(sign, max(start - _CHARACTERS_BEFORE, 0), start)) >= 0),
        None,
    )
    begin = max(start - 1, 0) if word is None else word + 1
    return _cut(text) if begin <= _HEAD else f"{text[:_HEAD].rstrip()} … {_cut(text[begin:])}"


def _texts(key: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the text of each value of a key, by the value's identity."""
    plain = {identity: _text(key, value) for identity, value in values.items()}
    if len(values) > 1 and all(isinstance(value, Mapping) for value in values.values()):
        plain = _mapping_texts(values)
    if len(set(plain.values())) < len(plain):  # for example, the text "1" and the number 1
        plain = {identity: identity for identity in plain}
    if _is_kind(key):
        return plain
    short = abbreviations(set(plain.values()))
    return {identity: short[text] for identity, text in plain.items()}


def _text(key: str, value: Any) -> str:  # noqa: ANN401 - any value of a file
    if value is None:
        return "not given"
    if isinstance(value, str):
        return value
    if key == "parameters.robots" and isinstance(value, list):
        return _kinds(value)
    if isinstance(value, Mapping):
        return _leaves(flatten(value))
    return _identity(value)


def _mapping_texts(values: Mapping[str, Any]) -> dict[str, str]:
    """Return texts of mappings: their keys, or the values that differ if two have the same keys."""
    names = {identity: ", ".join(map(str, value)) or "{}" for identity, value in values.items()}
    if len(set(names.values())) == len(names):
        return names
    flattened = {identity: flatten(value) for identity, value in values.items()}
    values_by_name: dict[str, set[str]] = defaultdict(set)
    for leaves in flattened.values():
        for name, value in leaves.items():
            values_by_name[name].add(_identity(value))
    everywhere = {
        name
        for name, different in values_by_name.items()
        if len(different) == 1 and all(name in leaves for leaves in flattened.values())
    }
    return {
        identity: _leaves({name: value for name, value in leaves.items() if name not in everywhere})
        for identity, leaves in flattened.items()
    }


def _leaves(leaves: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_text('', value)}" for name, value in leaves.items()) or "{}"


def _identity(value: Any) -> str:  # noqa: ANN401 - any value of a file
    return json.dumps(value, default=str, ensure_ascii=False)


def _kinds(robots: Sequence[Any]) -> str:
    """Return the kinds of robots of a mixed swarm, such as 12 scout, 4 carrier."""
    words = (
        f"{robot.get('count', '')} {robot.get('name', '')}" for robot in robots if isinstance(robot, Mapping)
    )
    return ", ".join(word.strip() for word in words)


def _is_kind(key: str) -> bool:
    """Return whether a key names the kind of a component; parameters may have kinds of their own."""
    section, _, last = key.rpartition(".")
    return key == "simulation" or (last == "kind" and section.partition(".")[0] != "parameters")


def _shortest(key: str, among: Mapping[str, Any]) -> str:
    """Return the last part of a key, or the whole key if another one, or the run's seed, has the same."""
    section, _, last = key.rpartition(".")
    if section == "code":
        return f"code of the {last}"
    if last == "kind":
        return key.removeprefix("parameters.")
    return last if last != "seed" and sum(other.rpartition(".")[2] == last for other in among) == 1 else key
