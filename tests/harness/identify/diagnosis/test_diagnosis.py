"""Alarms and diagnoses: of logs by a Lagrangian that are right, or wrong in one known way."""

import json

import numpy as np
import pytest
from scipy.stats import kstest

from gough_stewart.harness.identify.identify import identify
from gough_stewart.harness.identify.lack_of_fit import lack_of_fit, projection_of
from gough_stewart.harness.identify.names import value_of
from gough_stewart.harness.identify.report import estimate_report, estimate_tables
from gough_stewart.harness.report.page import page_of
from gough_stewart.model.platform import platform_to_toml
from tests.harness.identify import machine as logs_of_another
from tests.support.identification_campaign import LISTED, NAMED, Draw, run
from tests.support.machine_logs import NAMES, NOMINAL, Course, Sensing, Swing, machine_log, random_machine


def test_p_values_of_white_noise_are_uniform() -> None:
    """Expected: by Kolmogorov and Smirnov, of 150 regressions with families that share columns; false alarms 1 in 1000.

    Too few alarms are seen as too many are.
    """
    rng = np.random.default_rng(3)
    p_values = []
    for _ in range(150):
        D, common = rng.standard_normal((120, 4)), rng.standard_normal((120, 3))
        families = {str(q): np.hstack([common, rng.standard_normal((120, q))]) for q in (1, 4, 12)}
        tested = {name: np.eye(X.shape[1]) for name, X in families.items()}
        found = projection_of(D, families, tested, dict.fromkeys(families, 0.0), rng.standard_normal(120), 120)
        assert found is not None
        p_values.append(lack_of_fit(found, rng.uniform()).combined)
    assert kstest(p_values, "uniform").pvalue > 1e-3


@pytest.mark.evidence
def test_right_logs_have_uniform_p_values_and_intervals_that_cover_the_truth() -> None:
    """Expected: of 8 machines, uniform by Kolmogorov and Smirnov; 95 % covered to 4.3 deviations; 1 in 1000 fails."""
    found = [run(Draw("perfect", 300 + k, 300 + k, 6.0, (0.01, 0.001)[k % 2])) for k in range(8)]
    assert kstest([each["p_value"] for each in found], "uniform").pvalue > 5e-4
    inside = np.mean([each["inside"] for each in found], axis=1)
    # estimates of one log are correlated: as many deviations of the logs' own shares
    assert abs(inside.mean() - 0.95) < 4.3 * max(inside.std() / np.sqrt(len(inside)), 0.02)


@pytest.mark.parametrize("fault", [fault for fault in NAMED if "2 ms" not in fault])
def test_a_fault_is_named_first_and_its_size_found(fault: str) -> None:
    """Expected: the hypothesis as the log was made, and its truth in the 99.99 % region."""
    found = run(Draw(fault, 2000, 2000))
    assert found["alarm"]
    assert found["named"] == NAMED[fault][0]
    assert found["distance"] > 1e-4


@pytest.mark.parametrize("fault", LISTED)
def test_geometry_that_is_wrong_is_in_the_list_with_the_remedy(fault: str) -> None:
    found = run(Draw(fault, 2000, 2000))
    assert found["alarm"]
    assert LISTED[fault] in found["listed"]
    assert "calibrate by poses" in found["texts"]


def test_offsets_of_lengths_have_their_signs_and_sizes() -> None:
    """Expected: those that were added to the readings, within 4.5 standard errors, which are a tenth of them."""
    machine, believed = random_machine(3)
    offset = np.array([1e-3, -1e-3, 0.5e-3, 1e-3, -0.7e-3, -1e-3])
    sensing = Sensing(length_offset=tuple(offset.tolist()), force_noise=1e-3)
    found = identify(machine_log(machine, Course(Swing(seed=3)), sensing, seed=5), believed, NAMES).diagnosis
    assert found is not None
    [own] = [each for each in found.findings if each.name == "offset of lengths"]
    assert (np.abs(own.values - offset) < 4.5 * own.standard_errors).all()
    assert (own.standard_errors < 2e-4).all()


def test_a_parameter_that_is_wrong_and_not_estimated_is_named() -> None:
    """Expected: the inertia, of which the file has another than the machine."""
    machine, believed = random_machine(3)
    log = machine_log(machine, Course(Swing(seed=3)), seed=5)
    found = identify(log, believed, [name for name in NAMES if name != "platform_inertia"])
    assert any("platform_inertia is not what the platform's file has" in alarm for alarm in found.alarms)


def test_bristles_at_a_reversal_are_named() -> None:
    """Expected: friction of a starting leg, which LuGre's bristles build up over 65 micrometres."""
    found = identify(logs_of_another.machine_log(friction=logs_of_another.lugre(560.0, 130.0)), NOMINAL, NAMES)
    assert found.diagnosis is not None
    assert found.diagnosis.findings[0].name == "stiction"


def test_coloured_noise_is_named() -> None:
    found = run(Draw("coloured", 2000, 2000))
    assert found["named"] == "coloured noise"
    assert "times too narrow" in found["texts"]


def test_a_common_gain_is_in_the_interval_of_the_mass_with_the_gain_unknown() -> None:
    """Expected: 2 % of gain move the mass by a hundred of its intervals, but less than two of those that are stated."""
    found = run(Draw("common gain", 2000, 2000))
    error, own, wide = found["mass"]
    assert abs(error) > 100 * own
    assert abs(error) < 4 * wide
    assert "A known added mass or a calibrated force sensor separates them" in found["texts"]


def test_instruments_are_estimated_with_the_platform_and_are_not_in_its_file() -> None:
    """Expected: what the log was made with, within 4.5 standard errors; the file has the platform's names only."""
    machine, believed = random_machine(3)
    tilt = np.radians([0.4, -0.3])
    course = Course(Swing(seed=3), base_tilt=(float(tilt[0]), float(tilt[1])))
    sensing = Sensing(force_gain=(1.02, 1, 1, 1, 1, 1), delay=1e-3, force_offset=(0, 0, 0, 25.0, 0, 0))
    log = machine_log(machine, course, sensing, seed=5)
    own = ["force_gain[1]", "force_offset[4]", "delay", "base_tilt"]
    found = identify(log, believed, [*NAMES, *own])
    of_log = {"force_gain[1]": 1.02, "force_offset[4]": 25.0, "delay": 1e-3, "base_tilt[1]": tilt[0]}
    of_log["base_tilt[2]"] = tilt[1]
    truth = np.array([of_log[name] if name in of_log else value_of(machine, name) for name in found.names])
    assert (np.abs(found.values - truth) < 4.5 * found.standard_errors).all()
    assert not found.alarms
    text = platform_to_toml(found.platform(believed))
    assert not any(stem in text for stem in ("force_gain", "force_offset", "delay", "base_tilt"))
    assert json.loads(found.to_json())["parameters"]["delay"]["unit"] == "s"


def test_files_tables_and_page_have_the_diagnosis() -> None:
    """Expected: the named fault with its leg in each of them."""
    machine, believed = random_machine(3)
    log = machine_log(machine, Course(Swing(seed=3)), Sensing(force_gain=(1, 1, 1.02, 1, 1, 1)), seed=5)
    found = identify(log, believed, NAMES)
    said = "forces of leg 3 read "
    plain = json.loads(found.to_json())["diagnosis"]
    assert plain["findings"][0]["text"].startswith(said)
    assert plain["findings"][0]["parameters"]["force_gain[3]"]["interval"][0] < 1.02
    assert any(said in alarm for alarm in found.alarms)
    assert any(said in str(row) for table in estimate_tables(found) for row in table.rows)
    assert said in page_of(estimate_report(found, believed.name)).decode()
