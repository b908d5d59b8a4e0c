"""Members whose loops oscillate or grow without input, against the same members run alone."""

from pathlib import Path
from typing import Any

import polars
import pytest

import gough_stewart as gs
from tests.support.commands import invoke

# With a delay of 60 samples an eigenvalue is outside of the unit circle, with 1 none.
MIXED: dict[str, Any] = {
    "loop.duration": 1.4,
    "controller.bandwidth": 4.0,
    "ensemble": {
        "members": 6,
        "seed": 5,  # sound members are not where they would be in reverse
        "loop.delay": {"choice": [1, 22, 35]},
        "platform_mass": {"uniform": [1200, 1600]},
    },
}


def judged(settings: dict[str, Any], members: int, controller: Any = None) -> tuple[gs.Ensemble, list[Any]]:
    """The ensemble, and of each member the oscillation that `gs.metrics` says of its own run, as the table has it."""
    found = gs.ensemble("heave_step", settings, controller=controller, members=members, workers=1)
    own = []
    for k, row in enumerate(found.members.iter_rows(named=True)):
        said = gs.metrics(gs.run("heave_step", settings, controller=controller, member=k))["outcome"]["oscillation"]
        own.append(said)
        if said is None:
            assert (row["oscillation"], row["oscillation.amplitude"], row["oscillation.frequency"]) == (None,) * 3
        else:
            assert row["oscillation"] == ("growing" if said["is_growing"] else "oscillating")
            assert row["oscillation.amplitude"] == pytest.approx(said["amplitude"], rel=1e-9)
            assert row["oscillation.frequency"] == pytest.approx(said["frequency"], rel=1e-9)
    return found, own


def test_every_member_is_judged_as_its_own_run_is() -> None:
    """Expected: what `gs.metrics` says of each member's record: some are sound, some oscillate."""
    found, own = judged(MIXED, 6)
    assert None in own
    kinds = found.members["oscillation"].drop_nulls().to_list()
    counts = {kind: kinds.count(kind) for kind in kinds}
    assert found.metadata["oscillations"] == counts != {}
    words = " and ".join(f"{counts[kind]} {kind}" for kind in ("oscillating", "growing") if kind in counts)
    assert f"6 members: 6 completed ({words} without input)" in str(found)
    assert "oscillation.amplitude" not in found.metrics


# The loop oscillates; each acts for the last time at 0.62 s.
HUNTING = {
    "loop.duration": 1.6,
    "controller.bandwidth": 4.0,
    "loop.delay": 35,
    "ensemble": {"members": 2, "platform_mass": {"uniform": [1400, 1500]}},
}
STICKING = {"plant.parameters": {"leg_friction_model": "lugre", "leg_coulomb_friction": 1.0}}
ACTING: dict[str, dict[str, Any]] = {
    "a leg that is cut": {"fault": [{"at": 0.6, "cut": [1], "duration": 0.02}]},
    "a sensor that freezes": {"fault": [{"at": 0.6, "freeze": {"leg_velocity": [1]}, "duration": 0.02}]},
    "static friction": {**STICKING, "change": [{"at": 0.62, "parameters": {"leg_static_friction": 1.5}}]},
    "mass": {"change": [{"at": 0.62, "factors": {"platform_mass": 1.0001}}]},
    "a disturbance": {"disturbance": [{"at": 0.6, "duration": 0.02, "force": [0, 0, 1.0]}]},
    "the reference": {"reference.at": 0.62},
}


@pytest.mark.parametrize("acting", ACTING.values(), ids=ACTING)
def test_a_loop_is_without_input_from_the_last_that_acts_on_it(acting: dict[str, Any]) -> None:
    """Expected: from 0.62 s, by the settings; so a member of the ensemble is said to do what its own run does."""
    for own in judged(HUNTING | acting, 2)[1]:
        assert own["since"] == pytest.approx(0.62)


def closing(sample: Any) -> Any:
    """A law that closes an open loop, with gains too large for 35 samples of delay."""
    error = sample.reference["leg_length"] - sample.measured["leg_length"]
    return 1e6 * error - 2e4 * sample.measured["leg_velocity"]


ONE = {"ensemble": {"members": 1, "platform_mass": {"normal": 1e-6}}}
OPEN = {"loop.duration": 1.6, "loop.delay": 35, "controller": {"type": "open_loop", "feedforward": "gravity"}}
CHIRP = {"type": "chirp", "leg": 4, "amplitude": 2000.0, "band": [5.0, 9.0]}
JUDGED: dict[str, tuple[dict[str, Any], Any, list[bool]]] = {
    # the one that gets heavier at 0.6 s acts then, the other has the mass already
    "a change to what a machine has": (
        {**HUNTING, "change": [{"at": 0.6, "parameters": {"platform_mass": 1450}}],
         "ensemble": {"members": 2, "platform_mass": {"grid": [1400, 1450]}}}, None, [True, True]),
    # what follows 0.04 s before the end is too short to tell
    "changes at other times": (
        {**HUNTING, "change": [{"at": 0.3, "factors": {"platform_mass": 1.001}}],
         "ensemble": {"members": 2, "change": {"1": {"at": {"grid": ["1.56 s", "0.3 s"]}}}}}, None, [False, True]),
    "a controller from Python": ({**OPEN, **ONE}, closing, [True]),
    "a leg that is cut up to the end": ({"fault": [{"at": 1.5, "cut": [1]}], **ONE}, None, [False]),
    "and until shortly before it": ({"fault": [{"at": 1.6, "cut": [1], "duration": 0.35}], **ONE}, None, [False]),
    "an injection that still acts": (
        {**MIXED, "loop.duration": 1.0, "reference.at": 0.01, "injection": CHIRP,
         "ensemble": {**MIXED["ensemble"], "members": 2, "loop.delay": {"choice": [0, 1]}}}, None, [False, False]),
    # of a member that otherwise oscillates by 11 mm, and of a sound one
    "steps of encoders": ({**MIXED, "sensors": {"quantisation": {"leg_length": 2e-3}}}, None, [False, False]),
    "noise": ({**MIXED, "sensors": {"noise": {"leg_length": 2e-3}}}, None, [False, False]),
    "noise of another member": (
        {**HUNTING, "ensemble": {"members": 2, "sensors": {"noise": {"leg_length": {"grid": [3e-2, 0.0]}}}}},
        None, [True, True]),
}  # fmt: skip


@pytest.mark.parametrize("case", JUDGED)
def test_what_acts_or_is_measured_wrongly_is_no_oscillation_without_input(case: str) -> None:
    """Expected: which members oscillate, by the settings; and of each the words and sizes of its own run."""
    settings, controller, oscillates = JUDGED[case]
    found, own = judged(settings, len(oscillates), controller)
    assert [said is not None for said in own] == oscillates
    if case.startswith("a change to"):
        ends = [0.6 if mass < 1425 else 0.2 for mass in found.members["varied.platform_mass"]]
        assert [said["since"] for said in own] == pytest.approx(ends)


def test_the_command_counts_them_and_names_the_largest(tmp_path: Path) -> None:
    """Expected: numbers of the table; exit 0, for some are sound; no frequency where rows are left out."""
    options = ("--set", "loop.duration=2.2", "--set", "controller.bandwidth=4", "--workers", "1")
    varied = ("--set", "ensemble.loop.delay={ choice = [1, 35] }", "--set", "ensemble.worst=0")
    done = invoke(
        "ensemble", "heave_step", *options, *varied, "--members", "6", "--seed", "3", "--out", str(tmp_path / "out")
    )
    assert done.exit_code == 0, done.output
    members = polars.read_parquet(tmp_path / "out" / "members.parquet")
    assert "What makes the position error, at the end vary" in done.output
    assert ", worst" not in " ".join(done.output.split())
    said = " ".join(done.stderr.split())
    for kind, verb in (("oscillating", "oscillate"), ("growing", "grow")):
        some = members.filter(polars.col("oscillation") == kind).sort("oscillation.amplitude", descending=True)
        if some.height:
            amplitude = f"{1e3 * some['oscillation.amplitude'][0]:.3g} mm"
            first = f"member {some['member'][0]} has the largest amplitude, {amplitude}"
            assert f"the loops of {some.height} of 6 members {verb} without input; {first}" in said
        assert some["oscillation.frequency"].null_count() == some.height
    assert (members["oscillation"].is_null() == (members["varied.loop.delay"] == 1)).all()
    assert 0 < members["oscillation"].null_count() < 6


def test_an_ensemble_of_which_all_grow_misses_its_purpose(tmp_path: Path) -> None:
    """Expected: exit 3, as `run` has for its nominal machine, which the shipped experiment says is unstable."""
    options = ("--set", "loop.duration=1.6", "--set", 'ensemble.platform_mass={ normal = "1 kg" }')
    few = ("--members", "2", "--workers", "1", "--set", "ensemble.worst=0")
    done = invoke("ensemble", "too_slow", *options, *few, "--out", str(tmp_path / "out"))
    said = " ".join(done.stderr.split())
    assert done.exit_code == 3, done.output
    assert "no member completed its run with a loop that does not grow: the loops of 2 of 2 members grow" in said
    assert polars.read_parquet(tmp_path / "out" / "members.parquet")["oscillation"].to_list() == ["growing"] * 2
