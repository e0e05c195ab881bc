"""Audits that an experiment asks for, and that cannot be made, as there is one server only."""

import time

from swarmwright.servers.rows import Journal, WarningEntry

EXPECTED = 10
"""Audits that would have been made by now if there were other servers: that none was drawn by chance has a
probability of e^-10, less than 1 in 20,000."""


class MissingAudits:
    """Notices, once, that one server has done everything, so that nothing was audited.

    share: of the evaluations that are to be audited, 0 to 1.
    """

    def __init__(self, share: float) -> None:
        self._share = share
        self._evaluations = 0
        self._servers: set[int] = set()

    def note(self, journal: Journal) -> str | None:
        """Note what was done, and add a warning when it is time for it; return its text."""
        if not self._share:
            return None
        for attempt in journal.attempts:
            self._servers.add(attempt.server)
            self._evaluations += attempt.candidates * attempt.episodes
        told = any(warning.unaudited for warning in journal.warnings)  # the pool knows more
        if told or len(self._servers) > 1:
            self._share = 0.0
        if self._evaluations * self._share < EXPECTED:
            return None
        share, self._share = self._share, 0.0
        (server,) = self._servers
        text = (
            f"nothing is audited during the run, although the experiment has faults.audit: {share:g}; only "
            f"server {server} is used, which is audited at the end. Audits during the run need two servers "
            "that declare their determinism: start another one, or look why it is not found (swarmwright "
            "servers)"
        )
        journal.warnings.append(WarningEntry(text, time=time.time()))
        return text
