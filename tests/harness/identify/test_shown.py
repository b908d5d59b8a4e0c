"""What tables, files, page and figures show of `ESTIMATE`, in which no two numbers are alike; written by hand."""

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gough_stewart import Estimate
from gough_stewart.harness.identify.estimate import Diagnosis, Finding, Residuals, Unseen, expand_to_requested
from gough_stewart.harness.identify.estimate_report import estimate_report, estimate_tables
from gough_stewart.harness.identify.lack_of_fit import LackOfFit
from gough_stewart.harness.report.chart import Chart
from tests.support.uneven import UNEVEN

NAMES = ("platform_mass", "leg_viscous_friction[2]", "platform_com[3]", "leg_coulomb_friction", "force_gain[4]")
NAN = float("nan")
FINDING = Finding(
    *("gain of leg 4", "force sensor of leg 4", "gain of leg 4 +5.0 ± 0.4 %; calibrate", ("force_gain[4]",), ("",)),
    np.array([1.05]), np.array([[4e-6]]), 0.876,
)  # fmt: skip
OTHER = Finding(
    *("force offsets of all legs", "force sensors", "force offsets of all legs"),
    ("force_offset[1]", "force_offset[6]"), ("N", "N"), np.array([3.0, -7.0]),
    np.array([[0.25, 0.1], [0.1, 0.16]]), 0.432,
)  # fmt: skip
DIAGNOSIS = Diagnosis(
    test=LackOfFit({"gain of forces": 1.2e-5, "joints": 0.034, "whiteness": 0.56}, 0.0042),
    cause="force sensor of leg 4",
    findings=(FINDING,),
    remains=0.31,
    unseen=(
        Unseen("if gravity were 1 % higher", np.array([1.0, -2.5, NAN, 3.0, 0.0])),
        Unseen("if all forces read 1 % high", np.array([12.4, 0.5, NAN, 1.0, 0.02])),
        Unseen("if the clock were 1 % fast", np.zeros(5)),
    ),
    names=NAMES,
    standard_errors=np.array([2.0, 3.0, NAN, NAN, 0.01]),
    force_noise=np.array([1.1, 2.2, 3.3, 4.4, 5.5, 6.6]),
    length_noise=7.7e-7,
    whiteness=np.array([0.11, 0.22, 0.33, 0.44, 0.55, 0.66]),
)
_TIME = np.array([7.3, 7.4, 7.5, 7.9])
_MEASURED = 100.0 * np.arange(1.0, 7.0) + np.arange(4.0)[:, None] ** 2
_FITTED = _MEASURED - 0.1 * np.arange(1.0, 7.0) * np.array([1.0, -1.0, 2.0, 4.0])[:, None]
_BEFORE = _MEASURED - 3.0 * np.arange(1.0, 7.0) * np.array([2.0, 5.0, -1.0, 7.0])[:, None]
COVARIANCE = np.full((5, 5), NAN)
COVARIANCE[np.ix_([0, 1, 4], [0, 1, 4])] = [[4.0, 1.5, 0.002], [1.5, 9.0, -0.003], [0.002, -0.003, 1e-4]]
ESTIMATE = Estimate(
    method="linear",
    names=NAMES,
    values=np.array([1516.9, 431.7, NAN, 0.0, 1.021]),
    nominal=np.array([1200.0, 500.0, 0.15, 100.0, 1.0]),
    covariance=COVARIANCE,
    singular_values=np.array([800.0, 50.0, 4.0, 0.5]),
    directions=np.array(
        [
            *([0.9, -0.3, 0.0, 0.05, 0.31], [0.0, -0.8, 0.6, 0.0, 0.0]),
            *([0.0, 0.0, 0.1, 0.99, 0.0], [0.02, 0.0, 0.3, 0.0, -0.95]),
        ]
    ),
    scale=np.array([1200.0, 250.0, 2.0, 80.0, 1.0]),
    rank=3,
    residuals=Residuals(
        "force of leg",
        "N",
        np.array([10.01, 11.02, 12.03, 13.04, 14.05, 15.06]),
        np.array([20.1, 21.2, 22.3, 23.4, 24.5, 25.6]),
        np.array([1000.0, 500.0, 400.0, 300.0, 200.0, 0.0]),
        np.array([0.91, 0.82, 0.73, 0.64, 0.55, 0.46]),
    ),
    notes=("a < note", "another"),
    alarms=("an & alarm",),
    diagnosis=DIAGNOSIS,
    not_excited=("platform_com[3]",),
    at_bound=("leg_coulomb_friction",),
    details={
        "time": _TIME,
        "measured": _MEASURED,
        "fitted": _FITTED,
        "before": _BEFORE,
        "validating": [(7.5, 7.9), (8.1, 8.6)],
    },
)
NOMINAL = replace(UNEVEN, platform_mass=1200.0, leg_viscous_friction=500.0)
# 1.959964 standard errors of 2, 3 and 0.01
HALF = np.array([3.919928, 5.879892, NAN, NAN, 0.01959964])


def test_tables_have_every_number_in_its_place() -> None:
    parameters, identifiability, residuals, tests, findings, unseen = estimate_tables(ESTIMATE)
    assert parameters.title == "Parameters, with 95 % intervals"
    assert tuple(column.title for column in parameters.columns) == ("", "before", "estimate", "±", "± %")
    assert parameters.shown == [
        ("platform_mass kg", "1200", "1516.9", "3.9", "0.26"),
        ("leg_viscous_friction[2] N·s/m", "500", "431.7", "5.9", "1.4"),
        ("platform_com[3] m", "0.15", "not excited", "–", "–"),
        ("leg_coulomb_friction N", "100", "0", "at its bound", "–"),
        ("force_gain[4]", "1", "1.021", "0.02", "1.9"),
    ]
    assert identifiability.title == "Identifiability; condition number 1.6e+03"
    assert tuple(column.title for column in identifiability.columns) == ("combination, relative to scale", "± %")
    assert identifiability.shown == [
        ("0.90 platform_mass + 0.31 force_gain[4] − 0.30 leg_viscous_friction[2]", "0.12"),
        ("0.80 leg_viscous_friction[2] − 0.60 platform_com[3]", "2"),
        ("0.99 leg_coulomb_friction + 0.10 platform_com[3]", "25"),
        ("0.95 force_gain[4] − 0.30 platform_com[3]", "unobservable"),
    ]
    assert residuals.title == "Residuals"
    assert tuple(column.title for column in residuals.columns) == (
        *("residual", "fitted [N]", "validation [N]", "of signal [%]", "p of whiteness"),
    )
    assert residuals.shown == [
        ("force of leg 1", "10.01", "20.1", "1", "0.91"),
        ("force of leg 2", "11.02", "21.2", "2.2", "0.82"),
        ("force of leg 3", "12.03", "22.3", "3.01", "0.73"),
        ("force of leg 4", "13.04", "23.4", "4.35", "0.64"),
        ("force of leg 5", "14.05", "24.5", "7.03", "0.55"),
        ("force of leg 6", "15.06", "25.6", "–", "0.46"),
    ]
    assert tests.title == "What the residuals contain; all tests p = 0.0042"
    assert tuple(column.title for column in tests.columns) == ("tested", "p value")
    assert tests.shown == [("gain of forces", "1.2e-05"), ("joints", "0.034"), ("whiteness", "0.56")]
    assert findings.title == "Diagnosis: force sensor of leg 4"
    assert tuple(column.title for column in findings.columns) == ("", "misfit explained [%]")
    assert findings.shown == [("gain of leg 4 +5.0 ± 0.4 %; calibrate", "88")]
    assert unseen.title == "What no residual shows, since estimates absorb it"
    assert tuple(column.title for column in unseen.columns) == ("", "estimates would be off by", "standard errors")
    assert unseen.shown == [
        ("if gravity were 1 % higher", "leg_viscous_friction[2] -2.5 N.s/m, platform_mass +1 kg", "0.83"),
        (
            "if all forces read 1 % high",
            "platform_mass +12 kg, force_gain[4] +0.02, leg_viscous_friction[2] +0.5 N.s/m",
            "6.2",
        ),
        ("if the clock were 1 % fast", "less than a tenth of their errors", "–"),
    ]


def test_tables_without_validation_tests_or_findings_say_so_and_no_p_value_is_zero() -> None:
    """Expected: the bound below which a p-value lies, by hand; 0 is no probability of a continuous statistic."""
    test = LackOfFit({"gain of forces": 0.0, "joints": 9e-7, "whiteness": 1.1e-6}, 0.00025)
    shown = estimate_tables(replace(ESTIMATE, diagnosis=replace(DIAGNOSIS, test=test)))[3]
    assert [row[1] for row in shown.shown] == ["< 1e-6", "< 1e-6", "1.1e-06"]
    bare = replace(ESTIMATE, residuals=replace(ESTIMATE.residuals, validation_rms=None, whiteness=None))
    rows = estimate_tables(bare)[2].shown
    assert [row[2:] for row in rows[:2]] == [("–", "1", "–"), ("–", "2.2", "–")]
    for diagnosis, tables in ((replace(DIAGNOSIS, test=None, findings=(), unseen=()), 3), (None, 3)):
        assert len(estimate_tables(replace(bare, diagnosis=diagnosis))) == tables
    several = replace(bare, diagnosis=replace(DIAGNOSIS, cause="", findings=(FINDING, OTHER)))
    assert estimate_tables(several)[4].title == "Diagnosis: no cause is sure; the log does not tell which"


SENTENCES = ["gain of leg 4 explains 88 % of the misfit"]


def test_the_file_of_numbers_has_all_of_them() -> None:
    diagnosis = replace(DIAGNOSIS, findings=(FINDING, OTHER), names=NAMES[:1], unseen=(Unseen("if", np.ones(1)),))
    numbers = json.loads(replace(ESTIMATE, diagnosis=diagnosis).to_json())
    assert list(numbers["parameters"]) == list(NAMES)
    expected = [
        (1516.9, 2.0, [1512.980072, 1520.819928], 1200.0, "kg"),
        (431.7, 3.0, [425.820108, 437.579892], 500.0, "N.s/m"),
        (None, None, [None, None], 0.15, "m"),
        (0.0, None, [None, None], 100.0, "N"),
        (1.021, 0.01, [1.00140036, 1.04059964], 1.0, ""),
    ]
    for row, (value, error, interval, nominal, unit) in zip(numbers.pop("parameters").values(), expected, strict=True):
        assert row == {
            "value": value,
            "standard_error": error if error is None else pytest.approx(error),
            "interval": interval if error is None else pytest.approx(interval, abs=1e-6),
            "nominal": nominal,
            "unit": unit,
        }
    correlation = numbers.pop("correlation")
    assert [correlation[0][1], correlation[4][1]] == pytest.approx([0.25, -0.1])
    assert correlation[2] == [None] * 5
    found = numbers.pop("diagnosis")
    offsets = found["findings"][1]["parameters"]
    assert offsets["force_offset[6]"].pop("interval") == pytest.approx([-7.7839856, -6.2160144])
    del offsets["force_offset[1]"]["interval"]
    assert found["findings"][0]["parameters"]["force_gain[4]"].pop("interval") == pytest.approx(
        [1.04608007, 1.05391993]
    )
    assert found == {
        "alarm": True,
        "p_value": 0.0042,
        "p_values": {"gain of forces": 1.2e-5, "joints": 0.034, "whiteness": 0.56},
        "cause": "force sensor of leg 4",
        "findings": [
            {
                "hypothesis": "gain of leg 4",
                "cause": "force sensor of leg 4",
                "text": "gain of leg 4 +5.0 ± 0.4 %; calibrate",
                "improvement": 0.876,
                "parameters": {"force_gain[4]": {"value": 1.05, "standard_error": 0.002, "unit": ""}},
            },
            {
                "hypothesis": "force offsets of all legs",
                "cause": "force sensors",
                "text": "force offsets of all legs",
                "improvement": 0.432,
                "parameters": {
                    "force_offset[1]": {"value": 3.0, "standard_error": 0.5, "unit": "N"},
                    "force_offset[6]": {"value": -7.0, "standard_error": 0.4, "unit": "N"},
                },
            },
        ],
        "p_value_of_the_rest": 0.31,
        "unseen": {"if": {"platform_mass": 1.0}},
        "noise": {"force": [1.1, 2.2, 3.3, 4.4, 5.5, 6.6], "length": 7.7e-7},
        "sentences": SENTENCES,
    }
    assert numbers.pop("covariance")[1] == [1.5, 9.0, None, None, -0.003]
    residuals = vars(ESTIMATE.residuals)
    assert numbers.pop("combinations")[1] == "0.80 leg_viscous_friction[2] − 0.60 platform_com[3]"
    assert numbers == {
        "method": "linear",
        "singular_values": [800.0, 50.0, 4.0, 0.5],
        "rank": 3,
        "not_excited": [NAMES[2]],
        "at_bound": [NAMES[3]],
        "residuals": {name: x.tolist() if isinstance(x, np.ndarray) else x for name, x in residuals.items()},
        "validation": None,
        "alarms": ["an & alarm"],
        "notes": ["a < note", "another"],
    }


ALARM = "the log contradicts the model (p = 0.0042; a false alarm in 5 of 100 logs); values and intervals are not valid"
FOUND, NONE = FINDING.text, "something that no hypothesis here explains"
RIGHT = {"cause": "", "findings": ()}


@pytest.mark.parametrize(
    ("change", "alarm", "sentences"),
    [
        ({}, f"{ALARM}. Most likely: force sensor of leg 4: {FOUND}", SENTENCES),
        (
            {"findings": (FINDING, replace(OTHER, text="its offset"))},
            f"{ALARM}. Most likely: force sensor of leg 4: this log does not tell which: {FOUND}; or its offset",
            SENTENCES,
        ),
        (
            {"cause": "", "findings": (FINDING, OTHER), "remains": 0.0031},
            f"{ALARM}. Most likely: one of several causes, which this log does not tell apart: {FOUND}; or "
            f"{OTHER.text}",
            [*SENTENCES, "something else is left after that (p = 0.0031)"],
        ),
        ({"test": LackOfFit({}, 0.0002), **RIGHT}, f"{ALARM.replace('= 0.0042', '< 0.0003')}. Most likely: {NONE}", []),
        (
            {"test": LackOfFit({}, 0.051), **RIGHT},
            None,
            ["the residuals are those of noise (p = 0.051 of lack of fit)"],
        ),
        (
            {"test": None, "untested": "too few rows", **RIGHT},
            None,
            ["not tested whether the model fits: too few rows"],
        ),
    ],
)
def test_the_diagnosis_says_what_it_knows(change: dict[str, Any], alarm: str | None, sentences: list[str]) -> None:
    """Expected: the cause first, then its hypothesis if the log separates it; 5 % is the level of an alarm."""
    found = replace(DIAGNOSIS, **change)
    assert found.sentences == tuple(sentences)
    assert found.alarms == (() if alarm is None else (alarm,))
    assert found.alarm == bool(alarm)


_FIRST_TWO: dict[str, Any] = {name: getattr(ESTIMATE, name)[:2] for name in ("names", "values", "nominal", "scale")}
_OF_TWO: dict[str, Any] = {
    "covariance": COVARIANCE[:2, :2],
    "directions": np.eye(2),
    "singular_values": np.array([3.0, 2.0]),
}
FEW = replace(ESTIMATE, **_FIRST_TWO, **_OF_TWO, rank=2, alarms=(), not_excited=(), at_bound=())
QUIET = replace(DIAGNOSIS, test=LackOfFit({"of phase": 0.4}, 0.4), cause="", findings=(), unseen=())


@pytest.mark.parametrize(
    ("estimate", "status", "text"),
    [
        # 1.96 standard errors in two digits, and values to the same decimals; both within 5 % of value or scale
        (
            replace(FEW, diagnosis=QUIET),
            "good",
            r"Platform_mass 1516.9 ± 3.9 kg and leg_viscous_friction\[2\] 431.7 ± 5.9 N·s/m; the residuals are those "
            "of noise$",
        ),
        (
            replace(FEW, covariance=np.diag([4.0, 9e4])),
            "marginal",
            r"Platform_mass 1516.9 ± 3.9 kg and .*\] 432 ± 590 N",
        ),
        (replace(FEW, diagnosis=None), "marginal", ".* kg and .* N·s/m; whether the model fits the log is not tested"),
        (
            replace(ESTIMATE, alarms=()),
            "marginal",
            r"3 of 5 parameters are known to 5 % or better; least known: force_gain\[4\] 1.021 ± 0.02; not excited by "
            r"this motion: platform_com\[3\]; at the bound of what is possible: leg_coulomb_friction;",
        ),
        # 12.4 kg are 6.2 standard errors, more than any other; of gravity all shifts are below their errors
        (
            replace(FEW, diagnosis=replace(QUIET, unseen=DIAGNOSIS.unseen)),
            "good",
            ".* noise; no residual shows what is wrong alike for all legs: if all forces read 1 % high, platform_mass "
            r"would be off by \+12 kg$",
        ),
        (replace(FEW, diagnosis=replace(QUIET, unseen=DIAGNOSIS.unseen[:1])), "good", ".* those of noise$"),
        (
            replace(ESTIMATE, alarms=(), covariance=np.full((5, 5), NAN)),
            "marginal",
            "None of the 5 parameters is known",
        ),
        (replace(ESTIMATE, alarms=("the log is wrong",)), "bad", "The log is wrong$"),
    ],
)
def test_the_verdict_says_how_well_parameters_are_known(estimate: Estimate, status: str, text: str) -> None:
    """Expected: an alarm before everything; few parameters with their intervals, of many the least known one."""
    report = estimate_report(estimate, "stand")
    assert report.title == "Parameters of stand"
    assert report.verdict.status == status
    assert re.match(text, report.verdict.text), report.verdict.text
    assert [note.kind for note in report.notes if note.kind == "warning"] == ["warning"] * len(estimate.alarms)
    mass = report.verdict.numbers[0]
    assert (mass.path, mass.value) == ("parameters.platform_mass", 1516.9)
    if np.isfinite(estimate.covariance[0, 0]):
        assert (mass.low, mass.high) == pytest.approx((1516.9 - HALF[0], 1516.9 + HALF[0]))


def test_charts_have_the_numbers_of_the_estimate_and_the_report_its_words() -> None:
    report = estimate_report(ESTIMATE, "my base")
    charts = {part.title: part for section in report.sections for part in section.parts if isinstance(part, Chart)}
    change = charts["change of the parameters, of their scale"]
    assert change.x.labels == NAMES
    assert_allclose(change.series[0].values, [316.9 / 1200, -68.3 / 250, NAN, -1.25, 0.021])
    low, high = (np.asarray(end) for end in (change.series[0].low, change.series[0].high))
    assert_allclose((high - low) / 2, HALF / ESTIMATE.scale, rtol=1e-6)
    correlation = charts["correlation of the estimates"].series[0].values
    assert correlation[1, 0] == pytest.approx(0.25)
    assert np.isnan(correlation[1, 2])
    for k in range(6):
        force = charts[f"force of leg {k + 1}"]
        assert_allclose(force.x.values, _TIME)
        assert [series.quantity.unit for series in force.series] == ["N", "N"]
        assert_allclose([series.values for series in force.series], [_MEASURED[:, k], _FITTED[:, k]])
        for name, model in (("identified", _FITTED), ("nominal", _BEFORE)):
            series = charts[f"residuals, {name} platform"].series[k]
            assert_allclose(series.values, (_MEASURED - model)[:, k], atol=1e-12)
    assert [mark.value for mark in charts["residuals, nominal platform"].marks] == [7.5, 7.9, 8.1, 8.6]
    assert (report.title, report.study) == ("Parameters of my base", "identify")
    assert report.lead == "method linear; intervals of 95 % if model and force gain are right"
    by_poses = estimate_report(replace(ESTIMATE, method="geometry"), "my base", charts=False)
    assert by_poses.lead == "method geometry; intervals of 95 % if the model is right"  # it reads no forces
    assert [(note.text, note.kind) for note in report.notes] == [
        ("a < note", "note"),
        ("another", "note"),
        ("an & alarm", "warning"),
    ]
    # of poses there are no charts over time, and none are made unless they are asked for
    of_poses = estimate_report(replace(ESTIMATE, details={"poses": 1}), "my base")
    parts = [part for section in of_poses.sections for part in section.parts]
    assert not any(part.is_over_time for part in parts if isinstance(part, Chart))
    assert [section.title for section in estimate_report(ESTIMATE, "my base", charts=False).sections] == ["Parameters"]


def test_an_expected_error_is_a_part_of_the_covariance_and_what_was_not_fitted_has_none() -> None:
    """Expected: C + b bᵀ of the two that were fitted, in the places of three."""
    names, bias = ("force_gain[4]", *FEW.names), np.array([9.0, 0.5, -2.0])
    whole = expand_to_requested(FEW, names, np.zeros(3), np.ones(3), names[:1], bias)
    assert_allclose(whole.covariance[1:, 1:], [[4.25, 0.5], [0.5, 13.0]])
    assert_allclose(whole.values, [NAN, 1516.9, 431.7])
    assert np.isnan(whole.covariance[0]).all()


def test_the_platform_is_the_one_that_was_found() -> None:
    """Expected: found values, nominal ones of what is not excited, and none of the instruments'."""
    found = ESTIMATE.platform(NOMINAL)
    assert found.platform_mass == 1516.9
    assert found.platform_com[2] == NOMINAL.platform_com[2]
    assert found.leg_coulomb_friction == 0.0
    own = 500.0 * np.array(NOMINAL.leg_viscous_friction_factor)
    own[1] = 431.7
    assert_allclose(found.leg_viscous_friction * np.array(found.leg_viscous_friction_factor), own, rtol=1e-12)
