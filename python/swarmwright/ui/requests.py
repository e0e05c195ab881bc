"""Values of requests: read, and refused with a message that names them."""

from typing import Any, TypeVar

from starlette.requests import Request

from swarmwright.common.errors import InputError

MOST_DIGITS = 20
KINDS: dict[type, str] = {str: "text", list: "a list", dict: "a mapping"}
T = TypeVar("T")


def read_integer(request: Request, name: str) -> int:
    """Return a whole number of the query. Raises InputError for anything else."""
    text = request.query_params.get(name, "")
    try:
        if len(text) > MOST_DIGITS:
            raise ValueError
        return int(text)
    except ValueError:
        raise InputError(f"{name}: must be a whole number, not {text[:50]!r}") from None


def read_optional_integer(request: Request, name: str) -> int | None:
    """Return a whole number of the query, None where it is missing or empty."""
    return read_integer(request, name) if request.query_params.get(name) else None


def read_number(request: Request, name: str) -> float:
    """Return a number of the query. Raises InputError for anything else."""
    text = request.query_params.get(name, "")
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: must be a number, not {text[:50]!r}") from None


def read_field(values: dict[str, Any], name: str, kind: type[T]) -> T:
    """Return a value of a request. Raises InputError when it is missing or of another type."""
    value = values.get(name)
    if not isinstance(value, kind):
        raise InputError(f"{name}: must be {KINDS[kind]}")
    if kind is str:
        try:
            str(value).encode()
        except UnicodeEncodeError:
            raise InputError(f"{name}: is not valid Unicode") from None
    return value


def read_whole(value: Any, name: str) -> int:  # noqa: ANN401 - JSON
    """Return a whole number of a request, or a text that is one, as fields of forms have it.

    Raises InputError for anything else.
    """
    try:
        if isinstance(value, str) and len(value) <= MOST_DIGITS:
            return int(value)
    except ValueError:
        pass
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{name}: must be a whole number, not {str(value)[:50]!r}")
    return value
