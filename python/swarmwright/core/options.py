"""Typed options: the one source of validation, JSON Schema and reference pages."""

from pydantic import BaseModel, ConfigDict


class Options(BaseModel):
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
