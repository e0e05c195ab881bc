"""`python -m benchmarks FILE.json`: measure suite after suite, print their tables, write the figures."""

import argparse
import dataclasses
import os
import sys
import traceback
from pathlib import Path

from benchmarks.measurement import Samples, show, write
from benchmarks.suite import QUICK, SUITES, NotBuiltError, Scale, run


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
    count = "once" if scale.repetitions == 1 else f"median of {scale.repetitions}"
    samples: list[Samples] = []
    skipped, failed = [], []
    for name, measure in run(scale, arguments.only):
        load = os.getloadavg()[0]
        print(f"{name}: measuring", file=sys.stderr, flush=True)
        try:
            measured = measure()
        except NotBuiltError as error:
            skipped.append(f"{name}: {error}")
            continue
        except (Exception, SystemExit) as error:  # noqa: BLE001 - the figures of other suites are kept
            if isinstance(error, SystemExit):
                print(f"{name}: {error}", file=sys.stderr)
            else:
                traceback.print_exc()
            failed.append(name)
            continue
        show(measured, f"{name}: {len(os.sched_getaffinity(0))} cores, {count}, load before {load:.1f}")
        samples += measured
        write(arguments.file, samples)
    if samples:
        print(f"\nThe figures are in {arguments.file}")
    for line in skipped:
        print(f"not measured: {line}")
    if failed or not samples:
        raise SystemExit(f"failed: {', '.join(failed)}" if failed else "nothing was measured")


if __name__ == "__main__":
    main()
