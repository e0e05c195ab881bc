"""Typed options: the one source of validation, JSON Schema and reference pages."""

from typing import TYPE_CHECKING, dataclass_transform

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass

    @dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(Field,))
    class Frozen(ModelMetaclass):
        """Tells type checkers that options do not change, so that a `kind` of `str` may become a literal."""

else:
    Frozen = type(BaseModel)


class Options(BaseModel, metaclass=Frozen):
    """Base of every section of an experiment file.

    Unknown keys are errors; nothing is converted silently ("50" is not a number, 1.5 is not an integer);
    numbers are finite; every field has a default where one makes sense and a description, the docstring below
    it, which goes to the schema and the reference page (see `descriptions`).
    """

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        validate_default=True,
        allow_inf_nan=False,
    )
