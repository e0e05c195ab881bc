"""`many_servers.py URL FIRST COUNT`: servers of Minisim, a thread each; from a line on, until killed."""

import sys
import threading

from swarmwright import _engine


def main() -> None:
    url, first, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])

    def serve(index: int) -> None:
        _engine.serve("minisim", url, id=first + index)

    threads = [threading.Thread(target=serve, args=(index,), daemon=True) for index in range(count)]
    sys.stdin.readline()  # all at once, when told to
    for thread in threads:
        thread.start()
    threads[0].join()


if __name__ == "__main__":
    main()
