"""What an export says of itself: header, notes and archive as a whole, each number against a source of its own."""

import re
from types import SimpleNamespace
from typing import Any

import casadi
import numpy as np
import pytest

from gough_stewart import UnstableLoopError, load_experiment
from gough_stewart.harness.export.choices import faults_of
from gough_stewart.harness.export.design import Designed, designed
from gough_stewart.harness.export.notes import in_short, notes_of, refusal
from gough_stewart.harness.export.stability import Case, Delays, Host, LoopAround, LoopStability, StabilityReport
from gough_stewart.harness.export.write import controller_sources
from gough_stewart.model import interface
from tests.harness.export.test_controllers import CIRCLE, PD, PID, SINE
from tests.support.exported import KD, KP, uneven_experiment
from tests.support.uneven import UNEVEN

KI = [900.0, 500.0, 1100.0, 700.0, 1300.0, 400.0]
DRIVES = {"force_limit": 3000.0, "rate_limit": 8000.0}
PLATFORM = [
    *(("base_points", 18, "m"), ("platform_points", 18, "m"), ("platform_mass", 1, "kg")),
    *(("platform_com", 3, "m"), ("platform_inertia", 9, "kg.m2")),
    *((f"leg_{part}_mass", 1, "kg") for part in ("lower", "upper")),
    *((f"leg_{part}_com", 1, "m") for part in ("lower", "upper")),
    *((f"leg_{part}_inertia", 1, "kg.m2") for part in ("lower", "upper")),
    *(("leg_viscous_friction", 1, "N.s/m"), ("leg_coulomb_friction", 1, "N")),
    *(("leg_friction_velocity", 1, "m/s"), ("gravity", 3, "m/s2"), ("leg_armature", 1, "kg")),
    *((f"leg_{kind}_friction_factor", 6, "1") for kind in ("viscous", "coulomb")),
]


def made(space: str = "leg", **options: Any) -> Designed:
    controller = {**PID, "integral_gain": KI, "space": space, "feedforward": "gravity"}
    return designed(uneven_experiment(reference=SINE, controller=controller, actuators=DRIVES), **options)


def words(text: str) -> str:
    return " ".join(text.split())


def fields(header: str) -> list[tuple[str, int, str, str]]:
    """Name, size, unit and meaning of the members of the first struct, which are the parameters."""
    body = re.search(r"typedef struct \{\n(.*?)\n\} \w+_parameters;", header, re.S)
    assert body is not None
    found = re.findall(r"^    \w+_real (\w+)(?:\[(\d+)\])?; /\* (?:\[(\S+)\] )?(.*) \*/$", body[1], re.M)
    assert len(found) == len(body[1].splitlines())
    return [(name, int(size or 1), unit, text) for name, size, unit, text in found]


@pytest.mark.parametrize("space", ["leg", "task"])
def test_the_struct_of_parameters_has_types_units_and_meanings(space: str) -> None:
    """Expected: literal; the meanings of the platform's are those of the interface, its values are 0 for no limit."""
    sources = controller_sources(made(space), "loop_3")
    found = fields(sources.headers["loop_3.h"])
    of = "of each leg" if space == "leg" else "of each axis, three of force and three of torque"
    units = ("N/m", "N.s/m", "N/(m.s)") if space == "leg" else ("", "", "")
    own = [
        ("sample_time", 1, "s", "time from sample to sample"),
        ("delay", 1, "", "samples until a force acts; the feedforward is for half a sample later"),
        ("force_limit", 1, "N", "largest force of an actuator; 0: none"),
        ("force_rate_limit", 1, "N/s", "rate limit of the drives, for the anti-windup; 0: none"),
        ("start_force", 6, "N", "forces before the first sample, and while all inputs are zero"),
        ("proportional_gain", 6, units[0], f"proportional gain {of}"),
        ("derivative_gain", 6, units[1], f"derivative gain {of}"),
        ("derivative_filter", 1, "s", "time constant of the derivative filter"),
        ("integral_gain", 6, units[2], f"integral gain {of}"),
        ("anti_windup_time", 6, "s", "time constant of back-calculation at a limit"),
    ]
    assert found[:10] == own
    assert [each[:3] for each in found[10:]] == PLATFORM
    assert [each[3] for each in found[10:]] == [interface.BY_NAME[name].description for name, _, _ in PLATFORM]
    # the defaults, in the same order, each with a cast
    body = re.search(r"LOOP_3_DEFAULTS = \{\n(.*?)\n\};", sources.units["loop_3.c"], re.S)
    assert body is not None
    kp, kd, ki = map(np.array, (KP, KD, KI))
    values = {
        "sample_time": 0.0015,
        "delay": 2,
        "force_limit": 3000,
        "force_rate_limit": 8000,
        "proportional_gain": kp,
        "derivative_gain": kd,
        "derivative_filter": (kd / kp).min() / 20,
        "integral_gain": ki,
        "anti_windup_time": np.sqrt(kp / ki * kd / kp),
        "start_force": made(space).start_force,
        **{name: np.ravel(getattr(UNEVEN, name)) for name, _, _ in PLATFORM},
    }
    lines = body[1].splitlines()
    assert len(lines) == len(found)
    for line, (name, size, *_) in zip(lines, found, strict=True):
        assert line.endswith(f", /* {name} */")
        assert line.count("R(") == size
        numbers = re.sub(r"/\*.*?\*/|R\(|[){} ]", "", line).strip(",").split(",")
        np.testing.assert_allclose([float(each) for each in numbers], np.ravel(values[name]), rtol=1e-14, err_msg=name)


def test_the_ranges_of_inputs_are_those_of_the_documentation() -> None:
    """Expected: docs/export.md by hand: stroke and a tenth; where legs reach; what crosses all of it in a sample."""
    low, high = 2.3 - 0.16, 3.9 + 0.16
    reach = high + np.linalg.norm(UNEVEN.platform_points, axis=1)
    ends = [
        [function(each) for each in (UNEVEN.base_points + sign * reach[:, None]).T]
        for function, sign in ((max, -1), (min, 1))
    ]
    width, T, turn = np.subtract(ends[1], ends[0]), 0.0015, 2 * np.pi

    def said(name: str, low: Any, high: Any, unit: str) -> str:
        pairs = [f"{a:.6g} to {b:.6g}" for a, b in zip(low, high, strict=True)]
        return f"{name} {', '.join(pairs)} {unit}"

    rates = {"velocity": (width / T, "m/s"), "acceleration": (2 * width / T**2, "m/s2")}
    texts = {name: said(name, -size, size, unit) for name, (size, unit) in rates.items()}
    texts |= {
        "position": said("position", ends[0], ends[1], "m"),
        "orientation": said("orientation", [-turn, -turn / 4, -turn], [turn, turn / 4, turn], "rad"),
        "angular_velocity": said("angular_velocity", [-turn / T], [turn / T], "rad/s"),
        "angular_acceleration": said("angular_acceleration", [-2 * turn / T**2], [2 * turn / T**2], "rad/s2"),
    }
    order = ("position", "orientation", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    whole = f"leg_length {low:.6g} to {high:.6g} m; of the reference: {'; '.join(texts[name] for name in order)}."
    inside = controller_sources(made()).headers["controller.h"]
    outside = controller_sources(made(reference="inputs")).headers["controller.h"]
    assert f"Ranges: {words(whole)}" in words(outside)
    assert f"Ranges: leg_length {low:.6g} to {high:.6g} m. While" in words(inside)
    measured = made().ranges
    speed = measured.of(interface.BY_NAME["leg_velocity"])
    np.testing.assert_allclose([speed.low, speed.high], [np.full(6, -1.92 / T), np.full(6, 1.92 / T)])
    assert measured.is_of_stroke


def test_the_header_says_what_the_controller_is_and_does() -> None:
    """Expected: sentences by hand, for a reference that comes in, watched measurements and a safe force of zero."""
    faults = faults_of("zero", (7, 0.0025))
    header = words(controller_sources(made(reference="inputs", faults=faults), "loop_3").headers["loop_3.h"])
    for part in (
        "/* uneven: PID in leg space, feedforward: gravity. Generated by gough-stewart",
        "loop_3_step(&parameters, &coefficients, &memory, measured, reference, force, limited).",
        "enum { LOOP_3_N_MEASURED = 6, LOOP_3_N_REFERENCE = 18, LOOP_3_N_STATES = 12 };",
        "enum { LOOP_3_N_WATCHED = 6 };",
        "is the same for 7 samples while its reference moves by more than 0.0025 m */",
        "Computes a sample. `measured`: leg_length[6] [m], relative to home in single precision. `reference`: position",
        "extern const loop_3_real LOOP_3_HOME_POSE[6];",
        "As long as all inputs are exactly 0, no measurements have arrived",
        "all six forces are 0, within the force limit",
        "its integrals unchanged. */",
    ):
        assert part in header, part
    numbers = 35 + 74 + 12 + 2 * 24  # own parameters, the platform's, home, ends of ranges
    assert (
        f"Constants in flash: {8 * numbers + 24} bytes, besides those in the code; {4 * numbers + 24} in single"
        in header
    )
    safe = {
        "the feedforward, of the last good reference if that is the fault": made(reference="inputs"),
        "the feedforward": made(),
        "`start_force`, since there is no feedforward": designed(uneven_experiment(reference=SINE, controller=PD)),
    }
    for text, each in safe.items():
        found = words(controller_sources(each).headers["controller.h"])
        assert f"all six forces are {text}, within" in found
        assert "frozen measurements are not watched for */" in found
        assert "N_WATCHED" not in found


def test_a_function_and_forces_without_feedback_are_called_what_they_are() -> None:
    """Expected: the memory of a function is kept over a gap; nothing is measured in an open loop, and nothing waits."""
    length, memory = casadi.SX.sym("length", 6), casadi.SX.sym("memory", 2)
    names = ["leg_length", "memory"], ["actuator_force", "memory_next"]
    law = casadi.Function("law", [length, memory], [length * memory[1], memory + 1], *names)
    header = words(
        controller_sources(designed(uneven_experiment(reference=SINE, controller=PD), law)).headers["controller.h"]
    )
    assert "uneven: a CasADi function, feedforward: none." in header
    assert "its integrals unchanged, or with its memory. */" in header
    assert "CONTROLLER_N_STATES = 2 };" in header
    open_loop = {"type": "open_loop", "feedforward": "computed_torque", "force": [1, -2, 3, -4, 5, -6]}
    sources = controller_sources(designed(uneven_experiment(reference=CIRCLE, controller=open_loop)))
    header = words(sources.headers["controller.h"])
    assert "uneven: no feedback, feedforward: computed torque." in header
    assert "CONTROLLER_N_MEASURED = 0, CONTROLLER_N_REFERENCE = 0, CONTROLLER_N_STATES = 0 };" in header
    assert "`measured`: nothing." in header
    assert "Ranges: none, since nothing comes in." in header
    assert "no measurements have arrived" not in header
    assert "controller_real constant_force[6]; /* [N] added to the feedforward */" in header
    assert "N_STATES = 24 }" in controller_sources(made("task")).headers["controller.h"]


def test_operations_are_counted_by_kind() -> None:
    """Expected, by hand: of six forces 2 products, 2 sums, a root, a sine; 5 quotients of a divisor, which C has once.

    Besides them two bounds of each force and whether they act, and code by hand: sums and checks of six forces, of six
    measurements and six forces of the law.
    """
    length = casadi.SX.sym("length", 6)
    force = 3 * casadi.sqrt(length) + 4 * casadi.sin(length) + length / length[0]
    law = casadi.Function("law", [length], [force], ["leg_length"], ["actuator_force"])
    made = designed(uneven_experiment(reference=CIRCLE, controller={"type": "open_loop"}), law, reference="inputs")
    sources = controller_sources(made)
    stated = re.search(
        r"at most (\d+) floating-point operations, of them (\d+) divisions and square roots, (\d+) other functions",
        words(sources.headers["controller.h"]),
    )
    assert stated is not None
    assert (int(stated[2]), int(stated[3])) == (6 + 1, 6)
    of_law, of_limits, by_hand = 6 * (2 + 2 + 1 + 1) + 5 + 1, 6 * 3, 6 * 8 + 2 * 12
    assert int(stated[1]) == sources.operations == of_law + of_limits + by_hand


# --- notes -----------------------------------------------------------------------------------------------------------


def _margins(alpha: float) -> Any:
    legs = [
        SimpleNamespace(gain_up=g, gain_down=d, phase=p, delay=t)
        for g, d, p, t in ((3.5, 0.2, 0.9, 0.004), (2.5, 0.4, 0.7, 0.006), (3.1, 0.3, 0.8, 0.0025))
    ]
    disk = SimpleNamespace(alpha=alpha, gain=(0.4, 2.2), phase=0.6)
    return SimpleNamespace(disk=disk, legs=legs)


def _case(what: str, size: float, delay: int = 2, lag: float = 0.0, frequency: float = 12.5) -> Case:
    return Case(what, Delays(delay, lag), complex(-0.6 * size, 0.8 * size), frequency)


def _loop(where: str, size: float = 0.91, **changes: Any) -> LoopStability:
    values: dict[str, Any] = {
        "surroundings": LoopAround(where, 0),
        "nominal": _case("the nominal machine in its first pose", size, lag=0.003),
        "poses": 25,
        "on_the_way": _case("the nominal machine in its pose at 0.7 s", 0.93, frequency=14.0),
        "changed": (_case("the machine after its change at 2 s", 0.94, frequency=15.0),),
        "members": 40,
        "impossible": 3,
        "unstable": 0,
        "worst": _case("member 17", 0.97, delay=3, lag=0.004, frequency=16.0),
        "margins": _margins(0.8),
        "margins_of_worst": (_case("member 4", 0.96, delay=1), _margins(0.5)),
        "remedy": "",
    }
    return LoopStability(**values | changes)


def test_notes_say_all_that_was_judged() -> None:
    """Expected: the whole text by hand, from made-up numbers of which no two are alike."""
    experiment = load_experiment("heave_step", {"loop.delay": 2, "loop.jitter": 1e-4, "sensors.quantisation": {}})
    notes = notes_of(experiment, "c", StabilityReport((_loop("in C"),)))
    margins = "gains × 0.4 to 2.2, phases ± 34.4°; one leg at a time gain × 0.4 to 2.5, phase 40.1°, delay 2.5 ms."
    assert notes.inside == (
        "Delay: a step computes its forces at once; the experiment has a delay of 2 samples from measurement to "
        "force, and the machine should have the same.",
        "Stability in C with a delay of 2 samples and a lag of 3 ms: stable; the nominal machine in its first pose "
        "|z| = 0.91 (12.5 Hz); along the motion at most |z| = 0.93 (14 Hz) (25 poses); the machine after its change "
        "at 2 s |z| = 0.94 (15 Hz); 40 members of [ensemble] at most |z| = 0.97 (16 Hz) (member 17, with a delay of 3 "
        "samples and a lag of 4 ms); impossible members, which are not judged: 3.",
        "Margins of the nominal machine in its first pose with a delay of 2 samples and a lag of 3 ms: all legs at "
        f"once disk margin 0.8, {margins}",
        f"Margins of member 4 with a delay of 1 sample: all legs at once disk margin 0.5, {margins}",
        "Judged by the eigenvalues z of the sampled loop, linearised at rest, without Coulomb friction and limits. "
        "Of what is left out, only a lag, a sensors' clock and jitter that are named here were part of it.",
        "Left out: loop.jitter.",
    )
    assert notes.warnings == ("the C is without loop.jitter: it is the controller alone, not the machine around it",)
    assert in_short(_loop("in C")) == (
        "stable in C with a delay of 3 samples and a lag of 4 ms: |z| = 0.97 (member 17), disk margin 0.5"
    )


LATER = "the unit outputs the forces of a sample one sample later (output_delay = 1). The experiment has"
ACTS = "forces act {} after their measurement (output_delay = {}); the experiment has"
DELAYS: dict[tuple[Host, int], str] = {
    ("fmu", 0): f"{LATER} no delay; the feedforward is computed for 1 sample.",
    ("fmu", 3): f"{LATER} a delay of 3 samples; the feedforward is computed for 3 samples. The other 2 samples have "
    "to be around the unit.",
    ("ssp", 0): f"{ACTS.format('1 sample', 1)} no delay, but a unit needs one sample.",
    ("ssp", 3): f"{ACTS.format('3 samples', 3)} a delay of 3 samples.",
}


@pytest.mark.parametrize(("host", "delay"), DELAYS)
def test_notes_say_what_delay_a_form_has(host: Host, delay: int) -> None:
    experiment = load_experiment("heave_step", {"loop.delay": delay, "sensors.quantisation": {}})
    notes = notes_of(experiment, host, StabilityReport(reason="there is no feedback"))
    steps = " This holds for communication steps of a sample or less; longer ones add delay."
    unjudged = "Stability: not judged, since there is no feedback."
    assert notes.inside == (f"Delay: {DELAYS[host, delay]}{steps}", unjudged, "Nothing of the experiment is left out.")
    late = "one sample late, where the experiment has no delay: a unit outputs the forces of a sample at the next one"
    assert notes.warnings == (() if delay else (f"the {host.upper()} is {late}",))


def test_an_unstable_loop_is_refused_with_its_figures_and_remedies() -> None:
    """Expected: every loop once, the remedies after them, and the eigenvalue of the first loop."""
    experiment = load_experiment("heave_step")
    first = _loop("in C", 1.25, remedy="halve the gains", unstable=2)
    second = _loop("in the SSP", worst=_case("member 8", 1.5, frequency=21.0), unstable=1, remedy="", margins=None)
    third = _loop("with the FMU")
    error = refusal(
        experiment,
        [
            ("c", StabilityReport((first,))),
            ("fmu", StabilityReport((third,))),
            ("ssp", StabilityReport((second, third))),
        ],
    )
    assert isinstance(error, UnstableLoopError)
    assert str(error) == (
        "experiment 'heave_step': in C the closed loop is unstable with a delay of 2 samples and a lag of 3 ms: |z| "
        "= 1.25 at 12.5 Hz for the nominal machine in its first pose, expected below 1 (2 of 40 members are unstable); "
        "in the SSP the closed loop is unstable with a delay of 2 samples: |z| = 1.5 at 21 Hz for member 8, expected "
        "below 1 (1 of 40 members are unstable); halve the gains; "
        "--allow-unstable (allow_unstable=True) exports it, with a note inside"
    )
    assert error.eigenvalue == pytest.approx(complex(-0.75, 1.0))
    in_a_run = refusal(experiment, [("run", StabilityReport((first,)))])
    assert str(in_a_run).endswith("; halve the gains; --allow-unstable runs it")
    assert refusal(experiment, [("c", StabilityReport((third,)))]) is None
    notes = notes_of(experiment, "ssp", StabilityReport((second,)))
    assert notes.inside[1].startswith(
        "Stability in the SSP with a delay of 2 samples and a lag of 3 ms: UNSTABLE, and exported on request: in the "
        "SSP the"
    )
    assert notes.warnings[-1].startswith("exported on request: in the SSP the closed loop is unstable with")
    assert in_short(second).startswith(
        "UNSTABLE in the SSP with a delay of 2 samples: |z| = 1.5 (member 8), disk margin 0.5"
    )
    assert (
        notes_of(experiment, "run", StabilityReport((first,)))
        .warnings[-1]
        .startswith("run on request: in C the closed")
    )
