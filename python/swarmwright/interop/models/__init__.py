"""Conversion of models drawn in modelling tools into experiments.

Supports the files of Modelio's CPSwarm modules (https://github.com/Modelio-R-D/CPSwarm), which the designer
passes to the optimization tool in CPSwarm's D6.1, section 4.
"""

from swarmwright.experiment.importing import Imported
from swarmwright.interop.models._experiment import load
from swarmwright.interop.models._files import list_files
from swarmwright.interop.models._write_back import write_back

__all__ = ["Imported", "list_files", "load", "write_back"]
