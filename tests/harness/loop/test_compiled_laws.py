"""Control laws of users in machine code, against the same laws called member by member in NumPy's loop."""

from typing import Any

import casadi
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.fmu_build import libraries as lanes
from gough_stewart.fmu_build import toolchain
from gough_stewart.fmu_build.cache import BuildError
from gough_stewart.harness.control.traced_law import traced_law_of
from gough_stewart.harness.experiment.members import Members
from gough_stewart.harness.loop import libraries
from gough_stewart.harness.loop.run import Run, simulate
from gough_stewart.harness.plants.lanes import Stepping
from tests.harness.loop.test_compiled_loop import assert_same
from tests.support.uneven_loops import experiment_of as uneven_experiment

NAMES = ("memory", "time", "reference_acceleration", "reference_leg_length", "leg_velocity", "leg_length", "position")
GAINS = np.array([1100.0, 1450.0, 900.0, 1250.0, 1600.0, 1000.0])
TABLES: dict[str, Any] = {
    "loop": {"duration": 0.12, "sample_time": "4 ms", "plant_step": "1 ms", "jitter": "2 ms", "delay": 1},
    "sensors": {"noise": {"leg_length": "20 um", "leg_velocity": "1 mm/s"}, "sample_time": "3 ms", "seed": 5},
    "actuators": {"force_limit": "75 N", "rate_limit": "20 kN/s", "lag": "3 ms"},
    "change": [{"at": 0.05, "factors": {"platform_mass": 1.4}}],
    "limits": {"reference": "warn"},
    "reference": {"type": "sine", "position_amplitude": ["8 mm", "-5 mm", "6 mm"], "frequency": "4 Hz"},
    "controller": {"type": "python"},
}
ENSEMBLE = {
    "members": 11,
    "seed": 4,
    "platform_mass": {"factor": {"uniform": [0.8, 1.3]}},
    "controller": {"parameters": {"scale": {"uniform": [0.7, 1.6]}}},
}


def law_of(_platform: object, sample_time: float, scale: float = 1.0) -> casadi.Function:
    """A law with a limited integral, a cubic spring and functions of time; its inputs are in an order of their own."""
    sizes = (6, 1, 3, 6, 6, 6, 3)
    given = [casadi.SX.sym(name, size) for name, size in zip(NAMES, sizes, strict=True)]
    memory, time, acceleration, wanted, velocity, length, position = given
    error = wanted - length
    integral = casadi.fmin(casadi.fmax(memory + scale * 900 * sample_time * error, -0.5), 0.4)
    force = scale * GAINS * (error + 900 * error**3) - 110 * velocity + integral
    force += casadi.if_else(time > 0.06, 2 * casadi.sin(40 * time), 0.0) + casadi.repmat(acceleration, 2, 1) / 7
    force += casadi.atan2(position[1], 3) * casadi.tanh(velocity)
    outputs = ["memory_next", "actuator_force"]
    return casadi.Function("law", given, [integral, force], list(NAMES), outputs)


class Law:
    """The same with a memory that nobody sees."""

    def __init__(self, platform: object, sample_time: float, scale: float = 1.0) -> None:
        self._function, self._memory = law_of(platform, sample_time, scale), np.zeros(6)

    def __call__(self, sample: gs.Sample) -> np.ndarray[Any, Any]:
        """Forces at a sample."""
        reference, measured = sample.reference, sample.measured
        given = [self._memory, sample.time, reference["acceleration"], reference["leg_length"]]
        given += [measured[name] for name in NAMES[4:]]
        self._memory, force = (np.asarray(each).ravel() for each in self._function(*given))
        return force


def run_of(controller: Any, members: int, **tables: Any) -> Run:
    """All members of an uneven loop whose reference moves; each has another gain and mass."""
    experiment = uneven_experiment("pid", **{**TABLES, "ensemble": {**ENSEMBLE, "members": members}, **tables})
    running = Members(experiment, controller).prepared(0, members).batch.in_parallel(Stepping(tolerance=1e-9))
    with running.plant:
        return simulate(running.plant, running.law_from, running.loop)


@pytest.mark.parametrize("members", [1, 11])
def test_a_users_law_in_an_ensemble_gives_the_rows_of_numpys_loop(members: int) -> None:
    """Expected: those of a class that calls the same function at each sample, to 1e-11 of scale; drives have a lag."""
    ours, theirs = run_of(law_of, members), run_of(Law, members)
    assert ours.host.startswith("compiled, ")
    assert theirs.host == "Python"
    assert_same(ours, theirs, members, 1e-11)
    if members > 1:
        assert ours.force_limited.any()
        assert not ours.force_limited.all()
        assert np.ptp(ours.command[10], axis=0).min() > 0.1


def test_members_bits_do_not_depend_on_the_others() -> None:
    """Expected: of one, five and eleven members the first ones have the same bits, with gains of their own."""
    whole = run_of(law_of, 11)
    for members in (1, 5):
        assert_same(run_of(law_of, members), whole, members, 0.0)


def test_single_runs_and_members_of_ensembles_use_machine_code() -> None:
    """Expected: the metrics of the members of an ensemble are those of single runs of them, which say what ran."""
    settings: dict[str, Any] = {"loop.duration": 0.05}
    law = law_of(None, 1e-3, 300.0)
    found = gs.ensemble("heave_tolerances", settings, controller=law, members=3, workers=1)
    record = gs.run("heave_tolerances", settings, controller=law, member=2)
    assert record.metadata["host"].startswith("compiled, ")
    assert gs.metrics(record)["tracking"]["position"]["norm_rms"] == found.values("tracking.position.norm_rms")[2]
    ours, theirs = gs.run("heave_step", settings, controller=law), gs.run("heave_step", settings, controller=Law300)
    assert (ours.metadata["host"][:8], theirs.metadata["host"]) == ("compiled", "Python")
    assert np.abs(ours["position"] - theirs["position"]).max() < 1e-9
    assert ours["controller.force"] == pytest.approx(theirs["controller.force"], abs=1e-3)


class Law300(Law):
    """With the gain of a large platform."""

    def __init__(self, platform: object, sample_time: float) -> None:
        super().__init__(platform, sample_time, 300.0)


def test_a_law_is_compiled_once_and_not_at_all_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: one call of the compiler for two runs; and without one, NumPy's loop."""
    law = law_of(None, 1e-3, 301.5)
    traced = traced_law_of([law])
    assert traced is not None
    lanes.law_library(traced.function).path.unlink()
    libraries._library.cache_clear()
    calls, compile_ = [], toolchain.compile_library

    def counted(*arguments: Any, **options: Any) -> bytes:
        calls.append(arguments[0])
        return compile_(*arguments, **options)

    monkeypatch.setattr(lanes, "compile_library", counted)
    hosts = [gs.run("heave_step", {"loop.duration": 0.01}, controller=law).metadata["host"] for _ in range(2)]
    libraries._library.cache_clear()
    hosts.append(gs.run("heave_step", {"loop.duration": 0.01}, controller=law).metadata["host"])
    assert calls == ["law"]
    assert {each[:8] for each in hosts} == {"compiled"}

    def missing(_function: object) -> None:
        raise BuildError("no compiler")

    monkeypatch.setattr(libraries, "law_library", missing)
    libraries._library.cache_clear()
    assert gs.run("heave_step", {"loop.duration": 0.01}, controller=law).metadata["host"] == "Python"
    libraries._library.cache_clear()


def test_what_has_no_plain_operations_or_differs_runs_in_numpys_loop() -> None:
    """Expected: a table, and members whose operations differ, run as before."""
    length = casadi.MX.sym("leg_length", 6)
    table = casadi.interpolant("table", "bspline", [[0.0, 2.0, 3.0, 4.0, 5.0]], [0.0, 1.0, -1.0, 2.0, 1.0])
    looked_up = casadi.vertcat(*(100 * table(length[k]) for k in range(6)))
    law = casadi.Function("law", [length], [looked_up], ["leg_length"], ["actuator_force"])
    assert traced_law_of([law]) is None
    assert gs.run("heave_step", {"loop.duration": 0.01}, controller=law).metadata["host"] == "Python"

    def either(platform: object, sample_time: float, scale: float = 1.0) -> casadi.Function:
        law = law_of(platform, sample_time, scale)
        if scale < 1:
            given = law.sx_in()
            law = casadi.Function("law", given, [each + 1 for each in law(*given)], list(NAMES), law.name_out())
        return law

    assert run_of(either, 11).host == "Python"


def test_a_file_may_have_a_casadi_function(tmp_path: Any) -> None:
    """Expected: as the function itself, by name and from a factory with parameters."""
    (tmp_path / "law.py").write_text(
        "import casadi\n"
        "def make(platform, sample_time, kp=4e5):\n"
        "    length, wanted = casadi.SX.sym('y', 6), casadi.SX.sym('r', 6)\n"
        "    names = ['leg_length', 'reference_leg_length']\n"
        "    return casadi.Function('law', [length, wanted], [kp * (wanted - length)], names, ['actuator_force'])\n"
        "law = make(None, 1.0)\n"
    )
    for chosen in ({"name": "law"}, {"factory": "make", "parameters": {"kp": 4e5}}):
        table = {"type": "python", "file": str(tmp_path / "law.py"), **chosen}
        record = gs.run("heave_step", {"loop.duration": 0.02, "controller": table})
        assert record.metadata["host"].startswith("compiled, ")
        error = record["reference.leg_length"] - record["measured.leg_length"]
        force = record["controller.force"] - record["controller.feedforward"]
        assert force[:-1] == pytest.approx(4e5 * error[:-1], abs=1e-6)


def test_operations_of_a_law_are_those_of_the_c_library() -> None:
    """Expected: NumPy's functions, at eight uneven points of each; CasADi's sign and comparison included."""
    x, y = casadi.SX.sym("leg_velocity", 6), casadi.SX.sym("leg_length", 6)
    made: dict[str, Any] = {
        "arcsin": casadi.asin, "arccos": casadi.acos, "arctan": casadi.atan, "sinh": casadi.sinh, "cosh": casadi.cosh,
        "arcsinh": casadi.asinh, "arctanh": casadi.atanh, "expm1": casadi.expm1, "log1p": casadi.log1p,
        "exp": casadi.exp, "sqrt": lambda v: casadi.sqrt(v + 2), "tan": casadi.tan, "floor": casadi.floor,
        "ceil": casadi.ceil, "fabs": casadi.fabs, "sign": casadi.sign, "sin": casadi.sin, "cos": casadi.cos,
        "tanh": casadi.tanh, "log": lambda v: casadi.log(v + 2),
    }  # fmt: skip
    own: dict[str, Any] = {"sqrt": lambda v: np.sqrt(v + 2), "log": lambda v: np.log(v + 2)}
    two: dict[str, Any] = {
        "arctan2": casadi.atan2,
        "fmod": casadi.fmod,
        "hypot": casadi.hypot,
        "copysign": casadi.copysign,
    }
    two |= {"fmin": casadi.fmin, "fmax": casadi.fmax, "less": lambda a, b: a < b, "not_equal": lambda a, b: a != b}
    terms = [of(x) for of in made.values()] + [of(x, y) for of in two.values()]
    terms.append(casadi.if_else(casadi.logic_and(x > 0.1, y > 0.2), x**3, casadi.remainder(x, y)))
    found = casadi.vertcat(*terms)
    n = found.numel()
    memory = casadi.SX.sym("memory", n)
    force = casadi.SX.zeros(6)
    names = ["leg_velocity", "leg_length", "memory"]
    law = casadi.Function("law", [x, y, memory], [force, found], names, ["actuator_force", "memory_next"])
    traced = traced_law_of([law])
    assert traced is not None
    library = libraries._library(traced.function.serialize())
    assert library is not None
    rng = np.random.default_rng(3)
    given = np.zeros((traced.function.numel_in(0), 8))
    first = n + 24
    velocity, length = (rng.uniform(-0.95, 0.95, (6, 8)) for _ in range(2))
    given[first + 18 : first + 24], given[first + 12 : first + 18] = velocity, length
    out = np.zeros((n + 6, 8))
    libraries.call(library, given, out)
    a, b = velocity, length
    expected = [(own[name] if name in own else getattr(np, name))(a) for name in made]
    expected += [getattr(np, name)(a, b) for name in two]
    expected.append(np.where((a > 0.1) & (b > 0.2), a**3, a - np.rint(a / b) * b))
    assert out[6:] == pytest.approx(np.concatenate(expected).astype(float), rel=1e-13, abs=1e-15)
