"""Stability of exported loops: figures against an independent formulation, and against runs of what is exported.

`radius` builds the sampled closed loop from python-control's c2d of the linear plant, with every delayed force and
every drive as states of their own; the harness multiplies transfer functions. Growth is seen in FMPy and compiled C.
"""

import itertools
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi
import control
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from numpy.typing import NDArray

import gough_stewart as gs
from gough_stewart import (
    LinearController,
    Platform,
    State,
    UnstableLoopError,
    leg_geometry,
    leg_jacobian,
    static_leg_forces,
)
from gough_stewart.harness.control.loop_margins import loop_margins
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.ensemble.chunk import margins_of
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.export.design import designed
from gough_stewart.harness.export.notes import notes_of
from gough_stewart.harness.export.stability import Host, LoopStability, StabilityReport, Tally, stability_of
from gough_stewart.harness.plants import signals
from gough_stewart.harness.plants.open import ModelPlant
from tests.harness.export.test_controllers import PID
from tests.support.exported import Exported, uneven_experiment
from tests.support.uneven import UNEVEN

HOSTS: tuple[Host, ...] = ("c", "fmu", "ssp")


def radius(prepared: Prepared, delay: int, lag: float = 0.0, machine: Platform | None = None, row: int = 0) -> float:
    """The largest |z| of x⁺ = A x + B f, f = the force of `delay` samples ago behind its drive, u = −C_c ξ − D_c y."""
    machine, motion, linear = machine or prepared.machine, prepared.motion, prepared.controller
    assert motion is not None
    assert isinstance(linear, LinearController)
    T, K = prepared.loop.timing.sample_time, linear.system
    pose = motion.position[row], motion.orientation[row]
    free = gs.linearise(machine, *pose, outputs=linear.signals)
    A, B, C = free.A, free.B[:, :6], free.C
    if lag:  # the drives' forces behind the plant's states
        A = np.block([[A, B], [np.zeros((6, 12)), -np.eye(6) / lag]])
        B = np.concatenate([np.zeros((12, 6)), np.eye(6) / lag])
        C = np.concatenate([C, np.zeros((len(C), 6))], axis=1)
    plant = control.c2d(control.ss(A, B, C, np.zeros((len(C), 6))), T)
    n, m, k = len(plant.A), len(C), K.nstates
    # of errors −y, or of references 0 and measurements y
    of_y = slice(0, m), -1.0
    if K.ninputs > m:
        of_y = slice(m, 2 * m), 1.0
    Bc, Dc = of_y[1] * K.B[:, of_y[0]], of_y[1] * K.D[:, of_y[0]]
    Cc = K.C
    if linear.space == "task":
        J = np.linalg.inv(leg_jacobian(prepared.platform, *pose))
        Bc, Dc, Cc = Bc @ J, J.T @ Dc @ J, J.T @ Cc
    size = n + k + 6 * delay
    whole = np.zeros((size, size))
    x, xi = slice(0, n), slice(n, n + k)
    whole[x, x], whole[xi, x], whole[xi, xi] = plant.A, Bc @ plant.C, K.A
    command = np.zeros((6, size))
    command[:, x], command[:, xi] = Dc @ plant.C, Cc
    if not delay:
        whole[x] += plant.B @ command
    else:
        line = [slice(n + k + 6 * i, n + k + 6 * (i + 1)) for i in range(delay)]
        whole[line[0]] = command
        for younger, older in itertools.pairwise(line):
            whole[older, younger] = np.eye(6)
        whole[x, line[-1]] = plant.B
    return float(np.abs(np.linalg.eigvals(whole)).max())


def found_of(name: str, host: Host, settings: Any = (), **options: Any) -> tuple[LoopStability, ...]:
    experiment = gs.load_experiment(name, settings)
    return stability_of(experiment, prepare(experiment), (host,), margins=False, **options)[host].loops


@pytest.mark.parametrize(
    ("name", "host", "size"),
    [
        ("circle", "c", None),
        ("circle", "ssp", 1.0505),
        ("circle_computed_torque", "fmu", 1.0505),
        ("payload_change", "fmu", 1.006),
        ("payload_change", "ssp", 1.006),
        ("payload_change", "c", None),
        ("too_slow", "c", 2.16),
        ("pitch_sine", "ssp", None),
        ("saturation", "c", None),
    ],
)
def test_shipped_loops_have_the_eigenvalues_of_another_formulation(name: str, host: Host, size: float | None) -> None:
    """Expected: `radius`; and, for those that are unstable, literal figures that were measured by another program."""
    (loop, *_), prepared = found_of(name, host), prepare(gs.load_experiment(name))
    assert loop.nominal.loop.delay == (0 if host == "c" else 1)
    at = loop.nominal.loop[:2]
    assert loop.nominal.size == pytest.approx(radius(prepared, *at), abs=1e-7)
    assert loop.is_stable == (size is None)
    if size is not None:
        assert loop.nominal.size == pytest.approx(size, abs=5e-3 if size > 2 else 5e-4)
    rows = np.unique(np.linspace(0, prepared.loop.timing.steps, 25).round().astype(int)).tolist()
    assert loop.on_the_way.size == pytest.approx(max(radius(prepared, *at, row=row) for row in rows), abs=1e-7)


@pytest.mark.parametrize("space", ["leg", "task"])
@pytest.mark.parametrize("derivative_on", ["error", "measurement"])
def test_a_machine_that_is_not_what_is_believed_is_the_one_that_is_judged(space: str, derivative_on: str) -> None:
    """Expected: `radius` of the machine with the Jacobian of the belief, with drives, for every form's own delay."""
    machine = {"platform_mass": 7.0, "platform_com": [0.1, 0.2, -0.05], "leg_viscous_friction": 3.0}
    machine["platform_points"] = (np.array(UNEVEN.platform_points) * 1.07).tolist()
    experiment = uneven_experiment(
        reference={"type": "sine", "position_amplitude": [0.03, -0.02, 0.04], "frequency": 4.0},
        controller={**PID, "integral_gain": [900.0, 0.0, 1100.0, 700.0, 1300.0, 400.0], "space": space,
                    "derivative_on": derivative_on},
        plant={"parameters": machine},
        actuators={"lag": 0.003},
    )  # fmt: skip
    prepared = prepare(experiment)
    found = stability_of(experiment, prepared, HOSTS, margins=False)
    loops = [
        (loop.nominal.loop.delay, loop.nominal.loop.lag, loop.nominal.size)
        for host in HOSTS
        for loop in found[host].loops
    ]
    # a delay of two samples: the C and the FMU in the experiment's loop, the FMU alone, and the SSP without drives
    expected = [(2, 0.003), (2, 0.003), (1, 0.0), (2, 0.0)]
    assert [loop[:2] for loop in loops] == expected
    for delay, lag, size in loops:
        assert size == pytest.approx(radius(prepared, delay, lag), abs=1e-7)
    assert len({round(size, 9) for *_, size in loops}) == 3


def test_a_machine_is_judged_after_each_of_its_changes() -> None:
    """Expected: `radius` of the heavier machine, then of the same with more friction; an SSP has no changes."""
    changes = [
        {"at": 3.0, "parameters": {"leg_viscous_friction": 40.0}},
        {"at": 2.0, "factors": {"platform_mass": 1.5, "platform_inertia": 1.5}},
    ]
    settings = {"change": changes}
    (loop,), prepared = (
        found_of("payload_change", "c", settings),
        prepare(gs.load_experiment("payload_change", settings)),
    )
    own = prepared.machine
    heavier = replace(own, platform_mass=1.5 * own.platform_mass, platform_inertia=1.5 * np.array(own.platform_inertia))
    machines = [heavier, replace(heavier, leg_viscous_friction=40.0)]
    expected = [radius(prepared, 0, machine=machine) for machine in machines]
    assert [changed.size for changed in loop.changed] == pytest.approx(expected, abs=1e-7)
    others = [loop.nominal.size, radius(prepared, 0, machine=replace(own, leg_viscous_friction=40.0)), *expected]
    assert np.diff(sorted(others)).min() > 1e-6
    assert found_of("payload_change", "ssp", settings)[0].changed == ()


MEMBERS = {
    "ensemble.members": 12,
    "ensemble.platform_mass": {"grid": [14.0, 10.0, 3.0]},
    "ensemble.loop.delay": {"grid": [0, 1, 2, 4]},
}


def test_members_are_judged_with_their_machines_and_delays() -> None:
    """Expected: `radius` of each; an FMU delays at least by one sample, an SSP by its own delay alone."""
    settings = {"controller.bandwidth": 2.5, "loop.delay": 1, **MEMBERS}
    prepared = prepare(gs.load_experiment("circle", settings))
    members = [(mass, delay) for mass in (14.0, 10.0, 3.0) for delay in (0, 1, 2, 4)]

    def sizes(delay_of: Any) -> NDArray[np.float64]:
        machines = [replace(prepared.machine, platform_mass=mass) for mass, _ in members]
        return np.array(
            [radius(prepared, delay_of(delay), machine=m) for m, (_, delay) in zip(machines, members, strict=True)]
        )

    for host, expected in {
        "c": sizes(lambda delay: delay),
        "fmu": sizes(lambda delay: max(1, delay)),
        "ssp": sizes(lambda _: 1),
    }.items():
        calls: list[tuple[int, int]] = []
        (loop,) = found_of("circle", host, settings, progress=lambda k, of, calls=calls: calls.append((k, of)))  # type: ignore[arg-type]
        assert calls == [(k, 12) for k in range(1, 13)]
        assert loop.members == 12
        assert loop.worst is not None
        assert loop.worst.size == pytest.approx(expected.max(), abs=1e-7)
        assert loop.unstable == int((expected >= 1).sum())
    assert 0 < (sizes(lambda delay: delay) >= 1).sum() < 12


def test_margins_are_those_of_the_nominal_machine_and_of_the_member_with_the_smallest() -> None:
    """Expected: `loop_margins` of each; the heaviest has the largest |z|, and the lightest the smallest margins."""
    masses = [30.0, 7.0, 14.0]
    settings = {"controller.bandwidth": 2.5, "loop.delay": 1, "ensemble.platform_mass": {"grid": masses}}
    experiment = gs.load_experiment("circle", settings)
    prepared = prepare(experiment)
    (loop,) = stability_of(experiment, prepared, ("ssp",))["ssp"].loops
    motion, linear = prepared.motion, prepared.controller
    assert motion is not None
    assert isinstance(linear, LinearController)
    pose = {"position": motion.position[0], "orientation": motion.orientation[0]}
    machines = [prepared.machine, *(replace(prepared.machine, platform_mass=mass) for mass in masses)]
    loops = [loop_transfer(machine, linear, 1e-3, delay=1, **pose) for machine in machines]
    nominal, *members = [loop_margins(each).disk.alpha for each in loops]
    assert loop.margins is not None
    assert loop.margins_of_worst is not None
    assert loop.worst is not None
    assert loop.margins.disk.alpha == pytest.approx(nominal, rel=1e-6)
    case, worst = loop.margins_of_worst
    assert (loop.worst.what, case.what) == ("member 0", f"member {np.argmin(members)}")
    assert case.what == "member 1"
    assert worst.disk.alpha == pytest.approx(min(members), rel=1e-6)


# A start off the reference [m, rad], most of it about the axes that oscillate first.
BESIDE = np.array([[2e-7, -1e-7, 1e-7], [1e-6, -7e-7, 1e-7]])


def growth(away: NDArray[np.float64]) -> float:
    """The factor per sample of an oscillation's largest values, from the period at sample 85 to that at 135."""
    return float((away[135:148].max() / away[85:98].max()) ** (1 / 50))


@pytest.mark.parametrize("bandwidth", [5, 3])
def test_an_exported_loop_that_is_called_unstable_diverges_at_its_eigenvalue(bandwidth: float, tmp_path: Path) -> None:
    """Expected: FMPy's run of the SSP grows by |z| a sample; with a lower bandwidth, which is stable, it does not.

    The machine starts micrometres beside the pose that it is to hold.
    """
    machine = gs.load_preset("liu2000")
    home = machine.home_position, machine.home_orientation
    position, orientation = (np.add(place, by).tolist() for place, by in zip(home, BESIDE, strict=True))
    start = {"start.position": position, "start.orientation": orientation, "reference": {"type": "hold"}}
    settings = {**start, "controller.bandwidth": bandwidth, "loop.duration": 0.5}
    (loop,) = found_of("circle", "ssp", settings)
    (ssp,) = gs.export("circle", settings, forms="ssp", out=tmp_path, allow_unstable=True)
    found = simulate_ssp(str(ssp), stop_time=0.15, step_size=1e-3)
    lengths = np.transpose([found[f"plant.leg_length[{k}]"] for k in range(1, 7)])
    away = np.abs(lengths - leg_geometry(machine, *home).length).max(axis=1)
    assert loop.is_stable == (bandwidth == 3) == (away[-1] < away[0])
    if bandwidth == 5:
        assert growth(away) == pytest.approx(loop.nominal.size, abs=1e-3)


@pytest.mark.parametrize(("delay", "is_stable"), [(0, True), (1, False)])
def test_the_compiled_c_is_stable_where_it_is_called_stable(delay: int, is_stable: bool) -> None:
    """Expected: beside the plant a small push dies out without a delay, and with one sample it grows."""
    settings = {"loop.delay": delay, "reference": {"type": "hold"}}
    experiment = gs.load_experiment("circle", settings)
    (loop,) = found_of("circle", "c", settings)
    assert loop.is_stable == is_stable
    law = Exported(designed(experiment)).start()
    machine = prepare(experiment).machine
    position, orientation = machine.home_position, machine.home_orientation
    lengths = leg_geometry(machine, position, orientation).length
    plant = ModelPlant(machine, State(position + BESIDE[0], orientation + BESIDE[1], np.zeros(3), np.zeros(3)))
    line = [static_leg_forces(machine, position, orientation)] * delay
    away = []
    places = signals.positions(("leg_length",))
    for k in range(150):
        measured = plant.results()[places]
        away.append(np.abs(measured - lengths).max())
        line.append(law.step(measured)[0])
        plant.set_inputs(np.concatenate([line.pop(0), np.zeros(6)]))
        plant.do_step(k * 1e-3, 1e-3)
    assert (away[-1] < away[0]) == is_stable
    if not is_stable:
        assert growth(np.array(away)) == pytest.approx(loop.nominal.size, abs=1e-3)


def words_of(path: Path) -> str:
    return " ".join(path.read_text().split())


def test_one_unstable_form_refuses_the_whole_export(tmp_path: Path) -> None:
    """Expected: the figure, the machine and the remedies in the error, and no file; the C alone is written."""
    with pytest.raises(UnstableLoopError, match=r"in the SSP .* a delay of 1 sample: \|z\| = 1\.0505 at") as refused:
        gs.export("circle", forms=["c", "ssp"], out=tmp_path)
    for part in ("the nominal machine in its first pose", "it is stable without delay", "--allow-unstable", "× 0.5"):
        assert part in str(refused.value)
    assert "in C" not in str(refused.value)
    assert abs(refused.value.eigenvalue) == pytest.approx(1.0505, abs=5e-4)
    members = {"loop.delay": 1, "controller.bandwidth": 2.5, "ensemble.platform_mass": {"grid": [14.0, 10.0, 1.0]}}
    with pytest.raises(UnstableLoopError, match=r"\|z\| = 1\.\d+ .* for member 2, .* \(1 of 3 members are unstable\)"):
        gs.export("circle", members, forms="c", out=tmp_path)
    assert list(tmp_path.iterdir()) == []
    assert len(gs.export("circle", forms=["c"], out=tmp_path)) == 3
    header = words_of(tmp_path / "circle_controller.h")
    first = "the nominal machine in its first pose"
    assert f"Stability in C with no delay: stable; {first} |z| = 0.98112" in header
    assert f"Margins of {first} with no delay: all legs at once disk margin 0.276" in header


def test_an_unstable_loop_that_is_exported_on_request_says_so_in_every_form_and_so_does_a_delay_that_it_adds(
    tmp_path: Path,
) -> None:
    """Expected: also to the maker; the experiment has no delay, and the C adds none."""
    said: list[str] = []
    gs.export("too_slow", forms=["c", "fmu", "ssp"], out=tmp_path, allow_unstable=True, warn=said.append, fmi=["3.0"])
    notes = [text.removeprefix("exported on request: ") for text in said if text.startswith("exported on request: ")]
    assert [text.partition(" the closed")[0] for text in notes] == ["with the FMU", "in C", "in the SSP"]
    late = "one sample late, where the experiment has no delay: a unit outputs the forces of a sample at the next one"
    assert [text for text in said if "late" in text] == [f"the FMU is {late}", f"the SSP is {late}"]
    unstable = "UNSTABLE, and exported on request: "
    header = words_of(tmp_path / "too_slow_controller.h")
    assert f"{unstable}in C the closed loop is unstable with no delay: |z| = 2.163" in header
    with zipfile.ZipFile(tmp_path / "too_slow_controller_fmi3.fmu") as unit:
        assert f"{unstable}with the FMU" in unit.read("documentation/index.html").decode()
    with zipfile.ZipFile(tmp_path / "too_slow.ssp") as archive:
        for text in (archive.read(name).decode() for name in ("SystemStructure.ssd", "documentation/index.html")):
            assert f"{unstable}in the SSP" in text
            assert "forces act 1 sample after their measurement (output_delay = 1); the experiment has no delay" in text


def test_a_linear_controller_from_a_python_file_is_judged(tmp_path: Path) -> None:
    """Expected: `radius` with the same gains; as the file's object and from its maker."""
    gains = "control.ss([], [], [], np.diag([9e4, 8e4, 9.5e4, 8.5e4, 7e4, 9.9e4]), 0.001)"
    maker = f"controller = {gains}\n\n\ndef make(platform, sample_time):\n    return {gains}\n"
    (tmp_path / "mine.py").write_text(f"import control\nimport numpy as np\n{maker}")
    settings = {"loop.delay": 1, "reference": {"type": "hold"}}
    prepared = prepare(gs.load_experiment("circle", settings), eval(gains, {"control": control, "np": np}))
    for key, value in (("name", "controller"), ("factory", "make")):
        of_file = {"type": "python", "file": str(tmp_path / "mine.py"), key: value}
        with pytest.raises(UnstableLoopError, match="in C the closed loop is unstable with a delay of 1 samp") as found:
            gs.export("circle", {**settings, "controller": of_file}, forms="c", out=tmp_path / "out")
        assert abs(found.value.eigenvalue) == pytest.approx(radius(prepared, 1), abs=1e-7)


def test_margins_of_an_ensembles_member_have_the_geometry_that_is_believed() -> None:
    """Expected: `loop_margins` with the machine's plant and the belief's Jacobian; with the machine's it is another."""
    larger = (np.array(gs.load_preset("liu2000").platform_points) * 1.3).tolist()
    settings = {"loop.delay": 1, "controller.space": "task", "plant.parameters.platform_points": larger}
    prepared = prepare(gs.load_experiment("circle", settings))
    motion, linear = prepared.motion, prepared.controller
    assert motion is not None
    assert isinstance(linear, LinearController)
    pose = {"position": motion.position[0], "orientation": motion.orientation[0]}
    right, wrong = (
        loop_margins(loop_transfer(prepared.machine, linear, 1e-3, delay=1, **pose, believed=believed)).disk.alpha
        for believed in (prepared.platform, prepared.machine)
    )
    assert margins_of([prepared])["margins.disk"] == pytest.approx([right], rel=1e-9)
    assert abs(right - wrong) > 0.01 * right


def test_the_clock_of_the_sensors_and_jitter_of_the_machine_are_judged_as_their_worst_delay() -> None:
    """Expected: readings up to 4 − gcd(4, 2) steps old, and one step of jitter: 1.5 ms; the margins of `gs.margins`.

    An SSP has neither the clock nor the jitter, but the clock if it carries the sensors.
    """
    clocks = {"sensors.sample_time": 0.002, "loop.jitter": 0.0005, "loop.plant_step": 0.0005, "loop.delay": 1}
    experiment = gs.load_experiment("heave_step", clocks)
    prepared = prepare(experiment)
    found = stability_of(experiment, prepared, HOSTS)
    for host in HOSTS:
        loop, *directly = found[host].loops
        assert [other.nominal.loop.late for other in directly] == ([0.0] if host == "fmu" else [])
        assert loop.margins is not None
        expected = gs.margins("heave_step", {"loop.plant_step": 0.0005, "loop.delay": 1} if host == "ssp" else clocks)
        assert expected.late == loop.nominal.loop.late == (0.0 if host == "ssp" else 0.0015)
        assert loop.margins.disk.alpha == pytest.approx(expected.disk.alpha, rel=1e-9)
        inside = " ".join(notes_of(experiment, host, found[host]).inside)
        assert ("up to 1.5 ms by the sensors' clock and jitter" in inside) == (host != "ssp")
    carried = stability_of(experiment, prepared, ("ssp",), parts=("sensors",), margins=False)["ssp"].loops[0]
    assert carried.nominal.loop.late == pytest.approx(0.001)


def test_what_is_not_judged_is_said(tmp_path: Path) -> None:
    """Expected: members of a negative mass; a law of whole micrometres, whose slope is 0 or none; no feedback.

    The same law without rounding is judged; of forces without feedback nobody is warned.
    """
    experiment = gs.load_experiment("heave_step", {"ensemble.platform_mass": {"grid": [900.0, -5.0, 800.0, -1.0]}})
    (loop,) = stability_of(experiment, prepare(experiment), ("c",), margins=False)["c"].loops
    assert (loop.members, loop.impossible) == (2, 2)
    notes = notes_of(experiment, "c", StabilityReport((loop,)))
    assert "impossible members, which are not judged: 2." in " ".join(notes.inside)

    length, velocity = (casadi.SX.sym(name, 6) for name in ("leg_length", "leg_velocity"))
    said: list[str] = []
    for counted in (casadi.floor(length * 1e6) * 1e-6, length):
        force = -1e3 * counted - 200 * velocity
        law = casadi.Function("soft", [length, velocity], [force], ["leg_length", "leg_velocity"], ["actuator_force"])
        gs.export(law, forms="c", out=tmp_path / str(len(said)), warn=said.append)
    reason = "the controller's gains depend on the size or the sign of a small change"
    assert said == [f"the stability of the loop of the C is not judged: {reason}"]
    assert f"Stability: not judged, since {reason}." in words_of(tmp_path / "0" / "soft_controller.h")

    feedforward = {"controller": {"type": "open_loop", "feedforward": "gravity"}, "sensors.quantisation": {}}
    experiment = gs.load_experiment("pitch_sine", feedforward)
    for host, report in stability_of(experiment, prepare(experiment), HOSTS, margins=False).items():
        assert report == StabilityReport(reason="there is no feedback")
        notes = notes_of(experiment, host, report)
        assert "Stability: not judged, since there is no feedback." in notes.inside
        assert not any("judged" in text for text in notes.warnings)


def test_members_that_look_the_least_robust_are_found_by_each_sign_of_it() -> None:
    """Expected: in any order, those with the largest |z|, the least damping, and the largest peak; their numbers."""
    signs = {"|z|": (1.01, 0.5, 1.0), "damping": (0.9, 0.1, 1.0), "peak": (0.9, 0.5, 9.0), "none": (0.8, 0.6, 0.5)}
    for order in itertools.permutations(signs):
        tally = Tally()
        for name in order:
            size, damping_ratio, peak = signs[name]
            case = SimpleNamespace(what=name, size=size)
            tally.add(SimpleNamespace(case=case, damping_ratio=damping_ratio, peak=peak))  # type: ignore[arg-type]
        tally.add(None)
        assert [member.case.what for member in tally.extremes] == ["|z|", "damping", "peak"]
        assert (tally.members, tally.unstable, tally.impossible) == (4, 1, 1)
