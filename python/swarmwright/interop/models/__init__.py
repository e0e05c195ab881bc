"""Models that engineers draw: files of modelling tools become experiments.

It reads the files of Modelio's CPSwarm modules (https://github.com/Modelio-R-D/CPSwarm), which the
optimization tool gets from the designer in CPSwarm's D6.1, section 4.
"""

from swarmwright.experiment.importing import Imported
from swarmwright.interop.models._experiment import load
from swarmwright.interop.models._files import files_of
from swarmwright.interop.models._write_back import write_back

__all__ = ["Imported", "files_of", "load", "write_back"]
