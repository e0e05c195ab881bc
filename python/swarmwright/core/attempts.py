"""How attempts at evaluations end."""

OVERTAKEN = "server % was faster"
"""What the pool says of the other attempts of work that is done, engine/pool/src/scheduler/settle.rs; a
pattern of SQL's LIKE."""


def is_overtaken(error: str) -> bool:
    """Whether an attempt ended because another server, which had the same work, was faster."""
    before, after = OVERTAKEN.split("%")
    return error.startswith(before) and error.endswith(after)
