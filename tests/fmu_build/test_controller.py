"""A controller's unit of a loop with a long delay; tests/harness/export has its law, samples and files."""

import zipfile
from pathlib import Path

import numpy as np

import gough_stewart as gs
from tests.support.fmu_plants import DISCARD, Fmu, plant
from tests.support.uneven import UNEVEN
from tests.support.uneven_loops import POSE, experiment_of

T = 4e-3
LENGTHS = gs.leg_geometry(UNEVEN, POSE[:3], POSE[3:]).length


def test_forces_wait_for_the_delay_of_the_loop_however_long(tmp_path: Path) -> None:
    """Expected: start forces for 14 samples, then those of the unit with a delay of 1; a delay of 16 is refused."""
    loop = {"duration": 0.74, "sample_time": T, "delay": 15}
    experiment = experiment_of("pid", loop=loop, actuators={"force_limit": 300.0})
    (path,) = gs.export(experiment, forms="ssp", out=tmp_path, allow_unstable=True)
    with zipfile.ZipFile(path) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("controller.fmu"))
        unit = Fmu(Path(archive.extract(name, tmp_path)))
    found = []
    for delay in (1.0, 15.0):
        with plant(unit) as p:
            assert p.get("output_delay") == 15
            p.refuses("expected a whole number of samples from 1 to 15", DISCARD, p.set, "output_delay", 16.0)
            p.set("output_delay", delay)
            p.initialise(time=0.5)
            start = p.get_all(["start_force", "force_limited"])
            for k, lengths in enumerate(LENGTHS + 0.05 * np.random.default_rng(1).normal(size=(20, 6))):
                p.set("leg_length", lengths)
                p.do_step(0.5 + k * T, T)
                found.append(p.get_all(["actuator_force", "force_limited"]))
    prompt, late = np.array(found[:20]), np.array(found[20:])
    assert 0.2 < prompt[:, 6:].mean() < 0.8
    np.testing.assert_array_equal(late[14:], prompt[:6])
    np.testing.assert_array_equal(late[:14], np.tile(start, (14, 1)))
