"""When a controller's unit takes samples, and what it refuses; its law is short, so that forces are known beforehand.

Force k of a sample at time t with position p is RATE t + WEIGHT p + COUNT (samples before) + √p₃, cut to the limit.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from gough_stewart.fmu_build.build import build_units
from gough_stewart.fmu_build.component import Layout
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.fmu import component_of
from gough_stewart.harness.plants.unit import FmuFile
from tests.support.controllers import FORCE_LIMIT, SAMPLE_TIME, uneven_experiment
from tests.support.fmu_plants import DISCARD, OK, Plant, refused
from tests.support.saved_bytes import accepts, numbers_of, with_numbers

T = SAMPLE_TIME
RATE = np.array([300.0, -100.0, 400.0, -150.0, 500.0, -900.0])  # [N/s]
WEIGHT = np.array(
    [[8.0, -28, 4.0], [32.0, 8.0, -32], [4.0, 32.0, 8.0], [-32, 16.0, 20.0], [36.0, 2.0, 16.0], [20, -8, 12]]
)
COUNT = np.array([0.7, -1.1, 0.3, 2.1, -0.4, 1.9])  # [N]
FIRST, SECOND, THIRD = np.array([[0.4, -0.3, 2.5], [-0.2, 0.6, 1.7], [0.7, 0.1, 3.1]])  # [m]


class Units(dict[str, FmuFile]):
    """By FMI version, and what they share."""

    layout: Layout
    start_force: NDArray[np.float64]


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Units]:
    folder: Path = tmp_path_factory.mktemp("samples")
    t, p, count = casadi.SX.sym("t"), casadi.SX.sym("p", 3), casadi.SX.sym("count")
    force = casadi.DM(RATE) * t + casadi.mtimes(casadi.DM(WEIGHT), p) + casadi.DM(COUNT) * count + casadi.sqrt(p[2])
    names = ["time", "position", "memory"], ["actuator_force", "memory_next"]
    law = casadi.Function("law", [t, p, count], [force, count + 1], *names)
    chosen = designed(uneven_experiment(folder, feedforward="none"), law)
    files = Units({file.version: file for file in map(FmuFile, build_units(component_of(chosen, "samples"), folder))})
    files.layout, files.start_force = component_of(chosen).layout, chosen.start_force
    yield files
    for file in files.values():
        file.close()


@pytest.fixture(params=["2.0", "3.0"])
def unit(request: pytest.FixtureRequest, units: Units) -> Iterator[Plant]:
    """An instance, not yet initialised."""
    with Plant(units[request.param]) as one:
        yield one


def force(sample: int, position: ArrayLike, sample_time: float = T) -> NDArray[np.float64]:
    """The forces that a sample decides."""
    p = np.asarray(position)
    free = RATE * sample * sample_time + WEIGHT @ p + COUNT * sample + np.sqrt(p[2])
    return np.asarray(np.clip(free, -FORCE_LIMIT, FORCE_LIMIT))


def assert_force(unit: Plant, expected: NDArray[np.float64]) -> None:
    np.testing.assert_allclose(unit.get("actuator_force"), expected, rtol=1e-12, atol=1e-9)


# By which a communication point may miss a sample: the larger of 1e-6 T and 1e-9 max(1, |t|), at most T/20.
SLACKS = [
    (0.0, T, 1e-6 * T),
    (-0.25, 2.5e-4, 1e-9),
    (12.3, T, 1e-9 * 12.304),
    (-30.0, T, 1e-9 * 29.996),
    (86_400.0, T, 86_400e-9),
    (1e6, T, T / 20),
    (3.0, 0.05, 1e-6 * 0.05),
]


@pytest.mark.parametrize(("start", "sample_time", "slack"), SLACKS)
def test_a_step_that_misses_a_sample_by_rounding_meets_it(
    unit: Plant, units: Units, start: float, sample_time: float, slack: float
) -> None:
    """Expected: forces of sample 0 are out at the end of the step, and the next step begins with sample 1."""
    unit.set("sample_time", sample_time)
    unit.initialise(time=start)
    unit.set("position", FIRST)
    before = unit.serialized()
    unit.do_step(start, sample_time - 1.02 * slack)
    assert_force(unit, units.start_force)
    unit.restore(before)
    end = start + (sample_time - 0.98 * slack)
    unit.do_step(start, sample_time - 0.98 * slack)
    assert unit.time == end
    assert_force(unit, force(0, FIRST))
    unit.set("position", SECOND)
    unit.do_step(end, sample_time)
    assert_force(unit, force(1, SECOND, sample_time))


def test_flags_and_forces_wait_for_the_next_sample(unit: Plant, units: Units) -> None:
    """Expected: before, no flag and the start forces; nothing that was set is changed by a step."""
    far = np.array([2.25, -0.25, 1.0])
    unit.set("position", far)
    unit.initialise()
    free = WEIGHT @ far + 1.0
    assert 1 <= (np.abs(free) > FORCE_LIMIT).sum() <= 5
    for step in (0.3 * T, 0.6 * T):
        np.testing.assert_array_equal(unit.get("force_limited"), np.zeros(6))
        assert_force(unit, units.start_force)
        unit.do_step(unit.time, step)
    unit.do_step(0.9 * T, 0.2 * T)
    np.testing.assert_array_equal(unit.get("force_limited"), np.abs(free) > FORCE_LIMIT)
    assert_force(unit, np.clip(free, -FORCE_LIMIT, FORCE_LIMIT))
    np.testing.assert_array_equal(unit.get("position"), far)
    assert unit.time == pytest.approx(1.1 * T, rel=1e-12)


def test_inputs_go_on_at_their_rates(units: Units) -> None:
    """Expected: p + ṗ t, also where samples see it."""
    rates = np.array([13.0, -21.0, 34.0])
    with Plant(units["2.0"]) as unit:
        unit.initialise(time=-1.0)
        unit.set("position", FIRST)
        unit.set_input_rates("position", rates)
        unit.do_step(-1.0, 2.5 * T)
        np.testing.assert_allclose(unit.get("position"), FIRST + 2.5 * T * rates, rtol=1e-12)
        assert_force(unit, force(1, FIRST + T * rates))


def test_a_state_before_the_first_sample_can_be_restored(unit: Plant, units: Units) -> None:
    unit.initialise()
    unit.set("position", FIRST)
    blob = unit.serialized()
    unit.do_step(0.0, 3 * T)
    for one in (unit, Plant(unit.file)):
        with one:
            one.restore(blob)
            assert_force(one, units.start_force)
            one.set("position", SECOND)
            one.do_step(0.0, T)
            assert_force(one, force(0, SECOND))


def test_after_a_reset_a_unit_is_as_new(unit: Plant) -> None:
    """Expected: the bytes of an instance that was never used."""
    with Plant(unit.file) as new:
        expected = new.serialized()
    unit.set("force_limit", 11.0)
    unit.initialise(time=3.0, stop=5.0)
    unit.set("position", FIRST)
    unit.do_step(3.0, 2.5 * T)
    unit.fmu.reset()
    assert unit.serialized() == expected


@pytest.fixture
def sampled_thrice(unit: Plant) -> bytes:
    unit.initialise()
    unit.set("position", FIRST)
    unit.do_step(0.0, 2.5 * T)
    return unit.serialized()


def test_numbers_that_no_state_has_are_refused(unit: Plant, sampled_thrice: bytes) -> None:
    """Expected: no NaN; infinity for the stop time only, since no limit is 0; not below 0: samples, what is bounded."""
    good = numbers_of(sampled_thrice)
    may_be_infinite, not_negative = [], []
    for k, value in enumerate(good):
        for bad in (np.nan, np.inf, -1.0):
            changed = good.copy()
            changed[k] = bad
            accepted = accepts(unit, with_numbers(sampled_thrice, changed))
            assert not (accepted and np.isnan(bad)), k
            may_be_infinite += [value] if accepted and bad == np.inf else []
            not_negative += [value] if not accepted and bad == -1.0 else []
    assert may_be_infinite == [np.inf]
    assert sorted(not_negative) == [T, 1.0, 1.0, 3.0, FORCE_LIMIT, 4000.0]  # with delays and samples


@pytest.mark.parametrize("delay", [2, 3, 12])
def test_forces_and_flags_come_out_an_output_delay_after_their_sample(unit: Plant, units: Units, delay: int) -> None:
    """Expected: the closed form of sample k from sample k + delay on; start forces before; steps of three quarters."""
    positions = np.random.default_rng(delay).uniform(-0.25, 2.25, (40, 3))
    expected = [
        np.array([force(k, np.abs(p)), np.abs(force(k, np.abs(p))) == FORCE_LIMIT]) for k, p in enumerate(positions)
    ]
    assert 40 <= sum(flags.sum() for _, flags in expected) <= 200
    unit.set("output_delay", float(delay))
    unit.initialise()
    for quarter in range(0, 4 * 39, 3):
        if quarter == 81:
            middle = unit.serialized()
        # the sample is at the beginning of its quarter, and nobody looks at the inputs of the others
        unit.set("position", np.abs(positions[-(-quarter // 4)]))
        unit.do_step(quarter * T / 4, 3 * T / 4)
        sample = (quarter + 3) // 4 - delay
        forces, flags = expected[sample] if sample >= 0 else (units.start_force, np.zeros(6))
        assert_force(unit, forces)
        np.testing.assert_array_equal(unit.get("force_limited"), flags)
    with Plant(unit.file) as other:
        other.restore(middle)
        assert other.get("output_delay") == delay
        for k in range(delay):  # what was in the line then, and not what has passed through it since
            other.set("position", np.abs(positions[21 + k]))
            other.do_step(81 * T / 4 + k * T, T)
            assert_force(other, expected[21 + k - delay][0])


def test_an_output_delay_is_a_whole_number_of_samples_up_to_a_limit(unit: Plant) -> None:
    """Expected: 1 to 12, and another after the start is misuse."""
    for wrong in (0.0, -1.0, 1.5, 13.0, 1e9):
        assert refused(unit.set, "output_delay", wrong) == DISCARD
        message = f"output_delay = {wrong:g} rejected; expected a whole number of samples from 1 to 12"
        assert message in unit.take_messages()
    assert unit.get("output_delay") == 1
    unit.initialise()
    assert refused(unit.set, "output_delay", 2.0) != OK
    assert "output_delay: not allowed in step mode" in unit.take_messages()


def test_a_delay_line_that_no_state_has_is_refused(unit: Plant) -> None:
    """Expected: where the one delay is that a unit starts with, nothing but whole numbers from 1 to 12."""
    unit.set("output_delay", 11.0)
    unit.initialise()
    own = unit.serialized()
    numbers = numbers_of(own)
    (place,) = np.flatnonzero(numbers == 11.0)
    for value in (0.0, 0.5, 13.0, 2.25):
        changed = numbers.copy()
        changed[place] = value
        assert not accepts(unit, with_numbers(own, changed))


def test_older_value_references_stay(units: Units) -> None:
    """Expected: in the order of inputs, outputs, parameters of the plain C, time; what is younger comes after it."""
    for version, file in units.items():
        found = {v.name: int(v.valueReference) for v in file.description.modelVariables}
        younger = ("output_delay", "input_status", "input_bad_time")
        older = [row.variable for row in units.layout.rows if row.variable.name not in ("time", *younger)]
        names = [v.name for v in older] if version == "3.0" else [name for v in older for name in v.scalar_names]
        assert [found[name] for name in names] == list(range(len(names)))
        assert [found[name] for name in younger] == [len(names) + 1 + k for k in range(3)]
        assert version == "2.0" or found["time"] == len(names)


EARLY = [(0.0, 2 * T, 2), (2.5 * T, 2.5 * T, 2), (9 * T, 7 * T, 7), (np.nan, 7 * T, 7)]


@pytest.mark.parametrize(("wanted", "reached", "sample"), EARLY)
def test_a_step_ends_early_when_the_importer_asks_at_a_sample(
    units: Units, wanted: float, reached: float, sample: int
) -> None:
    """Expected: at the time it asks for, at once if that has passed, and never beyond the step; then it goes on."""

    def update(_environment: Any, time: float, *arguments: Any) -> None:
        if time == 2 * T:
            early, at = arguments[-2:]
            early[0], at[0] = True, wanted

    with Plant(units["3.0"], intermediateUpdate=update, earlyReturnAllowed=True) as unit:
        unit.initialise()
        unit.set("position", FIRST)
        _, _, early, last = unit.do_step(0.0, 7 * T)
        assert (early, last) == (reached < 7 * T, reached)
        assert unit.time == reached
        unit.do_step(reached, T)
        assert_force(unit, force(sample, FIRST))


@pytest.mark.parametrize("start", [-2000.0, 2.0])
def test_a_step_of_a_million_samples_is_refused(unit: Plant, start: float) -> None:
    """Expected: 4000 s at 4 ms, counted from the sample that is due."""
    unit.initialise(time=start)
    unit.set("position", FIRST)
    before = unit.serialized()
    assert refused(unit.do_step, start, 4000.0) == DISCARD
    assert (
        f"communication step to {start + 4000:g} s rejected; it has more than 1000000 samples of 0.004 s; "
        "use shorter steps"
    ) in unit.take_messages()
    assert unit.serialized() == before


@pytest.mark.parametrize(("start", "status"), [(1.7e10, OK), (1.9e10, DISCARD), (-1.7e10, OK), (-1.9e10, DISCARD)])
def test_a_sample_time_of_less_than_a_thousand_roundings_of_time_is_refused(
    unit: Plant, start: float, status: int
) -> None:
    """Expected: 4 ms are 1000 roundings of a double, 2⁻⁵² relative, at 1.8e10 s."""
    unit.initialise(time=start)
    unit.set("position", FIRST)
    assert refused(unit.do_step, start, T) == status
    message = f"sample_time = 0.004 s rejected; it is too short to be resolved at time {abs(start):g} s"
    assert (message in unit.take_messages()) == (status == DISCARD)


def test_a_position_out_of_range_gives_safe_forces_and_is_reported(unit: Plant, units: Units) -> None:
    """Expected: start forces, since there is no feedforward, of the sample at 3 T; reported from 4 T on, counted in T.

    The law's memory counts the good samples only.
    """
    unit.set("output_delay", 2.0)
    unit.initialise()
    for k in range(8):
        bad = k in (3, 4)
        unit.set("position", [0.4, 1e10, 2.5] if bad else FIRST)
        unit.do_step(k * T, T)
        since = {3: 1, 4: 2}.get(k, 0)
        assert unit.get("input_status") == float(bad)
        assert unit.get("input_bad_time") == pytest.approx(since * T)
        if k >= 2:  # forces wait in the delay line, reports do not
            assert_force(unit, units.start_force if k in (4, 5) else forces_with_gap(k - 1))
    with Plant(unit.file) as other:
        other.initialise()
        seen = []
        for k in range(7):
            other.set("position", [0.4, 1e10, 2.5] if k in (3, 4) else FIRST)
            other.do_step(k * T, T)
            seen.append(other.get("actuator_force"))
    for k in (3, 4):
        np.testing.assert_array_equal(seen[k], units.start_force)
    np.testing.assert_allclose(seen[5], forces_with_gap(5), rtol=1e-12)


def forces_with_gap(sample: int) -> NDArray[np.float64]:
    """The forces of a sample, if those at 3 T and 4 T were bad."""
    free = RATE * sample * T + WEIGHT @ FIRST + COUNT * (sample - 2 * (sample > 4)) + np.sqrt(FIRST[2])
    return np.asarray(np.clip(free, -FORCE_LIMIT, FORCE_LIMIT))


def test_forces_that_are_no_number_are_refused(unit: Plant, sampled_thrice: bytes) -> None:
    """Expected: at √−1, in the sample at 3 T; the state stays."""
    unit.set("position", [0.1, 0.2, -1.0])
    before = unit.serialized()
    assert refused(unit.do_step, 2.5 * T, T) == DISCARD
    assert "at time 0.012 s: the forces are not finite" in unit.take_messages()
    assert unit.serialized() == before
    unit.restore(sampled_thrice)
    unit.do_step(2.5 * T, T)


def test_an_input_that_grows_beyond_all_numbers_is_refused(unit: Plant, sampled_thrice: bytes) -> None:
    """Expected: as with a rate of 1e308 m/s, which only a state can have, after a second or two."""
    numbers = numbers_of(sampled_thrice)
    (place,) = np.flatnonzero((numbers[:-2] == FIRST[0]) & (numbers[2:] == FIRST[2]))
    numbers[place - 3] = 1e308  # rates stand before inputs
    unit.restore(with_numbers(sampled_thrice, numbers))
    assert refused(unit.do_step, 2.5 * T, 3.0) == DISCARD
    assert "s: an input is not finite; its derivative is too large" in unit.take_messages()
    assert unit.time == 2.5 * T
