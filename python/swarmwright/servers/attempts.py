"""How attempts at evaluations end."""

import re

OVERTAKEN = "server % was faster"
"""What the pool says of the other attempts of work that is done, engine/roles/pool/src/scheduler/settle.rs; a
pattern of SQL's LIKE."""
TURN = "it is the turn of "
"""What servers say of requests that they hand back, since another tool has waited for them,
engine/roles/wrapper/src/machine/turns.rs."""
NOT_FINISHED = "not finished: "
"""Before the reason, where a server ended at one evaluation of a batch: the attempt at the whole batch,
engine/roles/pool/src/scheduler/supervised.rs."""
SAME_END_S = 0.001
"""Attempts on one server that ended within so many seconds, for one reason, ended together."""
_SERVER_END = re.compile(r"a simulation server |server \d+\b")
"""How reasons begin that are the end or the silence of a server: it takes all its attempts with it."""


def is_overtaken(error: str) -> bool:
    """Whether an attempt ended because another server, which had the same work, was faster."""
    before, after = OVERTAKEN.split("%")
    return error.startswith(before) and error.endswith(after)


def is_server_end(reason: str) -> bool:
    """Whether a server failed, rather than an evaluation on it: all its attempts end for this reason."""
    return _SERVER_END.match(reason) is not None
