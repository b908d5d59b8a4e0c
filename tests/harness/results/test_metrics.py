"""Figures of merit against closed forms, and records that lack something."""

import json
import math
from typing import Any

import control
import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.report.terminal import tables_text
from gough_stewart.harness.results.metrics import flattened, metrics, metrics_json
from gough_stewart.harness.results.record import Record, columns
from gough_stewart.harness.results.tables import metrics_tables
from gough_stewart.model.vectors import FloatArray
from tests.support.metric_definitions import defined_metrics

SIZES = {"position": 3, "orientation": 3, "leg_length": 6, "leg_velocity": 6, "actuator_force": 6}
STEP = 1e-3


def record_of(
    n: int, values: dict[str, Any] | None = None, status: str = "completed", **platform: float | None
) -> Record:
    """A record of n rows: what is given, broadcast to (n, size), and zeros for the rest of the plant's columns."""
    table = {"time": STEP * np.arange(n)}
    for name, value in {**dict.fromkeys(SIZES, 0.0), **(values or {})}.items():
        size = SIZES.get(name.split(".")[-1], 6)
        full = np.broadcast_to(np.asarray(value), (n, size))
        table |= dict(zip(columns(name, size), full.T.copy(), strict=True))
    cause = None if status == "completed" else "too far from the reference"
    outcome = {"status": status, "time": STEP * (n - 1), "cause": cause}
    return Record(polars.DataFrame(table), {"title": "test", "outcome": outcome, "platform": dict(platform)})


def step_of(actual: FloatArray, wanted: FloatArray, axis: int = 2) -> Record:
    """A record in which one axis of the position does this, and all else rests."""
    n = len(actual)
    position, reference = np.zeros((n, 3)), np.zeros((n, 3))
    position[:, axis], reference[:, axis] = actual, wanted
    error = reference - position
    return record_of(
        n,
        {
            "position": position,
            "reference.position": reference,
            "reference.orientation": 0.0,
            "error.position": error,
            "error.orientation": 0.0,
        },
    )


def printed(found: dict[str, Any], width: int = 100) -> str:
    return str(found) if width == 100 else tables_text(metrics_tables(found), width)


def test_every_number_is_its_definition_leg_by_leg() -> None:
    """Expected: the sums of the docstring, written out over rows and legs of a record in which no two are alike."""
    rng = np.random.default_rng(11)
    n = 23
    sizes = {"error.position": 3, "error.orientation": 3, "error.leg_length": 6, "actuator_force": 6, "leg_velocity": 6}
    values: dict[str, Any] = {name: rng.normal(size=(n, size)) for name, size in sizes.items()}
    values["leg_length"] = rng.uniform(1, 2, (n, 6)) * np.arange(1, 7)
    flags = ("force_limited", "rate_limited", "stroke_exceeded")
    values |= {f"flag.{name}": rng.random((n, 6)) < np.arange(1, 7) / 30 for name in flags}
    found = metrics(record_of(n, values, leg_length_min=0.7, leg_length_max=14.0))
    F, L, v = (values[name] for name in ("actuator_force", "leg_length", "leg_velocity"))
    for name in ("position", "orientation", "leg_length"):
        e, part = values[f"error.{name}"], found["tracking"][name]
        for k in range(e.shape[1]):
            assert part["rms"][k] == pytest.approx(math.sqrt(sum(e[i, k] ** 2 for i in range(n)) / n))
            assert part["peak"][k] == max(abs(e[i, k]) for i in range(n))
        if name != "leg_length":
            squares = [sum(e[i, k] ** 2 for k in range(3)) for i in range(n)]
            assert part["norm_rms"] == pytest.approx(math.sqrt(sum(squares) / n))
            assert part["norm_peak"] == pytest.approx(math.sqrt(max(squares)))
    for k in range(6):
        work = [F[i, k] * (L[i + 1, k] - L[i, k]) for i in range(n - 1)]
        ends = [F[i, k] * v[i, k] for i in range(n)] + [F[i, k] * v[i + 1, k] for i in range(n - 1)]
        assert found["force"]["peak"][k] == max(abs(F[i, k]) for i in range(n))
        assert found["force"]["rms"][k] == pytest.approx(math.sqrt(sum(F[i, k] ** 2 for i in range(n - 1)) / (n - 1)))
        assert found["power"]["peak"][k] == pytest.approx(max(map(abs, ends)))
        assert found["power"]["mean"][k] == pytest.approx(sum(work) / (STEP * (n - 1)))
        assert found["energy"]["net"][k] == pytest.approx(sum(work))
        assert found["energy"]["absolute"][k] == pytest.approx(sum(map(abs, work)))
        assert found["stroke"]["shortest"][k] == min(L[i, k] for i in range(n))
        assert found["stroke"]["longest"][k] == max(L[i, k] for i in range(n))
    assert found["stroke"]["margin"] == pytest.approx(min(L.min() - 0.7, 14.0 - L.max()))
    counted = [(found["saturation"][name], values[f"flag.{name}"][:-1]) for name in flags[:2]]
    for part, flag in [*counted, (found["stroke"]["exceeded"], values["flag.stroke_exceeded"])]:
        assert part["legs"] == pytest.approx([sum(row[k] for row in flag) / len(flag) for k in range(6)])
        assert part["any"] == pytest.approx(sum(any(row) for row in flag) / len(flag))
        assert 0 < part["any"] < 1
    assert (found["rows"], found["duration"]) == (n, pytest.approx(STEP * (n - 1)))


# --- tracking ------------------------------------------------------------------------------------------------------


def test_rms_of_a_sine_is_its_amplitude_over_root_two() -> None:
    """Expected: the mean of sin² over whole periods, exact for equally spaced samples."""
    phase = 2 * np.pi * 3 * np.arange(1200) / 1200
    amplitude = np.array([0.1, 0.2, 0.0])
    tracking = metrics(record_of(1200, {"error.position": amplitude * np.sin(phase)[:, None]}))["tracking"]
    assert np.allclose(tracking["position"]["rms"], amplitude / math.sqrt(2), rtol=1e-12)
    assert np.allclose(tracking["position"]["peak"], amplitude, rtol=1e-12)
    assert tracking["position"]["norm_peak"] == pytest.approx(math.hypot(0.1, 0.2), rel=1e-12)
    assert tracking["position"]["norm_rms"] == pytest.approx(math.hypot(0.1, 0.2) / math.sqrt(2), rel=1e-12)
    assert set(tracking) == {"position"}


# --- step response -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.2, -0.05])
@pytest.mark.parametrize("damping", [0.3, 0.6])
def test_step_of_a_second_order_system_has_its_known_numbers(damping: float, size: float) -> None:
    """Expected: overshoot exp(−πζ/√(1−ζ²)); the last time outside 2 % from the closed form on a finer grid."""
    omega, start = 30.0, 250
    damped = omega * math.sqrt(1 - damping**2)

    def response(t: FloatArray) -> FloatArray:
        swing = np.cos(damped * t) + damping * omega / damped * np.sin(damped * t)
        answer: FloatArray = 1 - np.exp(-damping * omega * t) * swing
        return answer

    t = STEP * np.arange(2000)
    wanted = 1.5 + np.where(np.arange(2000) >= start, size, 0.0)
    actual = 1.5 + size * np.where(t > t[start], response(np.maximum(t - t[start], 0)), 0)
    (found,) = metrics(step_of(actual, wanted))["step_response"]
    fine = np.arange(0, 1.7, 1e-6)
    settled = fine[np.abs(response(fine) - 1) >= 0.02][-1]
    rise = fine[(response(fine) >= 0.9).argmax()] - fine[(response(fine) >= 0.1).argmax()]
    assert found["axis"] == "z"
    assert (found["from"], found["to"]) == (1.5, pytest.approx(1.5 + size))
    assert found["at"] == pytest.approx(t[start])
    overshoot = 100 * math.exp(-math.pi * damping / math.sqrt(1 - damping**2))
    assert found["overshoot_percent"] == pytest.approx(overshoot, abs=0.1)
    assert found["settling_time"] == pytest.approx(settled, abs=1.001 * STEP)
    assert found["rise_time"] == pytest.approx(rise, abs=1.001 * STEP)
    assert found["final_error"] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_step_numbers_are_python_controls(seed: int) -> None:
    """Expected: `control.step_info` from the jump on; responses that ring, with noise, cross a level more than once."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(1000)
    rings = 1 - np.exp(-(6 + 3 * seed) * t) * np.cos(20 * t) + 0.003 * rng.normal(size=1000)
    wanted = np.r_[0.0, np.ones(999)]
    (found,) = metrics(step_of(np.r_[0.0, rings[1:]], wanted))["step_response"]
    # the jump is in the second row
    info = control.step_info(rings[1:], T=t[:-1], yfinal=1.0)
    assert found["overshoot_percent"] == pytest.approx(info["Overshoot"])
    assert found["rise_time"] == pytest.approx(info["RiseTime"])
    assert found["settling_time"] == pytest.approx(info["SettlingTime"])


def test_response_that_is_outside_the_band_at_the_end_has_not_settled() -> None:
    wanted = np.r_[0.0, np.ones(999)]
    (found,) = metrics(step_of(np.r_[0.0, 1 + 0.1 * np.cos(np.arange(999))], wanted))["step_response"]
    assert found["settling_time"] is None
    assert found["rise_time"] is not None


def test_response_that_does_not_rise_has_no_times_and_no_overshoot() -> None:
    wanted = np.r_[0.0, np.ones(99)]
    (found,) = metrics(step_of(0.5 * wanted, wanted))["step_response"]
    assert found["rise_time"] is found["settling_time"] is None
    assert found["overshoot_percent"] == 0
    assert found["final_error"] == 0.5


def test_perfect_response_settles_where_the_reference_does() -> None:
    wanted = np.r_[np.zeros(10), np.ones(90)]
    (found,) = metrics(step_of(wanted, wanted))["step_response"]
    assert found["at"] == pytest.approx(10 * STEP)
    assert found["settling_time"] == found["overshoot_percent"] == found["rise_time"] == 0


def test_a_jump_of_a_reference_is_at_its_own_time() -> None:
    """Expected: the time that the experiment names."""
    record = run("heave_step", {"reference.at": 0.02, "loop.duration": 0.05})
    (found,) = metrics(record)["step_response"]
    assert found["at"] == 0.02


def test_a_reference_that_goes_over_several_rows_is_at_the_last_one_before() -> None:
    wanted = np.r_[np.zeros(10), 0.3, 0.7, np.ones(90)]
    (found,) = metrics(step_of(wanted, wanted))["step_response"]
    assert found["at"] == pytest.approx(9 * STEP)


@pytest.mark.parametrize(
    "wanted",
    [np.zeros(100), np.linspace(0, 1, 100), np.sin(np.arange(100)), np.r_[np.zeros(95), np.ones(5)], np.ones(1)],
    ids=["constant", "ramp", "sine", "rest too short", "single row"],
)
def test_what_is_no_step_has_no_step_response(wanted: FloatArray) -> None:
    assert metrics(step_of(wanted, wanted))["step_response"] == []


def test_each_axis_has_a_step_of_its_own_or_none() -> None:
    """Expected: by definition; steps up, down and late, a ramp to the end, one too late to be one, and rest."""
    k = np.arange(120)
    late = [np.where(k < at, 0.0, 1.0) for at in (70, 115)]
    each = [np.where(k < 9, 0.0, 0.4), k / 119, np.where(k < 40, 0.2, -0.5), *late, np.full(120, 0.3)]
    wanted = np.stack(each, axis=1)
    rates = np.array([0.3, 0.2, 0.15, 0.1, 0.4, 0.2])
    actual = np.zeros((120, 6))
    for j in range(1, 120):
        actual[j] = actual[j - 1] + rates * (wanted[j - 1] - actual[j - 1])
    position, orientation = ("position", actual[:, :3], wanted[:, :3]), ("orientation", actual[:, 3:], wanted[:, 3:])
    values: dict[str, Any] = {}
    for name, of, meant in (position, orientation):
        values |= {name: of, f"reference.{name}": meant, f"error.{name}": meant - of}
    values |= {f"reference.{name}": 0.0 for name in ("leg_length", "leg_velocity")} | {"error.leg_length": 0.0}
    record = record_of(120, values)
    flags = {
        f"flag.{name}[{leg}]": False
        for name in ("force_limited", "rate_limited", "stroke_exceeded")
        for leg in range(1, 7)
    }
    expected = defined_metrics(record.table.with_columns(**{n: polars.lit(v) for n, v in flags.items()}), {})
    found = metrics(record)["step_response"]
    assert [step["axis"] for step in found] == ["x", "z", "roll"]
    for step, meant in zip(found, expected["step_response"], strict=True):
        assert step == {key: pytest.approx(value) for key, value in meant.items()}


def test_step_counts_from_the_last_departure() -> None:
    """Expected: there and back again is not the step; what follows is."""
    wanted = np.r_[np.zeros(10), np.ones(10), np.zeros(10), np.ones(70)]
    (found,) = metrics(step_of(wanted, wanted))["step_response"]
    assert found["at"] == pytest.approx(30 * STEP)


# --- forces, power, energy -----------------------------------------------------------------------------------------


def test_constant_force_does_force_times_displacement() -> None:
    """Expected: W = F·ΔL, P = W/T; out and back is no net work, but twice the absolute."""
    force = np.array([1.0, -2, 3, -4, 5, 0])
    there = np.linspace(0, 0.3, 501)
    found = metrics(record_of(501, {"actuator_force": force, "leg_length": 2 + there[:, None], "leg_velocity": 0.6}))
    assert np.allclose(found["energy"]["net"], 0.3 * force, rtol=1e-12)
    assert found["energy"]["net_total"] == pytest.approx(0.3 * 3)
    assert found["energy"]["absolute_total"] == pytest.approx(0.3 * 15)
    assert np.allclose(found["power"]["mean"], 0.6 * force, rtol=1e-12)
    assert np.allclose(found["power"]["peak"], 0.6 * np.abs(force), rtol=1e-12)
    assert np.allclose(found["force"]["peak"], np.abs(force), rtol=1e-12)
    assert np.allclose(found["force"]["rms"], np.abs(force), rtol=1e-12)
    back = np.r_[there, there[-2::-1]]
    found = metrics(record_of(len(back), {"actuator_force": force, "leg_length": 2 + back[:, None]}))
    assert np.allclose(found["energy"]["net"], 0, atol=1e-14)
    assert found["energy"]["absolute_total"] == pytest.approx(0.6 * 15)


def test_a_force_that_is_on_by_turns_has_the_rms_of_its_squares() -> None:
    """Expected: c and −3 c in equal shares: √5 c, where a mean of amounts is 2 c; the last row does not last."""
    amounts = np.array([1.0, 2, 3, 4, 5, 6])
    force = np.r_[np.tile([1.0, -3.0], 50), 100.0][:, None] * amounts
    found = metrics(record_of(101, {"actuator_force": force}))["force"]
    assert np.allclose(found["rms"], np.sqrt(5) * amounts, rtol=1e-12)
    assert np.allclose(found["peak"], 100 * amounts, rtol=1e-12)


def test_peak_power_looks_at_both_ends_of_a_row() -> None:
    """Expected: 10 N act from row 0 to row 1, where the leg has 2 m/s; after that nothing acts."""
    force, velocity = np.zeros((4, 6)), np.zeros((4, 6))
    force[0], velocity[1] = 10, 2
    assert metrics(record_of(4, {"actuator_force": force, "leg_velocity": velocity}))["power"]["peak"] == [20] * 6


@given(st.integers(2, 40), st.integers(0, 2**31), st.floats(1e-3, 1e3))
def test_work_adds_up_and_scales_and_no_rms_is_above_its_peak(n: int, seed: int, factor: float) -> None:
    """Expected: linearity in the force; the triangle inequality; a mean is at most the largest."""
    rng = np.random.default_rng(seed)
    values = {"actuator_force": rng.normal(size=(n, 6)), "leg_length": rng.uniform(1, 2, (n, 6))}
    values |= {"leg_velocity": rng.normal(size=(n, 6)), "error.leg_length": rng.normal(size=(n, 6))}
    found = metrics(record_of(n, values))
    energy = found["energy"]
    assert energy["net_total"] == pytest.approx(sum(energy["net"]))
    assert energy["absolute_total"] == pytest.approx(sum(energy["absolute"]))
    assert all(abs(a) <= b * (1 + 1e-12) for a, b in zip(energy["net"], energy["absolute"], strict=True))
    for part in (found["force"], found["tracking"]["leg_length"]):
        assert all(a <= b * (1 + 1e-12) for a, b in zip(part["rms"], part["peak"], strict=True))
    scaled = metrics(record_of(n, {**values, "actuator_force": factor * values["actuator_force"]}))
    for part, key in (("force", "peak"), ("force", "rms"), ("power", "peak"), ("energy", "net")):
        assert np.allclose(scaled[part][key], factor * np.array(found[part][key]), rtol=1e-9, atol=1e-12 * factor)


# --- saturation and stroke -----------------------------------------------------------------------------------------


def test_saturation_counts_the_rows_that_last() -> None:
    """Expected: 3 of 10 intervals in leg 1, 2 others in leg 4; the eleventh row is the end of the tenth."""
    limited = np.zeros((11, 6), dtype=bool)
    limited[:3, 0] = limited[[5, 6], 3] = limited[10] = True
    found = metrics(record_of(11, {"flag.force_limited": limited}))["saturation"]
    assert np.allclose(found["force_limited"]["legs"], [0.3, 0, 0, 0.2, 0, 0])
    assert found["force_limited"]["any"] == pytest.approx(0.5)
    assert "rate_limited" not in found


def test_stroke_says_how_near_the_nearest_limit_came() -> None:
    length = np.linspace(1.2, 1.7, 5)[:, None] + np.zeros(6)
    exceeded = length > 1.65
    record = record_of(
        5, {"leg_length": length, "flag.stroke_exceeded": exceeded}, leg_length_min=1.0, leg_length_max=1.65
    )
    found = metrics(record)["stroke"]
    assert found["shortest"] == [1.2] * 6
    assert found["longest"] == [1.7] * 6
    assert found["margin"] == pytest.approx(-0.05)
    assert found["exceeded"] == {"legs": [0.2] * 6, "any": 0.2}
    assert metrics(record_of(5, {"leg_length": length}, leg_length_min=1.0))["stroke"]["margin"] == pytest.approx(0.2)
    assert metrics(record_of(5, leg_length_min=None))["stroke"]["margin"] is None


def test_limits_say_how_much_of_them_each_leg_used_and_when_it_went_beyond() -> None:
    """Expected: worked out by hand; the force is held over its row, so that power counts with both ends' velocities."""
    force, velocity = np.zeros((4, 6)), np.zeros((4, 6))
    velocity[2, 1], velocity[3, 4] = -0.6, 0.3
    force[1, 1], force[3, 4], force[0, 0] = 20.0, -30.0, 50.0
    values = {"actuator_force": force, "leg_velocity": velocity}
    stated = {"leg_velocity_max": 0.5, "actuator_power_max": 10.0, "actuator_force_max": 50.0}
    record = record_of(4, values)
    record.metadata["platform"].update(stated)
    found = metrics(record)["limits"]
    assert {name: part["limit"] for name, part in found.items()} == stated
    assert found["leg_velocity_max"]["used"] == pytest.approx([0, 1.2, 0, 0, 0.6, 0])
    assert found["leg_velocity_max"]["first_exceeded"] == [None, 2 * STEP, None, None, None, None]
    assert found["actuator_force_max"]["used"] == pytest.approx([1, 0.4, 0, 0, 0.6, 0])
    assert found["actuator_force_max"]["first_exceeded"] == [None] * 6
    assert found["actuator_power_max"]["used"] == pytest.approx([0, 1.2, 0, 0, 0.9, 0])
    assert found["actuator_power_max"]["first_exceeded"] == [None, STEP, None, None, None, None]
    text = printed(metrics(record))
    assert "leg velocity, of its limit" in text
    assert "actuator power, first beyond" in text
    assert metrics(record_of(4, values))["limits"] is None


# --- records that lack something -----------------------------------------------------------------------------------


def test_open_loop_record_has_no_tracking_and_no_saturation() -> None:
    found = metrics(record_of(20))
    assert found["tracking"] is found["step_response"] is found["saturation"] is None
    assert found["energy"]["net_total"] == 0
    assert "Tracking" not in printed(found)


def test_single_row_has_no_mean_power() -> None:
    found = metrics(record_of(1, {"actuator_force": 3.0, "leg_velocity": 2.0, "flag.force_limited": True}))
    assert found["duration"] == 0
    assert found["power"] == {"peak": [6.0] * 6, "mean": [None] * 6}
    assert found["energy"]["net_total"] == 0
    assert found["force"]["rms"] == [3.0] * 6
    assert found["saturation"]["force_limited"]["any"] == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_rows_that_are_not_finite_do_not_count(value: float) -> None:
    length = np.ones((10, 6))
    length[9] = value
    found = metrics(record_of(10, {"leg_length": length, "error.leg_length": 1 - length}, status="diverged"))
    assert found["rows"] == 9
    assert found["stroke"]["longest"] == [1.0] * 6
    assert found["outcome"]["status"] == "diverged"
    assert "diverged at 0.009 s: too far from the reference" in printed(found)
    nothing = metrics(record_of(1, {"leg_length": value}))
    assert nothing["rows"] == 0
    assert nothing["force"] is None
    metrics_json(nothing)


def test_what_overflows_is_undefined() -> None:
    found = metrics(record_of(10, {"actuator_force": 1e300, "leg_velocity": 1e300, "error.position": 1e200}))
    assert found["power"]["peak"] == [None] * 6
    assert found["tracking"]["position"]["rms"] == [None] * 3
    assert json.loads(metrics_json(found)) == found
    assert "–" in printed(found)


def test_tables_fit_a_hundred_columns_and_json_reads_back() -> None:
    wanted = np.r_[0.0, -1.234567e-3 * np.ones(99)]
    record = step_of(1.1234567 * wanted, wanted)
    rng = np.random.default_rng(0)
    more = record_of(
        100, {"actuator_force": -1e4 * rng.random((100, 6)), "flag.rate_limited": rng.random((100, 6)) > 0.5}
    )
    more = Record(more.table.hstack(record.table.select(c for c in record.table.columns if "." in c)), more.metadata)
    found = metrics(more)
    text = printed(found)
    assert max(map(len, text.splitlines())) <= 100
    for word in ("Tracking error", "Step response", "Legs", "rate limited", "|orientation|"):
        assert word in text
    assert "…" not in text
    assert json.loads(metrics_json(found)) == found


def test_metrics_by_path_are_one_number_each() -> None:
    """Expected: by hand: the largest of a list, the least of lengths and times, None where one is undefined."""
    found = flattened(
        {
            "outcome": {"status": "completed", "time": 7.3},
            "rows": 11,
            "duration": None,
            "tracking": {"position": {"rms": [1.0, 3.0, -5.0], "norm_peak": None, "peak": [1.0, None, 2.0]}},
            "step_response": [
                {"axis": "z", "from": 1.0, "rise_time": None},
                {"axis": "yaw", "from": -2.0, "rise_time": 0.25},
            ],
            "force": {"peak": [None, None]},
            "power": None,
            "saturation": {"force_limited": {"legs": [0.0, 0.5, 0.25], "any": 0.75}},
            "stroke": {"shortest": [2.0, 1.5, 3.0], "longest": [4.0, 6.0, 5.0], "margin": None},
            "limits": {"leg_velocity_max": {"limit": 0.5, "first_exceeded": [None, 3.0, 2.0]}},
        }
    )
    assert found == {
        "rows": 11,
        "tracking.position.rms": 3.0,
        "tracking.position.norm_peak": None,
        "tracking.position.peak": None,
        "force.peak": None,
        "saturation.force_limited.legs": 0.5,
        "saturation.force_limited.any": 0.75,
        "stroke.shortest": 1.5,
        "stroke.longest": 6.0,
        "stroke.margin": None,
        "limits.leg_velocity_max.limit": 0.5,
        "limits.leg_velocity_max.first_exceeded": 2.0,
        "step_response.z.from": 1.0,
        "step_response.z.rise_time": None,
        "step_response.yaw.from": -2.0,
        "step_response.yaw.rise_time": 0.25,
    }
    assert flattened({"rows": 0, "duration": 0.0, "step_response": None}) == {"rows": 0, "duration": 0.0}


def test_parts_without_numbers_are_none_and_not_empty() -> None:
    """Expected: None for what the columns do not give; an empty list of steps for references that rest."""
    found = metrics(record_of(5))
    assert found["tracking"] is found["saturation"] is found["limits"] is found["step_response"] is None
    for lacks in ("reference.position", "reference.orientation"):
        record = step_of(np.zeros(5), np.zeros(5))
        assert metrics(record)["step_response"] == []
        assert metrics(Record(record.table.drop(record.columns_of(lacks)), record.metadata))["step_response"] is None


@pytest.mark.parametrize(
    "name",
    [
        *SIZES,
        *("error.position", "error.orientation", "error.leg_length", "reference.position", "reference.orientation"),
    ],
)
def test_a_lost_number_in_any_column_of_the_plant_ends_what_counts(name: str) -> None:
    """Expected: the rows before it, of whatever variable, in its last element."""
    values = {f"{prefix}.{each}": 0.0 for prefix in ("error", "reference") for each in ("position", "orientation")}
    record = record_of(9, {**values, "error.leg_length": 0.0})
    last = record.columns_of(name)[-1]
    broken = record.table.with_columns(
        polars.when(polars.col("time") > 0.0065).then(np.nan).otherwise(polars.col(last)).alias(last)
    )
    found = metrics(Record(broken, record.metadata))
    assert (found["rows"], found["duration"]) == (7, pytest.approx(6 * STEP))
