"""Steps instances of an FMU, as a stepwise command: `python -m swarmwright.fmu ATTACHMENT.json`."""

import sys

from swarmwright.fmu.program import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
