"""Descriptions of options are the docstrings below them."""

from pydantic import Field

from swarmwright.common.options import Options, add_descriptions


class Inner(Options):
    """A part."""

    depth: int = 1
    """How deep,
    in metres."""


class Base(Options):
    """What all have."""

    width: int = 1
    """How wide."""


class Outer(Base):
    """A whole."""

    inner: Inner | None = None
    """The part."""
    parts: list[Inner] = Field(default=[])
    named: int = Field(default=1, description="Given by name.")
    """Not this."""
    silent: int = 0


def test_docstrings_become_descriptions() -> None:
    assert Outer.model_fields["width"].description is None
    schema = add_descriptions(Outer).model_json_schema()
    found = {name: entry.get("description") for name, entry in schema["properties"].items()}
    assert found == {
        "width": "How wide.",
        "inner": "The part.",
        "parts": None,
        "named": "Given by name.",
        "silent": None,
    }
    assert schema["$defs"]["Inner"]["properties"]["depth"]["description"] == "How deep,\nin metres."
    assert add_descriptions(Outer).model_json_schema() == schema
    assert Outer(inner=Inner(depth=2)).inner == Inner(depth=2)


def test_models_without_source_have_none() -> None:
    made: dict[str, type[Options]] = {}
    exec(  # as in an interactive session
        "from swarmwright.common.options import Options\n"
        "class Made(Options):\n    size: int = 1\n    'How big.'",
        made,
    )
    assert add_descriptions(made["Made"]).model_fields["size"].description is None
