"""Validation errors of files, reworded for authors of experiments."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from swarmwright.common.errors import InputError
from swarmwright.common.files import check_utf8
from swarmwright.common.suggestions import UnknownKey, did_you_mean, unknown_key
from swarmwright.common.yaml import Path_, format_path, parse

Report = Callable[[Path_, str], None]
"""Receives a problem: its path and message."""
_WANTED = {
    "int_type": "an integer",
    "int_from_float": "an integer",
    "int_parsing": "an integer",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text",
    "bool_type": "true or false",
    "dict_type": "a mapping (key: value)",
    "model_type": "a mapping (key: value)",
    "model_attributes_type": "a mapping (key: value)",
}
_LIMITS = {
    "greater_than_equal": ("ge", "at least"),
    "greater_than": ("gt", "greater than"),
    "less_than_equal": ("le", "at most"),
    "less_than": ("lt", "less than"),
    "multiple_of": ("multiple_of", "a multiple of"),
}
_LENGTHS = {"too_short": ("min_length", "at least"), "too_long": ("max_length", "at most")}


def format_value(value: Any, limit: int = 60) -> str:  # noqa: ANN401 - any value of a file
    """Format a value as in a YAML file, shortened."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return "a mapping"
    text = repr(value)
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


class FieldError(InputError, ValueError):
    """A field of the input is invalid. The message is `path: reason`.

    Validators of options raise it for a field; pydantic accepts any ValueError.
    """

    def __init__(self, path: Path_ | str, reason: str) -> None:
        self.path = (path,) if isinstance(path, str) else path
        self.reason = reason
        super().__init__(f"{format_path(self.path)}: {reason}" if self.path else reason)

    def __reduce__(self) -> tuple[type, tuple[Path_, str]]:
        """Return the arguments with which `pickle` recreates the error."""
        return type(self), (self.path, self.reason)


def problems_of(
    error: ValidationError,
    model: type[BaseModel],
    at: Path_ = (),
    values: Any = None,  # noqa: ANN401 - any values of a file
) -> list[tuple[Path_, str]]:
    """Return (path, message) for each problem that pydantic found in a section at `at`.

    values: the whole file; paths are then those in it, without pydantic's names of union variants.
    """
    return [_problem(dict(details), model, at, values) for details in error.errors(include_url=False)]


def _problem(
    details: dict[str, Any],
    model: type[BaseModel],
    at: Path_,
    values: Any,  # noqa: ANN401 - as above
) -> tuple[Path_, str]:
    path = (*at, *details["loc"])
    if values is not None:
        path = _as_written(path, values, keep_last=details["type"] == "missing")
    error = details.get("ctx", {}).get("error")
    if isinstance(error, FieldError):
        return (*path, *error.path), error.reason
    return path, _message(details, model)


def _as_written(path: Path_, values: Any, *, keep_last: bool) -> Path_:  # noqa: ANN401 - as above
    """Return a path without names of union variants, which are not in the file."""
    written: list[str | int] = []
    for index, part in enumerate(path):
        if _holds(values, part):
            written.append(part)
            values = values[part]
        elif index == len(path) - 1 and keep_last:
            written.append(part)
    return tuple(written)


def _holds(values: Any, part: str | int) -> bool:  # noqa: ANN401 - as above
    if isinstance(values, Mapping):
        return part in values
    return isinstance(values, list | tuple) and isinstance(part, int) and 0 <= part < len(values)


def _message(details: dict[str, Any], model: type[BaseModel]) -> str:
    kind: str = details["type"]
    context: dict[str, Any] = details.get("ctx", {})
    value = details.get("input")
    if kind == "missing":
        return "is missing"
    if kind == "extra_forbidden":
        return _unknown_key(str(details["loc"][-1]), model_at(model, details["loc"][:-1]))
    if kind == "list_type":
        return _no_list(value, model_at(model, details["loc"][:-1]), str(details["loc"][-1]))
    if kind in _WANTED:
        return f"must be {_WANTED[kind]}, not {format_value(value)}"
    if kind in _LIMITS:
        name, words = _LIMITS[kind]
        limit = context[name]
        whole = int(limit) if isinstance(limit, float) and limit.is_integer() else limit
        return f"must be {words} {whole}, not {format_value(value)}"
    if kind == "literal_error":
        choices = str(context["expected"]).replace("'", "").replace(" or ", ", ").split(", ")
        hint = did_you_mean(value, choices) if isinstance(value, str) else ""
        return f"must be one of {', '.join(choices)}, not {format_value(value)}{hint}"
    if kind == "string_too_short":
        return "must not be empty"
    if kind in _LENGTHS:
        name, words = _LENGTHS[kind]
        return f"must have {words} {context[name]} item(s)"
    if kind == "union_tag_not_found":
        return f"{str(context['discriminator']).strip(chr(39))} is missing"
    if kind == "union_tag_invalid":
        choices = str(context["expected_tags"]).replace("'", "").split(", ")
        hint = did_you_mean(str(context["tag"]), choices)
        key = str(context["discriminator"]).strip("'")
        return f"{key} must be one of {', '.join(choices)}, not {format_value(context['tag'])}{hint}"
    if kind in {"value_error", "assertion_error"}:
        return str(context["error"])
    return (
        _explain_not_utf8(value)
        if kind == "string_unicode"
        else f"{details['msg']} (given: {format_value(value)})"
    )


def _explain_not_utf8(value: Any) -> str:  # noqa: ANN401 - any value of a file
    """Return a message on text with bytes of a file name that are not characters."""
    try:
        check_utf8(str(value))
    except InputError as error:
        return str(error)
    return f"must be text, not {format_value(value)}"


def _no_list(value: Any, section: type[BaseModel] | None, key: str) -> str:  # noqa: ANN401 - any value of a file
    """Return a message on a value that is not a list, with the valid form if the value fits into one."""
    field = None if section is None else section.model_fields.get(key)
    if section is None or field is None:  # an item of a list, or an unknown section
        return f"must be a list, not {format_value(value)}"
    names = ("min_length", "max_length")
    lengths = [getattr(limit, name) for limit in field.metadata for name in names if hasattr(limit, name)]
    count = f" of {lengths[0]} items" if len(lengths) == len(names) and len(set(lengths)) == 1 else ""
    forms = (items for items in _lists_of(value) if _is_valid(section, key, items))
    form = next((f"; write [{', '.join(map(format_value, items))}]" for items in forms), "")
    return f"must be a list{count}, not {format_value(value)}{form}"


def _is_valid(section: type[BaseModel], key: str, value: Any) -> bool:  # noqa: ANN401 - any value of a file
    """Return whether a section accepts the value of a key, regardless of other keys."""
    try:
        section.model_validate({key: value})
    except ValidationError as error:
        return not any(details["loc"][:1] == (key,) for details in error.errors(include_url=False))
    return True


def _lists_of(value: Any) -> Iterator[list[Any]]:  # noqa: ANN401 - any value of a file
    """Yield the lists that a value without brackets may mean: its items (`8, 4`), or the value alone."""
    if isinstance(value, str) and "," in value:
        with suppress(InputError):
            listed = parse(f"[{value}]", "")
            if isinstance(listed.values, list) and not listed.problems:
                yield listed.values
    if isinstance(value, int | float | str):
        yield [value]


def _unknown_key(key: str, model: type[BaseModel] | None) -> str:
    if model is None:
        return UnknownKey("unknown key")
    keys = [field.alias or name for name, field in model.model_fields.items()]
    if key.casefold() == "files" and "servers" in keys:
        return UnknownKey(
            "unknown key",
            "; list files that the simulation reads in the section servers, such as "
            "servers: {launcher: process, count: 4, files: [map.json]}",
        )
    return unknown_key(key, keys)


def model_at(model: type[BaseModel], path: tuple[str | int, ...]) -> type[BaseModel] | None:
    """Return the model of the section at `path` below `model`; None if it is not a section."""
    rest = list(path)
    while rest:
        key = str(rest.pop(0))
        fields = model.model_fields
        field = fields.get(key) or next(
            (alias_field for alias_field in fields.values() if alias_field.alias == key), None
        )
        inner = None if field is None else _inner(field.annotation)
        if inner is None:
            return None
        model, several = inner
        if several:
            if not rest:
                return None
            rest.pop(0)  # the index of an item, or its name
    return model


def _inner(annotation: Any) -> tuple[type[BaseModel], bool] | None:  # noqa: ANN401 - any type
    """Return the model in a field's type, and whether the field is a list or mapping of them."""
    for part in (annotation, *get_args(annotation)):
        if isinstance(part, type) and issubclass(part, BaseModel):
            return part, get_origin(annotation) in {list, dict}
    return None


MOST_PROBLEMS = 100
"""Largest number of reported problems of a file: a hostile file may have millions."""


class ProblemLines:
    """Unique lines on problems, in the order in which they were found."""

    def __init__(self) -> None:
        self._lines: dict[str, None] = {}

    def __len__(self) -> int:
        return len(self._lines)

    def add(self, line: str) -> None:
        """Add a problem. Raises InputError with all of them if there are MOST_PROBLEMS."""
        self._lines[line] = None
        if len(self._lines) >= MOST_PROBLEMS:
            more = f"and maybe more; these are the first {MOST_PROBLEMS}"
            raise InputError("\n".join([*self._lines, more]))

    def stop(self) -> None:
        """Raise InputError if there is a problem."""
        if self._lines:
            raise InputError("\n".join(self._lines))
