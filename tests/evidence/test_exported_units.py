"""The shipped experiments with a linear controller: the exported unit beside the controller in Python, whole runs."""

from pathlib import Path

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import LinearController
from gough_stewart.harness.control.unit_controller import UnitController
from gough_stewart.harness.experiment.preparation import prepare
from gough_stewart.harness.plants import signals
from gough_stewart.model import interface

pytestmark = pytest.mark.evidence
# Bandwidths with which loops that have no delay are stable with the unit's.
STABLE: dict[str, dict[str, object]] = {
    "circle": {"controller.bandwidth": 3},
    "circle_computed_torque": {"controller.bandwidth": 3},
    "payload_change": {"controller.bandwidth": 2},
}
LINEAR = [n for n in gs.experiment_names() if isinstance(prepare(gs.load_experiment(n)).controller, LinearController)]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("name", LINEAR)
def test_the_unit_gives_the_forces_of_the_harness_at_every_sample(name: str, version: str, tmp_path: Path) -> None:
    """Expected: the commands of the run in Python, cut to the force limit; the unit gets the same measurements."""
    chosen = gs.load_experiment(name)
    # what is injected is not the controller's
    settings = ({} if chosen.loop.delay else {"loop.delay": 1}) | STABLE.get(name, {}) | {"injection": None}
    record, loop = gs.run(name, settings), prepare(gs.load_experiment(name, settings)).loop
    # one of them is there to be unstable
    (path,) = gs.export(name, settings, fmi=version, out=tmp_path, allow_unstable=name == "too_slow")
    T, limit = loop.timing.sample_time, loop.actuators.force_limit or np.inf
    rows = [row for row in loop.timing.rows_of_samples if row < len(record["time"]) - 1]
    expected = np.clip(record["controller.force"][rows], -limit, limit)
    everything = interface.unpack(signals.VARIABLES, np.arange(signals.SIZE))
    inputs = np.zeros((len(rows), signals.SIZE + 30))
    for signal, places in everything.items():
        if record.columns_of(f"measured.{signal}"):
            inputs[:, places] = record[f"measured.{signal}"][rows]
    worst = 0.0
    with UnitController(path, is_foreign=False).open(T) as law:
        for k, (force, row) in enumerate(zip(expected, inputs, strict=True)):
            found = law.force(k, k * T, row[signals.SIZE :], row[: signals.SIZE], np.zeros(6))
            worst = max(worst, float(np.abs(found - force).max() / max(np.abs(force).max(), 1e-3)))
    print(f"{name}, FMI {version}: {worst:.1e} of the largest force, {len(rows)} samples")
    assert worst <= 1e-9
