"""An ensemble from closed forms: what each figure of merit depends on is known, and how much."""

from typing import Any

import numpy as np
import polars

from gough_stewart import Ensemble
from tests.support.arrays import FloatArray

# y = a · x of independent unit normal x: standardised coefficients are a / |a|, Sobol' indices their squares.
SLOPES = np.array([3.0, -2.0, 1.0, 0.0])
INPUTS = ("platform_mass", "controller.bandwidth", "base_points[1,2]", "leg_coulomb_friction")
PEAK = "tracking.position.norm_peak"
LEVELS = {"lowest": 0.0, "q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95, "highest": 1.0}
_SIGNALS = (*(f"position[{k}]" for k in (1, 2, 3)), "error.position.norm", "actuator_force[1]", "actuator_force[2]")


def normal(n: int, seed: int = 2) -> FloatArray:
    """Inputs (n, 4) of zero mean and unit deviation."""
    return np.random.default_rng(seed).normal(size=(n, 4))


def with_columns(ensemble: Ensemble, columns: dict[str, Any] | None = None, **metadata: Any) -> Ensemble:
    """The same with other columns and other metadata."""
    series = [polars.Series(name, values) for name, values in (columns or {}).items()]
    members = ensemble.members.with_columns(series)
    return Ensemble(members, ensemble.bands, {**ensemble.metadata, **metadata}, ensemble.samples)


def judged_by(metric: str) -> dict[str, Any]:
    """Metadata of an ensemble whose verdict is on this metric."""
    return {"experiment": {"ensemble": {"worst_by": metric}}}


def ensemble_of(
    x: FloatArray, outcome: list[str] | None = None, cause: list[str | None] | None = None, **metadata: Any
) -> Ensemble:
    """Of inputs (N, 4) of zero mean and unit deviation: the position's error is 10 mm + 1 mm · y."""
    n = len(x)
    y = x @ SLOPES
    members: dict[str, Any] = {"member": np.arange(n)}
    scales = ((120.0, 10.0), (3.0, 0.4), (0.4, 2e-4), (2.0, 0.5))
    members |= {
        f"varied.{name}": mean + scale * x[:, k]
        for k, (name, (mean, scale)) in enumerate(zip(INPUTS, scales, strict=True))
    }
    members |= {
        "outcome": outcome or ["completed"] * n,
        "ended": np.where(np.array(outcome or ["completed"] * n) == "completed", 2.0, 0.5),
        "cause": cause or [None] * n,
        "rows": np.full(n, 2001.0),
        "duration": np.full(n, 2.0),
        PEAK: 1e-2 + 1e-3 * y,
        "tracking.position.norm_rms": 4e-3 + 3e-4 * x[:, 0] ** 2,
        "tracking.orientation.norm_peak": 2e-3 + 1e-4 * x[:, 3],
        "step_response.z.overshoot_percent": np.maximum(8 + 3 * x[:, 1], 0),
        "step_response.z.settling_time": np.where(x[:, 1] > -1.5, 0.6 - 0.1 * x[:, 1], np.nan),
        "force.peak": 4000 + 300 * x[:, 0],
        "power.peak": 900 + 80 * x[:, 0] * x[:, 1],
        "energy.absolute_total": 300 + 20 * x[:, 0],
        "saturation.force_limited.any": np.clip(0.02 * x[:, 0], 0, 1),
        "stroke.margin": 0.02 - 3e-3 * x[:, 2],
        "margins.disk": 0.7 - 0.08 * x[:, 1],
    }
    table = polars.DataFrame(members, nan_to_null=True, schema_overrides={"cause": polars.String})
    time = np.linspace(0, 2, 60)
    wave = np.exp(-2 * time[:, None]) * np.cos(8 * time[:, None] * (1 + 0.05 * x[:, 1]))
    noise = 0.002 * np.random.default_rng(3).normal(size=(3, n))
    signals = [*(0.05 * (1 - wave) * k + e for k, e in zip((0.1, 0.2, 1), noise, strict=True)), np.abs(0.05 * wave)]
    values = dict(zip(_SIGNALS, [*signals, 4000 + 900 * wave, 3800 - 500 * wave], strict=True))
    bands = polars.concat([
        polars.DataFrame({"time": time, "signal": name, "running": n}).with_columns(
            **{level: polars.Series(np.quantile(rows, share, axis=1)) for level, share in LEVELS.items()}
        )
        for name, rows in values.items()
    ])  # fmt: skip
    samples = polars.DataFrame({"member": np.repeat(np.arange(n), 60), "time": np.tile(time, n)}).with_columns(
        **{name: polars.Series(rows.T.ravel(), dtype=polars.Float32) for name, rows in values.items()}
    )
    known = {"title": "closed forms", "seed": 7, "sampling": "random", "groups": [[name] for name in INPUTS]}
    return Ensemble(table, bands, {**known, **metadata}, samples)
