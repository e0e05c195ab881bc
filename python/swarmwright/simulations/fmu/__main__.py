"""Steps instances of an FMU, as a stepwise command: `python -m swarmwright.simulations.fmu FILE.json`."""

import sys

from swarmwright.simulations.fmu.program import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
