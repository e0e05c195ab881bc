"""What is entered in a form, as changes of the experiment's text, and the text as what the form shows."""

from collections.abc import Mapping, Sequence
from typing import Any

from ruamel.yaml.nodes import Node, ScalarNode, SequenceNode

from swarmwright import InputError
from swarmwright.common import yaml
from swarmwright.common.yaml_edits import remove_value, set_value
from swarmwright.experiment.document import DEFAULT_KINDS
from swarmwright.experiment.settings import ANNOUNCED, list_kept_options
from swarmwright.simulations import catalogue
from swarmwright.ui.fields import Field, Form, Kinds

TEXT_BYTES = 64 << 10
"""Of an experiment that has a form: it is read anew at each change."""
ENTRY_CHARACTERS = 20_000
TOO_LONG = "(too long for the form)"
DEEPEST = 4
"""Keys of a path."""
LARGEST_WHOLE = 2**53
"""Below which 1e5 means the same as 100000."""
LONGEST_LIST = 1000
"""Values of a list that are varied."""
NAMES = {
    "integer": "a whole number",
    "number": "a number",
    "boolean": "true or false",
    "list": "a list such as [8, 4]",
    "mapping": "a mapping such as {key: 1}",
}


def read_text(text: str) -> dict[str, Any]:
    """Return the values of an experiment's text, which may have mistakes.

    Raises InputError with the line where it is not valid YAML, or has no form.
    """
    if len(text) > TEXT_BYTES:
        raise InputError(
            f"has more than {TEXT_BYTES >> 10} KiB, which is too much for the form; change the text"
        )
    source = yaml.parse(text, "text", TEXT_BYTES)
    if source.problems:
        _, line, message = source.problems[0]
        raise InputError(f"text:{line}: {message}")
    if not isinstance(source.values, Mapping | None):
        raise InputError("text:1: must be a mapping of keys such as simulation, controller and method")
    return dict(source.values or {})


def show_values(values: Any, depth: int = 0) -> dict[str, Any]:  # noqa: ANN401 - any plain value
    """Return values as a form shows them: `{text}`, and `keys` for a mapping with those of its values.

    A text that YAML has in quotes has them in `yaml`.
    """
    if isinstance(values, str):
        if len(values) > ENTRY_CHARACTERS:
            return {"text": TOO_LONG}
        quoted = yaml.dump_flow(values)
        return {"text": values} if quoted == values else {"text": values, "yaml": quoted}
    text = "" if values is None else yaml.dump_flow(values)
    shown: dict[str, Any] = {"text": text if len(text) <= ENTRY_CHARACTERS else TOO_LONG}
    if isinstance(values, Mapping) and depth < DEEPEST:
        shown["keys"] = {key: show_values(value, depth + 1) for key, value in values.items()}
    return shown


def change_text(text: str, path: Sequence[str], entry: str, form: Form) -> str:
    """Return the text of an experiment with what was entered in a field; empty for its default.

    A change of a kind, or of the simulation, removes what belongs to the former one alone, as `--set` does.
    Comments and the order of the text stay.

    Args:
        text: of the experiment.
        path: of the field.
        entry: what was entered.
        form: of the experiment.

    Raises InputError when the field does not take the entry, or the text cannot be changed.
    """
    values = read_text(text)
    field = form.field(path)
    value = read_entry(entry, field)
    if field.is_kind:
        text, order = _leave_kind(text, path, value, values), form.order(path)
        if field.path == ("servers", "launcher"):
            return (
                remove_value(text, path[:1])
                if value is None
                else set_value(text, path[:1], {"launcher": value}, form.order(path[:1]))
            )
    else:
        order = form.order(path)
    if value is None:
        return remove_value(text, path)
    present: Any = values
    for depth, key in enumerate(path):  # where a mapping begins that is not in the text yet, it has its order
        if not isinstance(present, Mapping) or key not in present:
            order = form.order(path[: depth + 1])
            break
        present = present[key]
    return set_value(text, path, value, order)


def _leave_kind(text: str, path: Sequence[str], value: Any, values: Mapping[str, Any]) -> str:  # noqa: ANN401
    """Return a text without what another kind or simulation does not have."""
    section = path[0]
    removed: list[tuple[str, ...]] = []
    present = values.get(section)
    if section in DEFAULT_KINDS and isinstance(present, Mapping):
        kind = value or DEFAULT_KINDS[section]
        if kind != present.get("kind", DEFAULT_KINDS[section]):
            stays = {"kind", *list_kept_options(section, kind)}
            removed = [(section, key) for key in present if key not in stays]
    elif tuple(path) == ("simulation",) and isinstance(value, str) and value != present:
        built_in = catalogue.find_built_in(value)
        parameters = values.get("parameters")
        if built_in is not None:
            removed = [(key,) for key in ANNOUNCED if key in values]
        if built_in is not None and isinstance(parameters, Mapping):
            names = catalogue.parameter_names(built_in)
            removed += [("parameters", key) for key in parameters if key not in names]
    for key_path in removed:
        text = remove_value(text, key_path)
    return text


def read_entry(entry: str, field: Field) -> Any:  # noqa: ANN401 - any plain value
    """Return the value that was entered in a field; None for its default.

    Raises InputError when the field does not take it.
    """
    if len(entry) > ENTRY_CHARACTERS:
        raise InputError(f"must have at most {ENTRY_CHARACTERS:,} characters, not {len(entry):,}")
    stripped = entry.strip()
    if not stripped:
        return None
    if field.is_choice:
        if stripped not in field.choices:
            raise InputError(f"must be one of {', '.join(field.choices)}, not {stripped[:50]!r}")
        return stripped
    if "any" in field.takes:
        return _read_yaml(stripped)
    for value in (_read_scalar(stripped, field), _read_collection(stripped, field)):
        if value is not None:
            return value
    if "text" in field.takes or stripped in field.choices:
        return stripped
    options = [*field.choices, *(NAMES[kind] for kind in field.takes)]
    raise InputError(f"must be {' or '.join(options)}, not {stripped[:50]!r}")


def _read_scalar(text: str, field: Field) -> int | float | bool | None:
    """Return a number or a boolean that a field takes; None for anything else."""
    value = _read_plain(text) if {"integer", "number", "boolean"} & set(field.takes) else None
    if isinstance(value, bool):
        return value if "boolean" in field.takes else None
    if value is None or not {"integer", "number"} & set(field.takes):
        return None
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_WHOLE
    return int(value) if is_whole and "number" not in field.takes else value


def _read_collection(text: str, field: Field) -> list[Any] | dict[str, Any] | None:
    """Return a list or mapping that a field takes; None for anything else."""
    is_only_choice = len(field.takes) == 1
    if text[0] not in "[{":
        if not is_only_choice or field.takes[0] not in {"list", "mapping"}:
            return None
        text = f"[{text}]" if "list" in field.takes else text
    if not {"list", "mapping"} & set(field.takes):
        return None
    value = _read_yaml(text)
    if isinstance(value, list):
        return value if "list" in field.takes else None
    return value if isinstance(value, dict) and "mapping" in field.takes else None


def read_entries(entries: str, field: Field) -> list[Any]:
    """Return the values of a field to try one after another, entered as a list with or without brackets.

    Raises InputError for an empty list, a value that occurs twice, and one that the field does not take.
    """
    if len(entries) > ENTRY_CHARACTERS:
        raise InputError(f"must have at most {ENTRY_CHARACTERS:,} characters, not {len(entries):,}")
    items = _read_items(f"[{entries.strip()}]")
    # Of a field that takes a list itself, "[8, 4]" is a single value.
    if len(items) == 1 and isinstance(items[0][1], list) and "list" not in field.takes:
        items = _read_items(entries)
    if not items:
        raise InputError("must list values, such as 10, 20, 50")
    if len(items) > LONGEST_LIST:
        raise InputError(f"must list at most {LONGEST_LIST:,} values, not {len(items):,}")
    read = [_read_item(node, value, field) for node, value in items]
    texts = [yaml.dump_flow(value) for value in read]
    twice = next((text for index, text in enumerate(texts) if text in texts[:index]), None)
    if twice is not None:
        raise InputError(f"{twice[:50]} is listed twice")
    return read


def _read_items(text: str) -> list[tuple[Node, Any]]:
    """Return the items of a list as they are written, and their values."""
    values = _read_yaml(text)
    root = yaml.compose(text, "entry")
    return list(zip(root.value, values, strict=True)) if isinstance(root, SequenceNode) else []


def _read_item(node: Node, value: Any, field: Field) -> Any:  # noqa: ANN401 - any plain value
    """Return a value of a list that was entered, which the field takes as it takes a single one."""
    if not isinstance(node, ScalarNode):
        return read_entry(yaml.dump_flow(value), field)
    if node.style is None:
        return read_entry(node.value, field)
    is_text = isinstance(value, str) and {"any", "text"} & set(field.takes)
    return value if is_text else read_entry(node.value, field)


def _read_plain(text: str) -> Any:  # noqa: ANN401 - any plain value
    """Return a number or a boolean; None for other text. Raises InputError for numbers that are too large."""
    words = text.lower()
    if words in {"true", "false"}:
        return words == "true"
    if words.lstrip("+-.")[:1].isdecimal() or words.lstrip("+-") in {
        ".inf",
        ".nan",
        "inf",
        "nan",
        "infinity",
    }:
        value = _read_yaml(text)
        if isinstance(value, float) and value - value != 0:
            raise InputError("must be a finite number")
        return value if isinstance(value, int | float) else None
    return None


def _read_yaml(text: str) -> Any:  # noqa: ANN401 - any plain value
    try:
        source = yaml.parse(text, "entry")
    except InputError as error:
        raise InputError(yaml.remove_locations(str(error), "entry")) from None
    for _, _, message in source.problems:
        raise InputError(message)
    return source.values


def find_kinds(text: str) -> tuple[dict[str, Any], Kinds]:
    """Return the values of a text, and what its form depends on. Raises InputError as `read_text`."""
    values = read_text(text)
    return values, Kinds.of(values)
