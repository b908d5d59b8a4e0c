"""Stability of exported loops, by python-control's c2d with delays and drives as states, and by growth in FMPy."""

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
from gough_stewart import LinearController, Platform, UnstableLoopError, leg_geometry, leg_jacobian
from gough_stewart.harness.experiment.preparation import Prepared, prepare
from gough_stewart.harness.export.stability import Host, LoopStability, StabilityReport, least_robust, stability_of
from tests.support.exported import PID, uneven_experiment, words_of
from tests.support.uneven import UNEVEN

HOSTS: tuple[Host, ...] = ("c", "fmu", "ssp")


def radius(*arguments: Any, **options: Any) -> float:
    """The largest |z|."""
    return abs(eigenvalue(*arguments, **options))


def eigenvalue(
    prepared: Prepared, delay: int, lag: float = 0.0, machine: Platform | None = None, row: int = 0
) -> complex:
    """Of x⁺ = A x + B f, f = the force of `delay` samples ago behind its drive, u = −C_c ξ − D_c y; the largest."""
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
    n, m, k = len(plant.A), len(C), len(K.A)
    # of errors −y, or of references 0 and measurements y
    of_y = slice(0, m), -1.0
    if K.B.shape[1] > m:
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
    return complex(max(np.linalg.eigvals(whole), key=abs))


def found_of(name: str, host: Host, settings: Any = (), **options: Any) -> tuple[LoopStability, ...]:
    """The loops of a form of a shipped experiment."""
    experiment = gs.load_experiment(name, settings)
    return stability_of(experiment, prepare(experiment), (host,), margins=False, **options)[host].loops


@pytest.mark.parametrize(
    ("name", "host", "size"), [("circle", "ssp", 1.0505), ("payload_change", "fmu", 1.006), ("pitch_sine", "ssp", None)]
)
def test_shipped_loops_have_the_eigenvalues_of_another_formulation(name: str, host: Host, size: float | None) -> None:
    """Expected: `radius`; and, for those that are unstable, literal figures that were measured by another program."""
    (loop, *_), prepared = found_of(name, host), prepare(gs.load_experiment(name))
    assert loop.nominal.loop.delay == 1
    at = loop.nominal.loop[:2]
    z = eigenvalue(prepared, *at)
    assert loop.nominal.size == pytest.approx(abs(z), abs=1e-7)
    assert loop.nominal.frequency == pytest.approx(abs(np.log(z)) / prepared.loop.timing.sample_time / (2 * np.pi))
    assert loop.is_stable == (size is None)
    if size is not None:
        assert loop.nominal.size == pytest.approx(size, abs=5e-4)
    rows = np.unique(np.linspace(0, prepared.loop.timing.steps, 25).round().astype(int)).tolist()
    assert loop.on_the_way.size == pytest.approx(max(radius(prepared, *at, row=row) for row in rows), abs=1e-7)


@pytest.mark.parametrize(("space", "derivative_on"), [("leg", "measurement"), ("task", "error")])
def test_a_machine_that_is_not_what_is_believed_is_the_one_that_is_judged(space: str, derivative_on: str) -> None:
    """Expected: `radius` of the machine with the Jacobian of the belief, with drives, for every form's own delay."""
    machine = {"platform_mass": 7.0, "platform_com": [0.1, 0.2, -0.05], "leg_viscous_friction": 3.0}
    machine["platform_points"] = (np.array(UNEVEN.platform_points) * 1.07).tolist()
    controller = {**PID, "integral_gain": [900.0, 0.0, 1100.0, 700.0, 1300.0, 400.0]}
    experiment = uneven_experiment(
        reference={"type": "sine", "position_amplitude": [0.03, -0.02, 0.04], "frequency": 4.0},
        controller={**controller, "space": space, "derivative_on": derivative_on},
        plant={"parameters": machine},
        actuators={"lag": 0.003},
    )
    prepared = prepare(experiment)
    found = stability_of(experiment, prepared, HOSTS, margins=False)
    cases = [loop.nominal for host in HOSTS for loop in found[host].loops]
    # a delay of two samples: the C and the FMU in the experiment's loop, the FMU alone, and the SSP without drives
    assert [case.loop[:2] for case in cases] == [(2, 0.003), (2, 0.003), (1, 0.0), (2, 0.0)]
    for case in cases:
        assert case.size == pytest.approx(radius(prepared, *case.loop[:2]), abs=1e-7)
    assert len({round(case.size, 9) for case in cases}) == 3
    carried = stability_of(experiment, prepared, HOSTS, parts=("drives",), margins=False)
    assert [loop.nominal.loop[:2] for host in HOSTS for loop in carried[host].loops] == [(2, 0.003)] * 3


def test_a_machine_is_judged_after_each_of_its_changes() -> None:
    """Expected: `radius` of the heavier machine, then of the same with more friction; an SSP has no changes."""
    changes = [
        {"at": 3.0, "parameters": {"leg_viscous_friction": 40.0}},
        {"at": 2.0, "factors": {"platform_mass": 1.5, "platform_inertia": 1.5}},
    ]
    settings = {"change": changes}
    (loop,), prepared = found_of("payload_change", "c", settings), prepare(gs.load_experiment("payload_change"))
    own = prepared.machine
    heavier = replace(own, platform_mass=1.5 * own.platform_mass, platform_inertia=1.5 * np.array(own.platform_inertia))
    machines = [heavier, replace(heavier, leg_viscous_friction=40.0)]
    expected = [radius(prepared, 0, machine=machine) for machine in machines]
    assert [changed.size for changed in loop.changed] == pytest.approx(expected, abs=1e-7)
    others = [loop.nominal.size, radius(prepared, 0, machine=replace(own, leg_viscous_friction=40.0)), *expected]
    assert np.diff(sorted(others)).min() > 1e-6
    assert found_of("payload_change", "ssp", settings)[0].changed == ()


def test_members_are_judged_with_their_machines_and_delays() -> None:
    """Expected: `radius` of each; an FMU delays at least by one sample, an SSP by its own delay alone."""
    masses, delays = (14.0, 10.0, 3.0), (0, 1, 2, 4)
    settings = {
        **{"controller.bandwidth": 2.5, "loop.delay": 1, "ensemble.members": 12},
        **{"ensemble.platform_mass": {"grid": list(masses)}, "ensemble.loop.delay": {"grid": list(delays)}},
        "limits.stroke": "stop",
    }
    prepared = prepare(gs.load_experiment("circle", settings))
    members = list(itertools.product(masses, delays))

    def sizes(delay_of: Any) -> NDArray[np.float64]:
        machines = [replace(prepared.machine, platform_mass=mass) for mass, _ in members]
        return np.array([radius(prepared, delay_of(d), machine=m) for m, (_, d) in zip(machines, members, strict=True)])

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
    last = {"actuators.lag": [0.0, 0.004], "loop.jitter": [0.0, 5e-4], "platform_mass": [14.0] * 257 + [5.0]}
    for key, values in {**last, "platform.parameters.platform_mass": [14.0, 5.0]}.items():
        varied = {"ensemble.members": len(values), f"ensemble.{key}": {"grid": values}, "loop.plant_step": 5e-4}
        (loop,) = found_of("circle", "c", varied)
        assert loop.worst is not None
        assert (loop.members, loop.worst.what) == (len(values), f"member {len(values) - 1}")


def test_the_clock_of_the_sensors_and_jitter_of_the_machine_are_judged_as_their_worst_delay() -> None:
    """Expected: readings up to 4 − gcd(4, 2) steps old, and a step of jitter: 1.5 ms; of an SSP what it carries."""
    clocks = {"sensors.sample_time": 0.002, "loop.jitter": 0.0005, "loop.plant_step": 0.0005, "loop.delay": 1}
    experiment = gs.load_experiment("heave_step", clocks)
    prepared = prepare(experiment)
    found = stability_of(experiment, prepared, HOSTS)
    of_clocks, of_none = (gs.margins("heave_step", s) for s in (clocks, {"loop.plant_step": 0.0005, "loop.delay": 1}))
    for host in HOSTS:
        loop, *directly = found[host].loops
        assert [other.nominal.loop.late for other in directly] == ([0.0] if host == "fmu" else [])
        assert loop.margins is not None
        expected = of_none if host == "ssp" else of_clocks
        assert expected.late == loop.nominal.loop.late == (0.0 if host == "ssp" else 0.0015)
        assert loop.margins.disk.alpha == pytest.approx(expected.disk.alpha, rel=1e-9)
    assert len(found_of("heave_step", "fmu", clocks | {"loop.jitter": 0.0}, parts=("sensors",))) == 1
    carried = stability_of(experiment, prepared, ("ssp",), parts=("sensors",), margins=False)["ssp"].loops[0]
    assert carried.nominal.loop.late == pytest.approx(0.001)


def test_members_that_look_the_least_robust_are_found_by_each_sign_of_it() -> None:
    """Expected: those with the largest |z|, the least damping, and the largest peak."""
    signs = {"none": (0.8, 0.6, 0.5), "peak": (0.9, 0.5, 9.0), "|z|": (1.01, 0.5, 1.0), "damping": (0.9, 0.1, 1.0)}
    members: list[Any] = [
        SimpleNamespace(case=SimpleNamespace(what=name, size=size), damping_ratio=damping_ratio, peak=peak)
        for name, (size, damping_ratio, peak) in signs.items()
    ]
    assert [member.case.what for member in least_robust(members)] == ["|z|", "damping", "peak"]


def test_margins_are_those_of_the_nominal_machine_and_of_the_member_with_the_smallest(tmp_path: Path) -> None:
    """Expected: `gs.margins` of each; the heaviest has the largest |z|, and the lightest the smallest margins."""
    masses, loops = [30.0, 7.0, 14.0], list[Any]()
    settings = {"controller.bandwidth": 2.5, "loop.delay": 1}
    varied = {**settings, "ensemble.platform_mass": {"grid": masses}}
    gs.export("circle", varied, forms="c", out=tmp_path, stability=loops.extend)
    nominal = gs.margins("circle", settings).disk.alpha
    members = [gs.margins("circle", {**settings, "plant.parameters.platform_mass": m}).disk.alpha for m in masses]
    (loop,) = loops
    assert loop.margins.disk.alpha == pytest.approx(nominal, rel=1e-6)
    case, worst = loop.margins_of_worst
    assert (loop.worst.what, case.what) == ("member 0", f"member {np.argmin(members)}")
    assert case.what == "member 1"
    assert worst.disk.alpha == pytest.approx(min(members), rel=1e-6)


@pytest.mark.parametrize("bandwidth", [5, 3])
def test_an_exported_loop_that_is_called_unstable_diverges_at_its_eigenvalue(bandwidth: float, tmp_path: Path) -> None:
    """Expected: FMPy's run of the SSP grows by |z| a sample; with a lower bandwidth, which is stable, it does not."""
    machine, loops = gs.load_preset("liu2000"), list[Any]()
    home = machine.home_position, machine.home_orientation
    beside = np.array([[2e-7, -1e-7, 1e-7], [1e-6, -7e-7, 1e-7]])
    position, orientation = (np.add(place, by).tolist() for place, by in zip(home, beside, strict=True))
    start = {"start.position": position, "start.orientation": orientation, "reference": {"type": "hold"}}
    settings = {**start, "controller.bandwidth": bandwidth, "loop.duration": 0.5}
    options: dict[str, Any] = {"allow_unstable": True, "stability": loops.extend}
    (ssp,) = gs.export("circle", settings, forms="ssp", out=tmp_path, **options)
    found = simulate_ssp(str(ssp), stop_time=0.15, step_size=1e-3)
    lengths = np.transpose([found[f"plant.leg_length[{k}]"] for k in range(1, 7)])
    away = np.abs(lengths - leg_geometry(machine, *home).length).max(axis=1)
    assert loops[0].is_stable == (bandwidth == 3) == (away[-1] < away[0])
    if bandwidth == 5:  # of the largest values from the period at sample 85 to that at 135
        growth = (away[135:148].max() / away[85:98].max()) ** (1 / 50)
        assert growth == pytest.approx(loops[0].nominal.size, abs=1e-3)


def test_one_unstable_form_refuses_the_whole_export(tmp_path: Path) -> None:
    """Expected: the figure, the machine and the remedies in the error, and no file; the C alone is written."""
    with pytest.raises(UnstableLoopError, match=r"in the SSP .* a delay of 1 sample: \|z\| = 1\.0505 at") as refused:
        gs.export("circle", forms=["c", "ssp"], out=tmp_path)
    said = str(refused.value)
    assert "the nominal machine in its first pose, expected below 1; it is stable without delay" in said
    assert "× 0.5" in said
    assert "; --allow-unstable (allow_unstable=True) exports it, with a note inside" in said
    assert "in C" not in said
    assert abs(refused.value.eigenvalue) == pytest.approx(1.0505, abs=5e-4)
    members = {"loop.delay": 1, "controller.bandwidth": 2.5, "ensemble.platform_mass": {"grid": [14.0, 10.0, 1.0]}}
    with pytest.raises(UnstableLoopError, match=r"\|z\| = 1\.\d+ .* for member 2, .* \(1 of 3 members are unstable\)"):
        gs.export("circle", members, forms="c", out=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_an_unstable_loop_that_is_exported_on_request_says_so_in_every_form_and_so_does_a_delay_that_it_adds(
    tmp_path: Path,
) -> None:
    """Expected: also to the maker; the experiment has no delay, and the C adds none. Unstable loops come first."""
    said, verdicts = list[str](), list[str]()
    options: dict[str, Any] = {"allow_unstable": True, "warn": said.append, "verdict": verdicts.append}
    gs.export("too_slow", forms=["c", "fmu", "ssp"], out=tmp_path, fmi=["3.0"], **options)
    notes = [text.removeprefix("exported on request: ") for text in said if text.startswith("exported on request: ")]
    assert [text.partition(" the closed")[0] for text in notes] == ["with the FMU", "in C", "in the SSP"]
    assert all(text.startswith("UNSTABLE ") for text in verdicts)
    assert "UNSTABLE in C with no delay: |z| = 2.1632 (the nominal machine in its first pose)" in verdicts
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


def test_margins_of_an_ensembles_member_have_the_geometry_that_is_believed() -> None:
    """Expected: those of `gs.margins` with the machine's plant and the belief's Jacobian."""
    larger = (np.array(gs.load_preset("liu2000").platform_points) * 1.3).tolist()
    settings = {"loop.delay": 1, "controller.space": "task", "plant.parameters.platform_points": larger}
    alone = gs.margins("circle", settings).disk.alpha
    varied = {"ensemble": {"margins": True, "platform_mass": {"factor": {"grid": [1.0, 1.5]}}}, "loop.duration": 0.05}
    ensemble = gs.ensemble("circle", {**settings, **varied}, workers=1)
    assert ensemble.values("margins.disk")[0] == pytest.approx(alone, rel=1e-9)


def test_what_is_not_judged_is_said(tmp_path: Path) -> None:
    """Expected: members of a negative mass; a law of whole micrometres, whose slope is 0 or none; no feedback."""
    (loop,) = found_of("heave_step", "c", {"ensemble.platform_mass": {"grid": [900.0, -5.0, 800.0, -1.0]}})
    assert (loop.members, loop.impossible) == (2, 2)

    length, velocity = (casadi.SX.sym(name, 6) for name in ("leg_length", "leg_velocity"))
    said: list[str] = []
    for counted in (casadi.floor(length * 1e6) * 1e-6, length):
        force = -1e3 * counted - 200 * velocity
        law = casadi.Function("soft", [length, velocity], [force], ["leg_length", "leg_velocity"], ["actuator_force"])
        gs.export(law, {"loop.sample_time": 0.0025}, forms="c", out=tmp_path / str(len(said)), warn=said.append)
    reason = "the controller's gains depend on the size or the sign of a small change"
    assert said == [f"the stability of the loop of the C is not judged: {reason}"]
    assert f"Stability: not judged, since {reason}." in words_of(tmp_path / "0" / "soft_controller.h")
    assert "R(0.0025), /* sample_time */" in words_of(tmp_path / "1" / "soft_controller.c")

    feedforward = {"controller": {"type": "open_loop", "feedforward": "gravity"}, "sensors.quantisation": {}}
    experiment = gs.load_experiment("pitch_sine", feedforward)
    for report in stability_of(experiment, prepare(experiment), HOSTS, margins=False).values():
        assert report == StabilityReport(reason="there is no feedback")
    gs.export("pitch_sine", feedforward, forms="c", out=tmp_path, warn=said.append)
    assert len(said) == 1
    assert "Stability: not judged, since there is no feedback." in words_of(tmp_path / "pitch_sine_controller.h")
