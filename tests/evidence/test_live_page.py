"""A live page for minutes, in Chromium: what takes too long for every day."""

import time
from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.browser import CHROMIUM, until, watched

pytestmark = pytest.mark.evidence

# A loop at 1 kHz with everything that a loop can have.
EVERYTHING = {
    **{"sensors.noise": {"leg_length": "3 um"}, "sensors.seed": 4},
    **{"actuators.lag": "3 ms", "actuators.force_limit": 20000, "actuators.rate_limit": 4e6},
}
STATE = "GoughStewart.engine.ask('state', 'state')"


def test_ten_minutes_in_real_time_lose_nothing_and_need_no_memory(
    request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """Expected: after the first minute, whose rows fill what is kept, the memory of script and machine stays."""
    (file,) = gs.export("heave_step", EVERYTHING, forms="page", out=tmp_path)
    assert CHROMIUM is not None, "expected Chromium; install the package chromium"
    heave = watched(request.getfixturevalue("browser"), 1440, 900)
    page, session = heave.page, heave.page.context.new_cdp_session(heave.page)
    page.goto(file.as_uri())
    until(page, "GoughStewart.live && GoughStewart.live.last !== null")
    session.send("HeapProfiler.enable")

    def memory() -> tuple[float, int]:
        session.send("HeapProfiler.collectGarbage")
        used = session.send("Runtime.getHeapUsage")["usedSize"]
        return float(used), int(page.evaluate(f"{STATE}.then((state) => state.memory)"))

    def now() -> tuple[float, float, float]:
        rows, pictures = page.evaluate("[GoughStewart.live.last[0], GoughStewart.live.frames]")
        return float(rows), float(pictures), float(page.evaluate(f"{STATE}.then((state) => state.lost)"))

    page.wait_for_timeout(60_000)
    before, first, start = memory(), now(), time.monotonic()
    page.wait_for_timeout(540_000)
    last, wall, after = now(), time.monotonic() - start, memory()
    passed, shown, missed = np.subtract(last, first)
    print(f"\n{passed:.2f} s of {wall:.2f} s, lost {missed:.3f} s, {shown / wall:.1f} pictures a second")
    for name, (a, b) in {"script": (before[0], after[0]), "machine": (before[1], after[1])}.items():
        print(f"{name}: {a / 1e6:.2f} to {b / 1e6:.2f} MB")
    assert after[1] == before[1]
    assert after[0] < 1.05 * before[0]
    assert passed == pytest.approx(wall - missed, abs=2)
    assert heave.errors == []
    page.close()
