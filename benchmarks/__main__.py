"""`python -m benchmarks FILE.json`: measure, print a table, write the figures."""

import argparse
import dataclasses
import os
from pathlib import Path

from benchmarks.measurement import show, write
from benchmarks.suite import QUICK, SUITES, Scale, run


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("file", type=Path, metavar="FILE.json", help="where the figures go")
    parser.add_argument(
        "--repetitions", type=int, default=Scale.repetitions, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--quick", action="store_true", help="does everything work? The figures mean nothing")
    parser.add_argument(
        "--only", default="", metavar="PATTERN", help=f"suites whose name matches: {', '.join(SUITES)}"
    )
    arguments = parser.parse_args()
    if arguments.repetitions < 1:
        parser.error("--repetitions must be at least 1")
    scale = QUICK if arguments.quick else dataclasses.replace(Scale(), repetitions=arguments.repetitions)
    load = os.getloadavg()[0]
    samples = list(run(scale, arguments.only))
    count = "once" if scale.repetitions == 1 else f"median of {scale.repetitions}"
    show(samples, f"Measured on {os.cpu_count()} cores, {count}, load before {load:.1f}")
    write(arguments.file, samples)
    print(f"\nThe figures are in {arguments.file}")


if __name__ == "__main__":
    main()
