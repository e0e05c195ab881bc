"""Detection of audits that cannot take place because there is only one server."""

import time

from swarmwright.servers.rows import Journal, WarningEntry

EXPECTED_AUDITS = 10
"""Expected audits before the warning; the probability that none was drawn by chance is then e^-10."""


class MissingAudits:
    """Warns once if a single server does all evaluations, so that no audit takes place.

    share: fraction of evaluations to audit, 0 to 1.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._evaluations = 0
        self._servers: set[int] = set()

    def note(self, journal: Journal) -> str | None:
        """Count evaluations; add a warning when it is due, and return its text."""
        if not self._share:
            return None
        for attempt in journal.attempts:
            self._servers.add(attempt.server)
            self._evaluations += attempt.candidates * attempt.episodes
        is_reported = any(warning.unaudited for warning in journal.warnings)  # the pool reports more
        if is_reported or len(self._servers) > 1:
            self._share = 0.0
        if self._evaluations * self._share < EXPECTED_AUDITS:
            return None
        share, self._share = self._share, 0.0
        (server,) = self._servers
        text = (
            f"no audits take place during the run despite faults.audit: {share:g}, because only server "
            f"{server} "
            "is used; it is audited at the end. Start a second server that declares its determinism, and "
            "check with `swarmwright servers` that it is found"
        )
        journal.warnings.append(WarningEntry(text, time=time.time()))
        return text
