"""What an export says of itself: names, header, notes, what it leaves out; each number against a source of its own."""

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.exported import CIRCLE, HOLD, KD, KP, PD, PID, SINE, source_of, uneven_experiment, words_of
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


def written(space: str = "leg", **options: Any) -> Path:
    """The source of a PID with every limit."""
    controller = {**PID, "integral_gain": KI, "space": space, "feedforward": "gravity"}
    return source_of(uneven_experiment(reference=SINE, controller=controller, actuators=DRIVES), **options)


def header_of(source: Path) -> str:
    """Its header in one line."""
    return words_of(source.with_suffix(".h"))


def test_the_struct_of_parameters_has_types_units_and_meanings() -> None:
    """Expected: literal; the meanings of the platform's are those of `VARIABLES`, its values are 0 for no limit."""
    meanings = {v.name: v.description for v in gs.VARIABLES}
    for space in ("leg", "task"):
        source = written(space)
        text = source.with_suffix(".h").read_text()
        body = re.search(r"typedef struct \{\n(.*?)\n\} \w+_parameters;", text, re.S)
        assert body is not None
        rows = re.findall(r"^    \w+_real (\w+)(?:\[(\d+)\])?; /\* (?:\[(\S+)\] )?(.*) \*/$", body[1], re.M)
        assert len(rows) == len(body[1].splitlines())
        found = [(name, int(size or 1), unit, meaning) for name, size, unit, meaning in rows]
        of = "of each leg" if space == "leg" else "of each axis, three of force and three of torque"
        units = ("N/m", "N.s/m", "N/(m.s)") if space == "leg" else ("", "", "")
        assert found[:10] == [
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
        assert found[10:] == [(*row, meanings[row[0]]) for row in PLATFORM]
        # the defaults, in the same order, each with a cast
        defaults = re.search(r"_DEFAULTS = \{\n(.*?)\n\};", source.read_text(), re.S)
        assert defaults is not None
        kp, kd, ki = map(np.array, (KP, KD, KI))
        values = {
            "sample_time": 0.0015, "delay": 2, "force_limit": 3000, "force_rate_limit": 8000,
            "proportional_gain": kp, "derivative_gain": kd, "derivative_filter": (kd / kp).min() / 20,
            "integral_gain": ki, "anti_windup_time": np.sqrt(kp / ki * kd / kp),
            **{name: np.ravel(getattr(UNEVEN, name)) for name, _, _ in PLATFORM},
        }  # fmt: skip
        for line, (name, size, *_) in zip(defaults[1].splitlines(), found, strict=True):
            assert line.endswith(f", /* {name} */")
            assert line.count("R(") == size
            numbers = re.sub(r"/\*.*?\*/|R\(|[){} ]", "", line).strip(",").split(",")
            if name in values:
                np.testing.assert_allclose(np.array(numbers, dtype=float), np.ravel(values[name]), rtol=1e-14)


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

    texts = [
        said("position", ends[0], ends[1], "m"),
        said("orientation", [-turn, -turn / 4, -turn], [turn, turn / 4, turn], "rad"),
        said("velocity", -width / T, width / T, "m/s"),
        said("angular_velocity", [-turn / T], [turn / T], "rad/s"),
        said("acceleration", -2 * width / T**2, 2 * width / T**2, "m/s2"),
        said("angular_acceleration", [-2 * turn / T**2], [2 * turn / T**2], "rad/s2"),
    ]
    lengths = f"leg_length {low:.6g} to {high:.6g} m"
    assert f"Ranges: {lengths}; of the reference: {'; '.join(texts)}." in header_of(written(reference="inputs"))
    assert f"Ranges: {lengths}. While" in header_of(written())


def test_the_header_says_what_the_controller_is_and_does() -> None:
    """Expected: sentences by hand, for a reference that comes in, watched measurements and a safe force of zero."""
    header = header_of(written(reference="inputs", safe_force="zero", frozen=(7, 0.0025)))
    for part in (
        "/* uneven: PID in leg space, feedforward: gravity. Generated by gough-stewart",
        "_step(&parameters, &coefficients, &memory, measured, reference, force, limited).",
        "_N_MEASURED = 6, EXPERIMENT_CONTROLLER_N_REFERENCE = 18, EXPERIMENT_CONTROLLER_N_STATES = 12 };",
        "enum { EXPERIMENT_CONTROLLER_N_WATCHED = 6 };",
        "is the same for 7 samples while its reference moves by more than 0.0025 m */",
        "Computes a sample. `measured`: leg_length[6] [m], relative to home in single precision. `reference`: position",
        "As long as all inputs are exactly 0, no measurements have arrived",
        "all six forces are 0, within the force limit",
        "its integrals unchanged. */",
    ):
        assert part in header, part
    numbers = 35 + 74 + 12 + 2 * 24  # own parameters, the platform's, home, ends of ranges
    flash = f"Constants in flash: {8 * numbers + 24} bytes, besides those in the code; {4 * numbers + 24} in single"
    assert flash in header
    without = source_of(uneven_experiment(reference=SINE, controller=PD))
    assert "R(0.0), /* force_rate_limit */" in without.read_text()
    for text, source in {
        "the feedforward, of the last good reference if that is the fault": written(reference="inputs"),
        "the feedforward": written(),
        "`start_force`, since there is no feedforward": without,
    }.items():
        found = header_of(source)
        assert f"all six forces are {text}, within" in found
        assert "frozen measurements are not watched for */" in found
        assert "N_WATCHED" not in found
    assert "N_STATES = 24 }" in header_of(written("task"))


def test_a_function_and_forces_without_feedback_are_called_what_they_are() -> None:
    """Expected: the memory of a function is kept over a gap; nothing is measured in an open loop, and nothing waits."""
    length, memory = casadi.SX.sym("length", 6), casadi.SX.sym("memory", 2)
    names = ["leg_length", "memory"], ["actuator_force", "memory_next"]
    law = casadi.Function("law", [length, memory], [length * memory[1], memory + 1], *names)
    header = header_of(source_of(uneven_experiment(reference=SINE, controller=PD), law))
    assert "uneven: a CasADi function, feedforward: none." in header
    assert "its integrals unchanged, or with its memory. */" in header
    assert "_N_STATES = 2 };" in header
    open_loop = {"type": "open_loop", "feedforward": "computed_torque", "force": [1, -2, 3, -4, 5, -6]}
    title = "nice */ int x; /* title"
    header = header_of(source_of(uneven_experiment(title=title, reference=CIRCLE, controller=open_loop)))
    assert "nice int x; title: no feedback, feedforward: computed torque." in header
    assert "int x" in header[: header.index("*/")]
    assert re.search(r"_N_MEASURED = 0, \w+_N_REFERENCE = 0, \w+_N_STATES = 0 };", header)
    assert "`measured`: nothing." in header
    assert "Ranges: none, since nothing comes in." in header
    assert "no measurements have arrived" not in header
    assert "_real constant_force[6]; /* [N] added to the feedforward */" in header


def test_operations_are_counted_by_kind() -> None:
    """By hand: of six forces 2 products, 2 sums, a root, a sine; 5 quotients of a divisor, which C has once."""
    # besides two bounds of each force, whether they act, and sums and checks of six forces, measurements and the law's
    length = casadi.SX.sym("length", 6)
    force = 3 * casadi.sqrt(length) + 4 * casadi.sin(length) + length / length[0]
    law = casadi.Function("law", [length], [force], ["leg_length"], ["actuator_force"])
    experiment = uneven_experiment(reference=CIRCLE, controller={"type": "open_loop"})
    stated = re.search(
        r"at most (\d+) floating-point operations, of them (\d+) divisions and square roots, (\d+) other functions",
        header_of(source_of(experiment, law, reference="inputs")),
    )
    assert stated is not None
    assert (int(stated[2]), int(stated[3])) == (6 + 1, 6)
    of_law, of_limits, by_hand = 6 * (2 + 2 + 1 + 1) + 5 + 1, 6 * 3, 6 * 8 + 2 * 12
    assert int(stated[1]) == of_law + of_limits + by_hand


def test_notes_say_all_that_was_judged(tmp_path: Path) -> None:
    """Expected: the whole text by hand, with the numbers of the loop that `stability` is called with."""
    settings = {
        "loop.delay": 2, "loop.jitter": 5e-4, "loop.plant_step": 5e-4, "sensors.quantisation": {}, "loop.duration": 3,
        "actuators.lag": 0.003, "change": [{"at": 2.0, "factors": {"platform_mass": 1.2}}],
        "ensemble": {"members": 3, "platform_mass": {"grid": [900.0, -5.0, 800.0]},
                     "actuators.lag": {"choice": [0.004, 0.005]}},
    }  # fmt: skip
    said, loops, verdicts = list[str](), list[Any](), list[str]()
    files = gs.export("pitch_sine", settings, forms="c", out=tmp_path, warn=said.append, stability=loops.extend,
                      verdict=verdicts.append, allow_unstable=True)  # fmt: skip
    (loop,) = loops
    late = "with a delay of 2 samples, up to 0.5 ms by the sensors' clock and jitter and a lag of"

    def margins(case: Any, found: Any) -> str:
        disk, legs, lag = found.disk, found.legs, round(1000 * case.loop.lag)
        up, down = min(leg.gain_up for leg in legs), max(leg.gain_down for leg in legs)
        phase, delay = min(leg.phase for leg in legs), min(leg.delay for leg in legs)
        return (
            f"Margins of {case.what} {late} {lag} ms: all legs at once disk margin {disk.alpha:.3g}, gains x "
            f"{disk.gain[0]:.3g} to "
            f"{disk.gain[1]:.3g}, phases +- {np.degrees(disk.phase):.3g} deg; one leg at a time gain x {down:.3g} to "
            f"{up:.3g}, phase {np.degrees(phase):.3g} deg, delay {1000 * delay:.3g} ms."
        )

    def size(case: Any) -> str:
        return f"|z| = {case.size:.5g} ({case.frequency:.3g} Hz)"

    expected = (
        "The loop: - Delay: a step computes its forces at once; the experiment has a delay of 2 samples from "
        "measurement to force, and the machine should have the same. "
        f"- Stability in C {late} 3 ms: stable; the nominal machine in its first pose {size(loop.nominal)}; along the "
        f"motion at most {size(loop.on_the_way)} ({loop.poses} poses); the machine after its change at 2 s "
        f"{size(loop.changed[0])}; 2 members of [ensemble] at most {size(loop.worst)} ({loop.worst.what}, {late} "
        f"{1000 * loop.worst.loop.lag:.3g} ms); impossible members, which are not judged: 1. "
        f"- {margins(loop.nominal, loop.margins)} "
        f"- {margins(*loop.margins_of_worst)} "
        "- Judged by the eigenvalues z of the sampled loop, linearised at rest, without Coulomb friction and limits. "
        "Of what is left out, only a lag, a sensors' clock and jitter that are named here were part of it. "
        "- Left out: loop.jitter, actuators.lag, change"
    )
    assert expected in words_of(files[1])
    (line,) = said
    assert line.startswith("the C is without loop.jitter, actuators.lag, change: it is the controller alone, not")
    worst = loop.worst if loop.worst.size > loop.changed[0].size else loop.changed[0]
    alpha = min(loop.margins.disk.alpha, loop.margins_of_worst[1].disk.alpha)
    assert verdicts[0].startswith("stable in C with a delay of 2 samples")
    assert verdicts[0].endswith(f"|z| = {worst.size:.5g} ({worst.what}), disk margin {alpha:.3g}")


DELAYS: dict[Any, str] = {
    ("fmu", 2): "the unit outputs the forces of a sample one sample later (output_delay = 1). The experiment has a "
    "delay of 2 samples; the feedforward is computed for 2 samples. The rest, 1 sample, has to be around the unit.",
    ("ssp", 0): "forces act 1 sample after their measurement (output_delay = 1); the experiment has no delay, but a "
    "unit needs one sample.",
}


def test_notes_say_what_delay_a_form_has(tmp_path: Path) -> None:
    """Expected: by hand, in the page of each unit and system."""
    for (form, delay), text in DELAYS.items():
        settings = {"loop.delay": delay, "sensors.quantisation": {}, "controller.bandwidth": 2}
        (path,) = gs.export("heave_step", settings, forms=form, fmi=["2.0"], out=tmp_path)
        with zipfile.ZipFile(path) as archive:
            page = archive.read("documentation/index.html").decode()
            if form == "fmu":
                start = re.search(r'name="output_delay".*?start="(.*?)"', str(archive.read("modelDescription.xml")))
                assert start is not None
                assert float(start[1]) == 1
        steps = " This holds for communication steps of a sample or less; longer ones add delay."
        assert f"Delay: {text}{steps}" in page
        assert "Nothing of the experiment is left out." in page


def test_the_command_reports_forms_and_the_least_robust_loop(tmp_path: Path) -> None:
    """Expected: the verdict by hand; numbers of `gs.margins`, the least robust loop first; no margins if unstable."""

    def told(*words: str) -> tuple[str, dict[str, float], list[Any]]:
        done = invoke("export", *words, "--json", "--out", str(tmp_path))
        assert done.exit_code == 0, done.output
        data = json.loads(done.stdout)
        rows = [row for section in data.get("sections", []) for part in section["parts"] for row in part["rows"]]
        return data["verdict"]["text"], {each["path"]: each["value"] for each in data["numbers"]}, rows

    text, numbers, rows = told("heave_step", "--as", "c,ssp", "--set", "loop.delay=0")
    assert text.startswith("Written as C and SSP; stable in both loops that it is made for; least robust: in the SSP")
    a, of_c = (gs.margins("heave_step", {"loop.delay": delay}).disk.alpha for delay in (1, 0))
    assert [row[:3] for row in rows] == [["in the SSP", "stable", 1], ["in C", "stable", 0]]
    assert [row[5] for row in rows] == pytest.approx([a, of_c], rel=1e-6)
    gain, phase = 20 * np.log10((1 + a / 2) / (1 - a / 2)), 2 * np.arctan(a / 2)
    names = ("files", "stability.largest_eigenvalue", "margins.disk", "margins.disk_gain", "margins.disk_phase")
    assert numbers == pytest.approx(
        dict(zip(names, (4, max(row[3] for row in rows), a, gain, phase), strict=True)), rel=1e-6
    )
    text, numbers, rows = told("too_slow", "--as", "c", "--allow-unstable")
    assert text.startswith("Written as C; UNSTABLE in C with no delay: |z| = 2.1632")
    assert numbers["stability.largest_eigenvalue"] == pytest.approx(2.1632, abs=1e-4)
    assert [numbers[name] for name in names[2:]] == [0, 0, 0]
    assert (rows[0][:3], rows[0][5]) == (["in C", "UNSTABLE", 0], 0)
    open_loop = ["--set", "controller={type='open_loop',feedforward='gravity'}"]
    text, numbers, _ = told("pitch_sine", "--as", "c", *open_loop)
    assert (text, numbers) == ("Written as C; no loop was judged for stability", {"files": 3})


AROUND: dict[str, Any] = {
    "sensors.noise.leg_velocity": 1e-3,
    "sensors.sample_time": 0.002,
    "sensors.seed": 7,
    "sensors.side": "motor",
    "actuators.lag": 0.002,
    "actuators.rate_limit": 1e5,
    "actuators.force_limit": 9e3,
    "loop.jitter": 0.0005,
    "loop.plant_step": 0.0005,
    "limits.position_error": 0.2,
    "limits.reference": "warn",
    "injection": {"type": "multisine", "leg": 2, "amplitude": 20.0, "band": [10.0, 40.0], "period": 0.1},
    "loop.duration": 0.5,
    "disturbance": [{"at": 0.1, "duration": 0.1, "force": [1, 2, 3]}],
    "fault": [{"at": 0.2, "cut": [3]}],
    "change": [{"at": 0.3, "factors": {"platform_mass": 1.2}}],
    "plant.parameters.platform_mass": 900.0,
    "ensemble.members": 1,
    "ensemble.leg_viscous_friction": {"uniform": [1, 2]},
    "ensemble.leg_armature": {"uniform": [1, 2]},
    "ensemble.loop.delay": {"choice": [0, 2]},
    "ensemble.controller.bandwidth": {"uniform": [1, 2]},
    "ensemble.sensors.quantisation.leg_length": {"uniform": [0, 1e-5]},
    "ensemble.sensors.noise.leg_length": {"uniform": [0, 1e-5]},
}
EVERYWHERE = {
    *("actuators.lag", "actuators.rate_limit", "change", "disturbance", "ensemble.controller.bandwidth"),
    *("ensemble.loop.delay", "fault", "injection", "limits.position_error", "loop.jitter", "sensors.noise"),
    *("sensors.quantisation", "sensors.sample_time"),
}


def without(said: list[str]) -> list[set[str]]:
    """What warnings say that forms are without."""
    texts = (line.partition(" is without ")[2].partition(": it ")[0] for line in said if " is without " in line)
    return [set(text.split(", ")) for text in texts]


def test_everything_around_the_controller_is_named_and_nothing_else(tmp_path: Path) -> None:
    """Expected: the keys above, but for those of simulation, of the design, and of a plant where there is none."""
    said: list[str] = []
    options: dict[str, Any] = {"allow_unstable": True, "warn": said.append}
    files = gs.export("heave_step", AROUND, forms=["c", "ssp"], out=tmp_path, **options)
    found = without(said)
    # an SSP has the side of the encoders, but one machine only
    assert found == [EVERYWHERE | {"sensors.side"}, EVERYWHERE | {"ensemble (its other machines)"}]
    with zipfile.ZipFile(files[-1]) as archive:
        page = archive.read("documentation/index.html").decode()
        assert "ensemble (its other machines)" in page
        assert "Left out: " in archive.read("SystemStructure.ssd").decode()
    assert "ensemble (its other machines)" not in words_of(files[1])
    said.clear()
    quiet: dict[str, Any] = {"forms": "c", "out": tmp_path}
    gs.export("circle", {"limits.stroke": "ignore"}, **quiet, **options)
    assert without(said) == []
    gs.export("circle", {"limits.stroke": "stop"}, **quiet, **options)
    assert without(said) == [{"limits.stroke"}]


def test_names_of_files_become_identifiers(tmp_path: Path) -> None:
    """Expected: of the experiment's file, or of its title without one; the files of each form."""
    experiment = 'title = "a loop"\n[loop]\nduration = 1\n[controller]\ntype = "open_loop"\n'
    for file, name in {
        "My Loop-2.toml": "my_loop_2",
        "3rd try.toml": "loop_3rd_try",
        "ährenfeld.toml": "hrenfeld",
        "a_name_that_is_much_longer_than_c_likes.toml": "a_name_that_is_much_long",
    }.items():
        (tmp_path / file).write_text(experiment)
        (page,) = gs.export(tmp_path / file, forms="page", out=tmp_path)
        assert page.name == f"{name}_live.html"
    made = gs.Experiment.model_validate(
        {"title": "Some Loop", "loop": {"duration": 1.0}, "controller": {"type": "open_loop"}}
    )
    assert gs.export(made, forms="page", out=tmp_path)[0].name == "some_loop_live.html"


def test_forms_come_once_and_in_order(tmp_path: Path) -> None:
    """Expected: by the documentation; another form is refused, and nothing is written."""
    files = gs.export(uneven_experiment(reference=HOLD, controller=PD), forms=["c", "fmu", "c"], fmi=["2.0"],
                      out=tmp_path, allow_unstable=True)  # fmt: skip
    assert [file.suffix for file in files] == [".c", ".h", ".c", ".fmu"]
    for forms, message in {
        (): "no form; expected one or more of fmu, c, ssp, page",
        "clocked": "'clocked'; expected one of fmu, c, ssp, page; the unit without a clock serves",
        3: "forms is 3; expected one or more of fmu, c, ssp",
    }.items():
        with pytest.raises(gs.GoughStewartError, match=message):
            gs.export("circle", forms=forms, out=tmp_path / "none")  # type: ignore[arg-type]
    assert not (tmp_path / "none").exists()
