"""Dictionaries and lists that cannot be changed, such as those within an experiment.

They are subclasses of `dict` and `list`, so that JSON, YAML and the engine take them for what they are. They
can be copied and pickled; `plain` makes ordinary ones of them.
"""

from collections.abc import Mapping
from typing import Any, NoReturn

from pydantic import BaseModel


def _refuse(*_: object, **__: object) -> NoReturn:
    raise TypeError(
        "an experiment cannot be changed; experiment.replace(parameters={'name': value}) returns a changed "
        "copy, experiment.to_mapping() plain values that can be changed"
    )


class ReadOnlyDict(dict[Any, Any]):
    """A dict that cannot be changed; it equals one with the same items."""

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type, tuple[dict[Any, Any]]]:
        """Pickle and copy the items at once: none can be set afterwards."""
        return type(self), (dict(self),)


class ReadOnlyList(list[Any]):
    """A list that cannot be changed; it equals one with the same items."""

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple[type, tuple[list[Any]]]:
        """Pickle and copy the items at once: none can be set afterwards."""
        return type(self), (list(self),)


def read_only(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a value with read-only dictionaries and lists; options (pydantic) keep them in their place."""
    if isinstance(value, ReadOnlyDict | ReadOnlyList):
        return value
    if isinstance(value, Mapping):
        return ReadOnlyDict({key: read_only(inner) for key, inner in value.items()})
    if isinstance(value, list):
        return ReadOnlyList(map(read_only, value))
    if isinstance(value, BaseModel):
        fields = vars(value)  # their class refuses to set attributes
        for name, inner in fields.items():
            if isinstance(inner, BaseModel | Mapping | list):
                fields[name] = read_only(inner)
    return value


def plain(value: Any) -> Any:  # noqa: ANN401 - any nested value
    """Return a copy with ordinary dictionaries and lists in the place of read-only ones."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return list(map(plain, value)) if isinstance(value, list) else value
