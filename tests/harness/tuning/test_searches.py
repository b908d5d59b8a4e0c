"""Searches as they go: interrupted, refused, without a candidate, beyond their bounds, on fresh members."""

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import gough_stewart as gs
from tests.harness.tuning.uneven_search import METRIC, VARY
from tests.support.commands import invoke
from tests.support.metric_definitions import as_one_number, defined_metrics

ONE: dict[str, Any] = {"loop.duration": 0.1, "ensemble": {}}
ONCE: dict[str, Any] = {"members": 1, "fresh": 1, "generations": 1, "population": 5}


def tune(folder: Path, vary: str, minimise: str, settings: dict[str, Any] = ONE, **options: Any) -> gs.Tuning:
    """A search of one key; of one generation of a single run unless said otherwise."""
    return gs.tune(folder / "mine.toml", [vary], minimise, settings, **{**ONCE, **options})


def alone(path: Path, settings: dict[str, Any], *names: str, **options: Any) -> list[float | None]:
    """Metrics of a single run."""
    record = gs.run(path, settings, **options)
    found = as_one_number(defined_metrics(record.table, record.metadata["platform"]))
    return [found[name] for name in names]


def test_an_interrupted_search_keeps_the_best_so_far(folder: Path) -> None:
    """Expected: the candidates of two generations, the best of them, no fresh members; nothing kept is an interrupt."""

    def stop(search: Any) -> None:
        if search.generation[-1] == 1:
            raise KeyboardInterrupt

    runs: list[int] = []
    several: dict[str, Any] = {"members": 2, "fresh": 2, "generations": 9, "status": stop, "progress": runs.append}
    found = tune(folder, VARY[0], METRIC, {"loop.duration": 0.1}, **several)
    assert found.is_interrupted
    assert found.candidates["generation"].to_list() == [0] * 5 + [1] * 5
    assert sum(runs) == 20
    best = min(found.candidates.to_dicts(), key=lambda row: row["value"])
    assert found.values == {"controller.bandwidth": best["controller.bandwidth"]}
    assert found.seen.value == best["value"]
    assert (found.fresh, found.before_fresh, found.fresh_members) == (None, None, 0)
    assert repr(found).endswith("mm in the search; not evaluated again: the search was interrupted.")
    with pytest.raises(KeyboardInterrupt):
        tune(folder, VARY[0], METRIC, {"loop.duration": 0.1}, **several, subject_to=["force.peak < 1 N"])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"quantile": 0.0}, "quantile is 0; expected a share above 0, up to 1"),
        ({"quantile": 1.2}, "quantile is 1.2; expected"),
        *(({name: 0}, f"{name} is 0; expected at least 1") for name in ("members", "fresh", "generations")),
        ({"population": 4}, "population is 4; expected at least 5 candidates"),
        ({"subject_to": ["tracking.positon.norm_rms < 3"]}, "no metric 'tracking.positon.norm_rms'; did you mean"),
        ({"subject_to": ["tracking < 3"]}, "--subject-to 'tracking < 3': no metric 'tracking'"),
        ({"subject_to": ["disk_margn > 3"]}, "no metric 'disk_margn'; did you mean 'margins.disk'"),
        ({"subject_to": ["margins.gain > 3"]}, "no margin 'margins.gain'"),
        ({"subject_to": ["force.peak < nan"]}, "'force.peak < nan' cannot be read"),
        ({"subject_to": ["energy.net_total < 3 kg"]}, "has the unit 'kg'; expected J, uJ, µJ, kJ"),
        ({"subject_to": ["disk_margin > 50 %"]}, "has the unit '%'; expected no unit$"),
        ({"subject_to": ["force.peak = 3"]}, "cannot be read; expected PATH <= NUMBER UNIT, as in '"),
        *(({"subject_to": [text]}, "cannot be read") for text in ("force.peak > ", "a b < 3", "force.peak << 3")),
        ({"subject_to": ["force.peak < 3 N for 90 % of members"]}, "is on a share of members; expected a condition"),
        ({"vary": ["controller.type=1..2"]}, "controller.type"),
        ({"vary": ["reference.position_change=1..2"]}, "is not a single number"),
        ({"vary": ["plant.platform_mass=5..20kg"]}, r"also varies in \[ensemble\]"),
        ({"vary": ["loop.delay=0..2.5"]}, "is a whole number; expected whole bounds"),
        ({"vary": ["controller.bandwidth=3..3Hz"]}, "the bounds are 3 and 3; expected the lower one first"),
        ({"vary": ["controller.bandwidth=1..6kg"]}, "found the unit 'kg'"),
        ({"vary": [VARY[0], VARY[0]]}, "is repeated; expected every key once"),
        ({"vary": []}, "nothing to vary; expected --vary KEY=LOW..HIGH"),
        ({"minimise": "tracking.position.norm_rsm"}, "--minimise: no metric .*did you mean '.*norm_rms'"),
        ({"settings": {"ensemble": {}}, "members": 2}, "members is 2, and all members would be the same"),
        ({"settings": {"ensemble": {}}, "fresh": 2}, "fresh is 2, and all members would be the same"),
        ({"vary": ["=3..3Hz"]}, "expected KEY=LOW..HIGH"),
        ({"vary": ["plant.leg_armature=-1..3kg,log"]}, "the lower bound is -1; expected > 0"),
        ({"vary": ["loop.delay = 0 .. 4 , log"]}, "the lower bound is 0; expected > 0 for a logarithmic scale"),
        ({"vary": ["plant.leg_armature=-9..-2kg"], "settings": {"ensemble": {}}},
         r"\(after 1 generation\): 5 of 5 candidates have members that do not complete; the first: .*leg_armature"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_at_once(folder: Path, changed: dict[str, Any], message: str) -> None:
    """Expected: what was found and what was expected."""
    options = {"vary": [VARY[0]], "minimise": METRIC, **ONCE}
    with pytest.raises(gs.GoughStewartError, match=message):
        gs.tune(folder / "mine.toml", **{**options, **changed})


def test_margins_of_the_nominal_loop_are_conditions() -> None:
    """Expected: the disk margin that `gs.margins` gives for each candidate's experiment."""
    short = {"loop.duration": 0.1, "loop.sample_time": "5 ms", "reference.at": 0.02}
    conditions = ["disk_margin > 0.7", "stable > 0.5"]
    found = gs.tune("heave_step", ["controller.bandwidth=1..4Hz"], METRIC, short, subject_to=conditions, seed=2, **ONCE)
    rows = sorted(found.candidates.to_dicts(), key=lambda row: row["controller.bandwidth"])
    assert [row["kept"] for row in (rows[0], rows[-1])] == [True, False]
    for row in (rows[0], rows[-1]):
        expected = gs.margins("heave_step", {**short, "controller.bandwidth": row["controller.bandwidth"]})
        assert row["margins.disk"] == pytest.approx(expected.disk.alpha, rel=1e-9)
        assert row["margins.stable"] == 1
        assert row["kept"] == (expected.disk.alpha > 0.7)


@pytest.mark.parametrize(
    ("key", "bounds", "own", "gravity"),
    [
        # from below the forces that hold the platform, about 50 N, to above: they are clipped in some candidates only
        ("actuators.force_limit", "20..80 N", 25.0, -9.6),
        # legs that pull
        ("actuators.force_limit", "20..80 N", 25.0, 9.6),
        ("platform.parameters.platform_mass", "8..20kg", 11.5, -9.6),
        ("plant.parameters.platform_mass", "8..20kg", 11.5, -9.6),
        ("reference.phase", "0.1..1.5rad", 0.3, -9.6),
        ("loop.delay", "0..3", 1, -9.6),
        ("sensors.quantisation.leg_length", "0.1..5 mm", 1e-3, -9.6),
    ],
)
def test_each_candidate_starts_from_its_own_machine_and_forces(
    folder: Path, key: str, bounds: str, own: float, gravity: float
) -> None:
    """Expected: single runs, which know nothing of other candidates, from a start that depends on what varies."""
    sine = {"type": "sine", "position_amplitude": [0.02, 0.03, 0.04], "frequency": 1.3, "phase": 0.3}
    settings = {**ONE, "limits.position_error": 5.0, "reference": sine, key: own}
    settings["plant.parameters.gravity"] = [0.8, -1.1, gravity]
    shown = key.replace(".parameters", "") if key.startswith("pl") else key
    further = ["tracking.position.norm_rms", "tracking.leg_length.rms"]
    found = tune(folder, f"{shown}={bounds}", "force.rms", settings, subject_to=[f"{name} >= 0" for name in further])
    rows = found.candidates.to_dicts()
    assert rows[0][shown] == own
    for row in rows:
        expected = alone(folder / "mine.toml", {**settings, key: row[shown]}, "force.rms", *further)
        assert [row[name] for name in ("value", *further)] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("bounds", ["4..5Hz", "1..2Hz"])
def test_values_outside_the_bounds_are_compared_but_not_tried(folder: Path, bounds: str) -> None:
    """Expected: no candidate has the 3 Hz of the experiment; "was" is the experiment's own value all the same."""
    found = tune(folder, f"controller.bandwidth={bounds}", "force.rms")
    low, high = (float(end) for end in bounds.removesuffix("Hz").split(".."))
    assert found.candidates["controller.bandwidth"].is_between(low, high).all()
    assert found.before is not None
    assert [found.before.value] == pytest.approx(alone(folder / "mine.toml", ONE, "force.rms"), rel=1e-5)


def test_a_member_that_failed_has_no_numbers_beside_the_best(folder: Path) -> None:
    """Expected: of two members the ton, which the drives do not hold; half of the members are enough."""
    settings = {"ensemble": {"members": 2, "platform_mass": {"grid": [11.0, 1000.0]}}}
    found = tune(folder, VARY[0], "force.rms", settings, members=2, fresh=2, quantile=0.5)
    assert found.seen.failed == 1
    assert np.isnan(found.seen.metrics["force.rms"]).tolist() == [False, True]


def test_what_the_experiment_leaves_out_was_nothing(folder: Path) -> None:
    """Expected: no value before, shown by dashes; the values found are run all the same."""
    key = "actuators.rate_limit"
    found = tune(folder, f"{key}=200..900N/s", "force.rms", fresh=None)
    assert (found.before, found.before_fresh) == (None, None)
    (force,) = alone(folder / "mine.toml", {**ONE, key: found.values[key]}, "force.rms")
    assert found.seen.value == pytest.approx(force, rel=1e-5)
    rows = {row[0]: row[1:] for row in (re.split(r"\s*[│┃]\s*", line.strip("│ ")) for line in repr(found).splitlines())}
    assert rows["RMS force N"][0] == rows["runs that failed"][0] == "–"
    assert float(rows["RMS force N"][1]) == pytest.approx(force, rel=6e-4)
    assert rows["runs that failed"][1] == "0"


@pytest.mark.parametrize("chance", [{"sensors.noise.leg_length": "1 mm"}, {"loop.jitter": "9 ms"}])
def test_one_noisy_run_is_tested_on_fresh_members(folder: Path, chance: dict[str, str]) -> None:
    """Expected: members of an ensemble that varies nothing, with the seed of the sensors, and the next seed."""
    settings: dict[str, Any] = {"loop.duration": 0.1, "loop.plant_step": 2e-3, "sensors.seed": 6, **chance}
    path = folder / "noisy.toml"
    path.write_text((folder / "mine.toml").read_text().partition("[ensemble]")[0])
    found = gs.tune(path, [VARY[0]], "force.rms", settings, fresh=2, generations=1, population=5, quantile=0.5)
    seen, *fresh = (
        alone(path, {**settings, **found.values, "ensemble": {"seed": seed}}, "force.rms", member=k)[0]
        for seed, k in ((6, 0), (7, 0), (7, 1))
    )
    assert found.seen.value == pytest.approx(seen, rel=1e-4)
    assert found.fresh is not None
    assert found.fresh.value == pytest.approx(min(each for each in fresh if each), rel=1e-4)
    said = repr(found).splitlines()[-1]
    ends = r"RMS force: \S+ N on the one run of the search; 50 % of 2 fresh members have at most \S+ N\."
    assert re.fullmatch(ends, said)


def proportional(_platform: gs.Platform, _sample_time: float, *, kp: float) -> Any:
    """On the legs, with a gain that the experiment states."""
    return lambda sample: kp * (sample.reference["leg_length"] - sample.measured["leg_length"])


@pytest.mark.parametrize(
    ("now", "bounds", "kind"),
    [(900, "700..1100", int), (900, "700.0..1100", float), (900, "700..1100.0", float), (900.0, "700..1100", float)],
)
def test_whole_numbers_are_searched_where_value_and_bounds_are_whole(
    folder: Path, now: float, bounds: str, kind: type
) -> None:
    """Expected: as the documentation of controllers in Python says."""
    settings = {"loop.duration": 0.1, "controller": {"type": "python", "parameters": {"kp": now}}}
    found = tune(folder, f"controller.parameters.kp={bounds}", "force.rms", settings, controller=proportional)
    column = found.candidates["controller.parameters.kp"]
    assert column[0] == now
    assert column.dtype == (polars.Int64 if kind is int else polars.Float64)
    assert (column.cast(float) % 1 == 0).all() == (kind is int)
    assert len(set(column)) == 5


def test_designs_that_need_other_numbers_of_members_are_drawn_at_random(folder: Path) -> None:
    """Expected: the same members as of a random design; those of Sobol's sequence are others."""
    values = {}
    for sampling in ("saltelli", "latin_hypercube", "random", "sobol"):
        settings = {"loop.duration": 0.1, "ensemble.sampling": sampling, "ensemble.members": 16}
        values[sampling] = tune(folder, VARY[0], "force.rms", settings, members=3).seen.value
    assert values["saltelli"] == values["latin_hypercube"] == values["random"] != values["sobol"]


def test_a_generation_has_sixteen_candidates_for_each_key_by_default(folder: Path) -> None:
    """Expected: as the help says: 16 for each key, 25 generations, 64 members at most, or those of the experiment."""
    seen: list[tuple[int, int]] = []

    def stop(search: Any) -> None:
        seen.append((len(search.tried), search.generation[-1]))
        raise KeyboardInterrupt

    found = gs.tune(folder / "mine.toml", VARY, METRIC, {"loop.duration": 0.04}, status=stop)
    assert seen == [(32, 0)]
    assert found.members == 9
    assert inspect.signature(gs.tune).parameters["generations"].default == 25
    many = {"loop.duration": 0.04, "ensemble.members": 600}
    found = tune(folder, VARY[0], "duration", many, members=None, fresh=None, generations=3)
    assert (found.members, found.fresh_members) == (64, 500)
    assert found.search.ending == "the candidates have converged"  # for all are alike
    assert found.candidates["generation"].max() == 1
    said = invoke("tune", "--help").stdout
    assert "25" in said
    assert "16 per key" in said
