"""Migration from FREVO: session files are converted to experiments, result files are evaluated again.

FREVO (https://github.com/smartgrids-aau/Frevo, version 1.5) keeps experiments in session files (.zse) and
evolved populations in result files (.zre), both XML.
"""

from swarmwright.experiment.importing import Imported
from swarmwright.interop.frevo._document import is_session
from swarmwright.interop.frevo._mapping import load
from swarmwright.interop.frevo._score import Score, Scores, score

__all__ = ["Imported", "Score", "Scores", "is_session", "load", "score"]
