"""By what a run folder is known, where it is named in the place of an experiment."""

STORE = "run.sqlite"
"""Name of the store in a run folder."""
