"""A loop over UDP, through real sockets: rows, references, what is no reference, and every way to end."""

import json
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke

HOME = [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]
ASKED = [0.05, -0.04, 2.2, 0.02, -0.03, 0.1]
MALFORMED = [
    *(b"x", b"[]", b"{}", b"null", b"\xff\xfe", b"[" * 500, b'{"pose": 1}', b'{"pose": [1, 2, 3, 4, 5]}'),
    *(b'{"pose": [NaN, 0, 2, 0, 0, 0]}', b'{"pose": [Infinity, 0, 2, 0, 0, 0]}', b'{"pose": [true, 0, 2, 0, 0, 0]}'),
    *(b'{"pose": ["0", 0, 2, 0, 0, 0]}', b'{"pose": [1%s, 0, 2, 0, 0, 0]}' % (b"0" * 400), struct.pack("<6d", *HOME)),
    b'{"pose": [0, 0, 2, 0, 0, 0]}' + b" " * 600,
]
# Too long, turned once round with the lengths of home, far away; too short, beyond a quarter turn, three legs too long.
OUT_OF_REACH: list[list[float]] = [[0, 0, 9, 0, 0, 0], [0, 0, 2, 0, 0, 2 * np.pi], [1e5] * 6]
OUT_OF_REACH += [[0, 0, 0.7, 0, 0, 0], [0, 0, 1.15, 0, 0, 1.6], [0, 0, 2, 0, 0, 1.5]]


class Client:
    """A socket that talks to a server."""

    def __init__(self, server: subprocess.Popen[str], port: int) -> None:
        self.server, self.at = server, ("127.0.0.1", port)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(20)

    def say(self, *datagrams: bytes) -> None:
        for datagram in datagrams:
            self.socket.sendto(datagram, self.at)

    def ask(self, pose: list[Any]) -> None:
        self.say(json.dumps({"pose": pose}).encode())

    def datagram(self) -> bytes:
        return self.socket.recv(4096)

    def rows(self, n: int) -> dict[str, np.ndarray]:
        """The next rows, in JSON."""
        rows = [json.loads(self.datagram()) for _ in range(n)]
        return {key: np.array([row[key] for row in rows]) for key in rows[0]}

    def end(self, name: signal.Signals | None) -> tuple[int, str, dict[str, int]]:
        """The exit code, the verdict and its counts, after a signal, or by itself."""
        if name is not None:
            self.server.send_signal(name)
        said, errors = self.server.communicate(timeout=30)
        assert errors == ""
        counts = re.findall(r"(\d+) (rows out|packets in|malformed|out of reach|losses)", said)
        return self.server.returncode, said, {what: int(number) for number, what in counts}


@contextmanager
def served(*options: str) -> Iterator[Client]:
    """A server of its own process, at a free port."""
    command = [sys.executable, "-m", "gough_stewart", "serve", "heave_step", "--udp", "0", *options]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as server:
        try:
            assert server.stdout is not None
            first = server.stdout.readline()
            listening = re.match(r"Listening on 127\.0\.0\.1:(\d+)", first)
            assert listening, server.stderr and server.stderr.read()
            client = Client(server, int(listening[1]))
            with closing(client.socket):
                yield client
        finally:
            server.kill()


def test_the_platform_follows_a_sender_by_the_limits_of_motion_and_stays_when_it_is_lost() -> None:
    """Expected: steps in time of one period, no faster than the clock; rates of the filter; lengths by geometry."""
    with served("--silence", "0.5") as client:
        client.say(b"")
        began, first = time.monotonic(), client.rows(1)
        others = [Client(client.server, client.at[1]) for _ in range(9)]
        for word, other in zip(
            [b"x", *[b""] * 8], others, strict=True
        ):  # not understood; the last is the ninth listener
            other.say(word)
        client.ask(HOME)
        client.ask(ASKED)  # the last one holds
        client.say(*MALFORMED)
        for beyond in OUT_OF_REACH:
            client.ask(beyond)
        rows = client.rows(200)
        passed = time.monotonic() - began
        served_too = [bool(select.select([other.socket], [], [], 0)[0]) for other in others]
        for other in others:
            other.socket.close()
        time.sleep(0.05)  # a signal could come between a row and its count
        code, said, counts = client.end(signal.SIGTERM)
    assert "late rows" in said
    assert served_too == [False, *[True] * 7, False]
    assert rows["time"] / 0.01 == pytest.approx(np.rint(rows["time"] / 0.01))
    time_of_rows = rows["time"]
    assert np.diff(time_of_rows) == pytest.approx(0.01)
    assert time_of_rows[-1] - first["time"][0] == pytest.approx(passed, abs=0.5)
    rates = np.abs(np.diff(rows["reference"], axis=0)) / 0.01
    # limits of 0.3 m/s and 2 m/s2 on what is wanted, which a filter of third order exceeds a little
    assert 0.29 < rates[:, 2].max() < 0.303
    assert 1.0 < np.abs(np.diff(rates[:, 2])).max() / 0.01 < 2.02
    assert rows["reference"][-1] == pytest.approx(ASKED, abs=1e-4)
    assert rows["pose"][-1] == pytest.approx(ASKED, abs=2e-3)
    pose = rows["pose"]
    lengths = gs.leg_geometry(gs.load_preset("motion_base"), pose[:, :3], pose[:, 3:]).length
    assert rows["leg_length"] == pytest.approx(lengths, abs=1e-9)
    packets = 3 + len(others) + len(MALFORMED) + len(OUT_OF_REACH)
    assert (code, counts["packets in"], counts["malformed"]) == (0, packets, len(MALFORMED) + 1)
    assert (counts["out of reach"], counts["losses"]) == (len(OUT_OF_REACH), 1)
    assert counts["rows out"] >= 201


def test_a_binary_sender_that_asks_with_every_row_is_followed_by_the_filter_until_it_is_lost() -> None:
    """Expected: steps of 4 ms; the step response of 1/(s/w + 1)^3, w = 2 pi 1.5 Hz, which no limit touches."""
    start, change = np.array(HOME), np.array([2e-3, -1e-3, 3e-3, 1e-3, -2e-3, 1.5e-3])
    loop = [f"--set=loop.{key}" for key in ("duration=3", "sample_time=3 ms", "plant_step=1 ms")]
    loop.append("--set=reference.at=2.9")  # until then it rests
    rows = []
    with served("--binary", "--rate", "250", "--silence", "0.4", "--stop", *loop) as client:
        client.say(json.dumps({"pose": HOME}).encode())
        for _ in range(120):
            client.say(struct.pack("<6d", *(start + change)))
            rows.append(struct.unpack("<19d", client.datagram()))
        code, said, counts = client.end(None)
    values = np.array(rows)
    assert np.diff(values[:, 0]) == pytest.approx(0.004)
    lengths = gs.leg_geometry(gs.load_preset("motion_base"), values[:, 1:4], values[:, 4:7]).length
    assert values[:, 7:13] == pytest.approx(lengths, abs=1e-9)
    # it begins with a sample about the first row
    x = 2 * np.pi * 1.5 * (values[:, :1] - values[0, 0])
    response = 1 - np.exp(-x) * (1 + x + x * x / 2)
    followed = (values[:, 13:] - start) / change
    assert followed == pytest.approx(np.repeat(response, 6, axis=1), abs=0.02)
    # max |y''| = 0.23 w^2 of the response, times 4 ms squared: rows are not those of other times
    assert np.abs(np.diff(followed, 2, axis=0)).max() < 2 * 3.3e-4
    assert (code, counts["packets in"], counts["malformed"], counts["losses"]) == (0, 121, 1, 1), said


def test_a_loop_that_ends_says_why() -> None:
    """Expected: a step of 50 mm is further from its reference than 1 mm."""
    limits = ("--stop", "--set", "reference.at=0.02", "--set", "limits.position_error=1 mm")
    done = invoke("serve", "heave_step", "--udp", "0", "--duration", "20", *limits)
    assert done.exit_code == 3
    assert "too far from its reference" in done.output
    assert "0.3 s simulated" in invoke("serve", "heave_step", "--udp", "0", "--rate", "10", "--duration", "0.3").output
