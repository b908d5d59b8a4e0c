"""Slow evidence: many more random platforms, a soak of the stepping model, shipped experiments on model and unit."""

import resource

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart import SteppingModel, load_preset
from tests.support.fmu_plants import Fmu
from tests.support.formulations import largest_difference
from tests.support.random_platforms import random_platform

pytestmark = pytest.mark.evidence


def test_formulations_agree_on_20_000_random_platforms() -> None:
    """Expected: as `test_formulations`, on other seeds; the largest difference is printed."""
    rng = np.random.default_rng(1)
    worst = max(largest_difference(random_platform(rng), rng) for _ in range(20_000))
    print(f"\nlargest difference {worst:.2e}")
    assert worst <= 1e-10


def test_soak_of_the_stepping_model_leaks_nothing_and_stays_deterministic() -> None:
    """Expected: memory of the process does not grow over 30,000 steps and 300 resets; every round is the same."""
    model = SteppingModel(load_preset("liu2000"))
    grown, end = [], set()
    for round_ in range(300):
        model.reset()
        model.set("actuator_force", [30.0] * 6)
        for k in range(100):
            snapshot = model.save_state()
            model.do_step(k * 1e-3, 1e-3)
            if k % 10 == 0:
                model.restore_state(snapshot)
                model.do_step(k * 1e-3, 1e-3)
        end.add(model.state.tobytes())
        if round_ % 100 == 99:
            grown.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    print(f"\npeak memory after 100, 200, 300 rounds: {grown} KiB")
    assert len(end) == 1
    assert grown[-1] - grown[0] <= 1024


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_shipped_experiments_end_alike_on_model_and_unit(version: str, fmus: dict[str, Fmu]) -> None:
    """Expected: whole, with the same steps, so within 1e-11 m, rad; the largest difference is printed.

    All but `too_slow`, which diverges: there any difference grows to the size of the motion. Encoders do not quantise:
    rounding would decide which of two steps a reading has.
    """
    worst = 0.0
    for name in sorted(set(gs.experiment_names()) - {"too_slow"}):
        quantises = "quantisation" in gs.load_experiment(name).model_dump(exclude_unset=True).get("sensors", {})
        settings = {"sensors.quantisation.leg_length": 0} if quantises else {}
        model, unit = (
            gs.run(name, settings, plant=kind, fmu=fmu)  # type: ignore[arg-type]
            for kind, fmu in (("model", None), (f"fmu{version[0]}", fmus[version].path))
        )
        assert len(model.table) == len(unit.table)
        worst = max(worst, *(float(np.abs(model[each] - unit[each]).max()) for each in ("position", "orientation")))
    print(f"FMI {version}: {worst:.2g} m, rad")
    assert worst < 1e-11
