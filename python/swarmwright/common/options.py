"""Typed options: the single source of validation, JSON Schema and reference pages."""

import ast
import inspect
import textwrap
from typing import TYPE_CHECKING, Any, TypeVar, dataclass_transform, get_args

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass

    @dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(Field,))
    class Frozen(ModelMetaclass):
        """Tells type checkers that options are frozen, so that a `kind` of `str` may become a literal."""

else:
    Frozen = type(BaseModel)


class Options(BaseModel, metaclass=Frozen):
    """Base class of every section of an experiment file.

    Unknown keys are errors, nothing is converted silently ("50" is not a number, 1.5 is not an integer), and
    numbers are finite. Every field has a default if one makes sense, and a description: the docstring below
    it, which appears in the schema and the reference page (see `add_descriptions`).
    """

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        validate_default=True,
        allow_inf_nan=False,
    )


Model = TypeVar("Model", bound=Options)


def add_descriptions(model: type[Model]) -> type[Model]:
    """Set the descriptions of all fields of a model and of nested models from docstrings; return the model.

    Descriptions by `Field(description=..)` are kept.
    """
    texts: dict[str, str] = {}
    for owner in reversed(model.__mro__):
        if issubclass(owner, Options) and owner is not Options:
            texts |= _docstrings(owner)
    changed = False
    for name, field in model.model_fields.items():
        for inner in _models(field.annotation):
            add_descriptions(inner)
            changed = True
        if field.description is None and name in texts:
            field.description = texts[name]
            changed = True
    if changed:
        model.model_rebuild(force=True)
    return model


def _models(annotation: Any) -> list[type[Options]]:  # noqa: ANN401 - any type
    """Return the models in an annotation such as `Timeouts | None`."""
    if isinstance(annotation, type) and issubclass(annotation, Options):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _docstrings(owner: type) -> dict[str, str]:
    try:
        source = inspect.getsource(owner)
    except (OSError, TypeError):  # defined in an interactive session
        return {}
    (definition,) = ast.parse(textwrap.dedent(source)).body
    assert isinstance(definition, ast.ClassDef)
    docstrings = {}
    for field, text in zip(definition.body, definition.body[1:], strict=False):
        if (
            isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(text, ast.Expr)
            and isinstance(text.value, ast.Constant)
            and isinstance(text.value.value, str)
        ):
            docstrings[field.target.id] = inspect.cleandoc(text.value.value)
    return docstrings
