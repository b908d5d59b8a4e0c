"""How punctual `gough-stewart serve` is on a quiet machine: `make bench`.

A client in a process of its own keeps asking for poses and takes the rows, as a game does. A row is late by the
time from its own to when it has been sent.
"""

import json
import socket
import subprocess
import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.export.stream import PacketTally, Stream

RATES, DURATION = (50.0, 100.0, 250.0), 20.0
POSE = [0.0, 0.0, 2.05, 0.0, 0.0, 0.0]


def ask(port: int, duration: float) -> None:
    """Answer each row by a pose, until there are none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(duration)
        client.connect(("127.0.0.1", port))
        client.send(b"")
        while True:
            try:
                client.recv(4096)
                client.send(json.dumps({"pose": POSE}).encode())
            except OSError:  # it has ended
                return


def measured(rate: float, duration: float) -> PacketTally:
    """A stream of its duration."""
    stream = Stream(load_experiment("heave_step"), ("127.0.0.1", 0), rate)
    with subprocess.Popen([sys.executable, __file__, str(stream.port), str(duration)]):
        return stream.run(duration)


def main() -> int:
    """Measure, and print the table."""
    table = Table(
        "rows a second", "half are late by, ms", "1 %, ms", "0.1 %, ms", "more than half a period", "packets in"
    )
    for rate in RATES:
        tally = measured(rate, DURATION)
        late = [f"{1e3 * value:.2f}" for value in np.quantile(tally.lateness, (0.5, 0.99, 0.999))]
        table.add_row(f"{rate:g}", *late, str(tally.late), str(tally.packets))
    Console().print(table)
    return 0


if __name__ == "__main__":
    if len(sys.argv) > 1:
        ask(int(sys.argv[1]), float(sys.argv[2]))
    else:
        sys.exit(main())
