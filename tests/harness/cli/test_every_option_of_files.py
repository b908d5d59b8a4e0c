"""Every option of the commands for platforms, logs, exports, pages and the paper; see test_every_option.py."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gough_stewart.fmu_build.build import number_of_steps
from gough_stewart.harness.cli import terminal
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.report.document import Note, Report
from gough_stewart.model.platform import Platform, load_preset, platform_to_toml, preset_text
from tests.support.commands import invoke
from tests.support.noted_calls import Notes, made_report, said
from tests.support.uneven import UNEVEN


def steps(*names: str) -> Callable[..., None]:
    """Calls the callback `progress` or `status` with these."""

    def act(*_: Any, **options: Any) -> None:
        for name in names:
            (options["progress"] if "progress" in options else options["status"])(name)

    return act


@pytest.mark.parametrize("is_default", [True, False])
def test_build(notes: Notes, is_default: bool) -> None:
    def act(out: Path, **options: Any) -> list[Path]:
        (out / "sub").mkdir(parents=True)
        (out / "sub" / "a.fmu").write_bytes(b"x" * 1500)
        steps("one", "two")(**options)
        return [out / "sub" / "a.fmu"]

    notes.replace("fmu_build.build.build", act=act)
    options = () if is_default else (
        *("--fmi", "3.0", "--target", "x86_64-windows", "--target", "aarch64-linux", "--platform", "own.toml"),
        *("--out", "a/b c"),
    )  # fmt: skip
    done = invoke("build", *options)
    (out,), given = notes.one("build")
    systems = "this machine" if is_default else "x86_64-windows and aarch64-linux"
    fmi = "2.0 and 3.0" if is_default else "3.0"
    platform = "liu2000" if is_default else UNEVEN.name
    said(
        done,
        f"FMI {fmi} of the platform {platform}, compiled for {systems}; six actuator forces in, pose and leg lengths "
        "out; not yet run: `--check` runs and compares them",
        f"FMU of {platform}",
        # the present folder gets no report
        "Done in T s. Wrote sub/a.fmu (1.5 kB)." if is_default else "Done in T s. Wrote to a/b c (2 kB):",
    )
    assert out == (Path() if is_default else Path("a/b c"))
    assert given.pop("platform") == (load_preset("liu2000") if is_default else UNEVEN)
    targets = ["native"] if is_default else ["x86_64-windows", "aarch64-linux"]
    versions = ["2.0", "3.0"] if is_default else ["3.0"]
    assert (list(given.pop("fmi")), given) == (versions, {"targets": targets})
    expected = {"description": "two", "total": number_of_steps(versions, targets), "done": 2}
    assert notes.bars[-1] == expected
    if is_default:
        assert invoke("build", "--fmi", "2.0", "--fmi", "3.0", "--out", "other").exit_code == 0
        assert list(notes.one("build")[1]["fmi"]) == ["2.0", "3.0"]


@pytest.mark.parametrize("kind", ["default", "all", "preset"])
def test_excite(notes: Notes, kind: str) -> None:
    found = SimpleNamespace(condition_number=12.345678, log_determinant=-3.4567891)
    notes.replace("harness.identify.excite.excite_report", made_report("motion"))
    notes.replace("harness.identify.excite.excite", found, steps("motion 3"))
    notes.replace("harness.identify.excite.experiment_text", "the text")
    more = {
        "default": (),
        "preset": ("--preset", "desktop_hexapod"),
        "all": (
            *("--platform", "own.toml", "--estimate", "platform_mass", "--duration", "12.5", "--frequency", "0.3"),
            *("--harmonics", "7", "--fade", "0.75", "--criterion", "trace", "--trials", "9", "--seed", "4"),
            *("--out", "a b"),
        ),
    }[kind]
    done = invoke("excite", *more)
    out = {"default": "results/excite_liu2000", "preset": "results/excite_desktop_hexapod", "all": "a b"}[kind]
    platform = {"default": load_preset("liu2000"), "preset": load_preset("desktop_hexapod"), "all": UNEVEN}[kind]
    names = "platform_mass,platform_com,platform_inertia,leg_viscous_friction,leg_coulomb_friction"
    names = "platform_mass" if kind == "all" else names
    (chosen, estimate), given = notes.one("excite")
    assert (chosen, estimate) == (platform, names)
    expected: dict[str, Any] = {"duration": 20.0, "frequency": 0.1, "harmonics": 5, "fade": 1.0}
    expected |= {"criterion": "determinant", "trials": 2, "seed": 0}
    other: dict[str, Any] = {"duration": 12.5, "frequency": 0.3, "harmonics": 7, "fade": 0.75}
    other |= {"criterion": "trace", "trials": 9, "seed": 4}
    assert given == (other if kind == "all" else expected)
    line = 'file = "platform.toml"' if kind == "all" else f'preset = "{platform.name}"'
    assert notes.one("experiment_text") == ((found, platform, line, names, 4 if kind == "all" else 0), {})
    assert Path(out, "excitation.toml").read_text() == "the text"
    assert notes.bars[-1] == {"description": "motion 3", "total": None, "done": 0}
    if kind == "all":
        assert Path(out, "platform.toml").read_text() == platform_to_toml(UNEVEN)
    (of, machine, elements, duration), asked = notes.one("excite_report")
    assert (of, machine, asked) == (found, platform, {})
    assert elements[0] == "platform_mass"
    assert (len(elements) == 1, duration) == (kind == "all", given["duration"])
    (wrote,) = (line for line in done.stdout.splitlines() if line.startswith("Done in "))
    assert re.fullmatch(rf"Done in \d\.\d s. Wrote to {out} \(\S+ kB\):", wrote)
    wrote = re.sub(r"\d\.\d s", "T s", wrote)
    place = f"'{out}/excitation.toml'" if " " in out else f"{out}/excitation.toml"
    said(done, "motion found", "motion", wrote, f"Next: gough-stewart run {place}")


@pytest.mark.usefixtures("notes")
@pytest.mark.parametrize("name", ["duration", "frequency", "fade"])
@pytest.mark.parametrize("value", ["0", "-2", "inf", "nan"])
def test_times_of_an_excitation_are_finite_and_positive(name: str, value: str) -> None:
    done = invoke("excite", f"--{name}={value}")
    assert (done.exit_code, done.stderr) == (2, f"error: --{name} is {value}; expected a number > 0\n")


@pytest.mark.usefixtures("notes")
def test_the_first_wrong_time_is_named() -> None:
    """Expected: in the order of the help."""
    wrong = ["--duration=-1", "--frequency=-2", "--fade=-3"]
    for k, name in enumerate(("duration is -1", "frequency is -2", "fade is -3")):
        assert invoke("excite", *wrong[k:]).stderr == f"error: --{name}; expected a number > 0\n"


@pytest.mark.parametrize("is_default", [True, False])
def test_export(notes: Notes, is_default: bool) -> None:
    def act(_: Experiment, **options: Any) -> list[Path]:
        options["warn"]("take care")
        options["verdict"]("it is stable")
        options["progress"]("compiling")
        options["judging"](3, 7)
        (options["out"] / "d").mkdir(parents=True)
        for name in ("d/a.c", "b.h"):
            (options["out"] / name).write_bytes(b"x" * 2000)
        return [options["out"] / "d" / "a.c", options["out"] / "b.h"]

    notes.replace("harness.export.export.export", act=act)
    more = () if is_default else (
        *("--as", "c, ssp,fmu", "--fmi", "3.0", "--ssp-fmi", "3.0"),
        *("--target", "x86_64-windows", "--target", "aarch64-linux"),
        *("--reference", "inputs", "--safe-force", "zero", "--frozen", "50,1.5 mm", "--anyway", "--real", "float"),
        *("--with", "sensors, drives", "--set", "loop.duration=0.7", "--set", "loop.delay=2", "--out", "there"),
    )  # fmt: skip
    done = invoke("export", "heave_step", *more)
    (chosen,), given = notes.one("export")
    loop = (chosen.loop.duration, chosen.loop.delay)
    versions, targets = list(given.pop("fmi")), given.pop("targets")
    assert list(given.pop("forms")) == (["fmu"] if is_default else ["fmu", "c", "ssp"])
    if is_default:
        assert (loop, versions, targets) == ((2.0, 1), ["2.0", "3.0"], ["native"])
        other: dict[str, Any] = {"out": Path(), "reference": "inside", "safe_force": "feedforward", "real": "double"}
        assert given == {**other, "ssp_fmi": "2.0", "frozen": None, "anyway": False, "parts": ()}
        total = number_of_steps(versions, targets)
    else:
        assert (loop, versions, targets) == ((0.7, 2), ["3.0"], ["x86_64-windows", "aarch64-linux"])
        other = {"out": Path("there"), "reference": "inputs", "safe_force": "zero", "real": "float"}
        other |= {"ssp_fmi": "3.0", "frozen": (50, 0.0015), "anyway": True}
        assert given == {**other, "parts": ("drives", "sensors")}
        # the C at once; the FMUs; an SSP with two FMUs, and itself
        total = 1 + number_of_steps(["3.0"], targets) + 1 + 2 * number_of_steps(["2.0"], targets)
    assert done.stderr == "warning: take care\n"
    where = "." if is_default else "there"
    forms = "FMU" if is_default else "FMU, C and SSP"
    was_set = [] if is_default else ["set: loop.duration = 0.7 (file: 2 s), loop.delay = 2 (file: 1)"]
    lines = [f"Written as {forms}; it is stable", "heave step", *was_set]
    said(done, *lines, f"Done in T s. Wrote to {where} (4 kB):")
    assert f"  d/a.c, b.h{'' if is_default else ', report.json'}" in done.stdout.splitlines()
    assert notes.bars[-2:] == [
        {"description": "compiling", "total": total, "done": 1},
        {"description": "judging the members", "total": 7, "visible": True, "completed": 3, "done": 0},
    ]


class Identified(SimpleNamespace):
    def platform(self, nominal: Platform) -> tuple[str, Platform]:
        return ("identified", nominal)


@pytest.mark.parametrize("kind", ["default", "all", "share"])
def test_identify(notes: Notes, kind: str) -> None:  # noqa: PLR0915
    found = Identified(
        notes=["half a note"], not_excited=kind != "share", alarms=["bad", "worse"] if kind == "all" else []
    )
    notes.replace("harness.identify.log.read_log", act=lambda log, *_, **__: f"read {log}")
    notes.replace("harness.identify.identify.identify", found)
    notes.replace(
        "harness.identify.retuned.before_and_after",
        SimpleNamespace(table=SimpleNamespace(title="before and after"), numbers=()),
    )
    notes.replace("harness.identify.estimate.identification_files", {"platform.toml": b"x" * 3000})
    alarms = tuple(Note(text, "warning") for text in found.alarms)
    notes.replace("harness.identify.report.estimate_report", replace(made_report("parameters"), notes=alarms))
    opened = notes.opened()
    arguments = {
        "default": ("log.csv", "--estimate", "platform_mass"),
        "share": ("a/log.csv", "--estimate", "platform_mass", "--preset", "motion_base", "--validation", "0.35"),
        "all": (
            *("one.csv", "two.csv", "--estimate", "leg_armature,platform_com", "--platform", "own.toml"),
            *("--method", "geometry", "--force-per-current", "57.5", "--holds-force", "--validate", "three.csv"),
            *("--validate", "four.csv", "--pose-frame", "own", "--experiment", "circle", "--set", "loop.delay=3"),
            *("--side", "motor", "--out", "there", "--open"),
        ),
    }[kind]
    done = invoke("identify", *arguments)
    nominal = {"default": load_preset("liu2000"), "share": load_preset("motion_base"), "all": UNEVEN}[kind]
    out = {"default": "results/identify_log", "share": "results/identify_log", "all": "there"}[kind]
    lines = [f"Done in T s. Wrote to {out} (3 kB):"]
    tables = ["parameters found", "parameters"]
    more_tables = ["before and after"] * (kind == "all")
    factor, of_log = (
        (57.5, {"holds_force": True, "side": "motor"}) if kind == "all" else (None, {"holds_force": None, "side": None})
    )
    logs = {"default": ["log.csv"], "share": ["a/log.csv"], "all": ["one.csv", "two.csv", "three.csv", "four.csv"]}[
        kind
    ]
    assert notes.calls.pop("read_log") == [((Path(log), factor), of_log) for log in logs]
    read = [f"read {log}" for log in logs]
    expected: dict[str, Any] = {}
    if kind == "all":
        expected = {"validation": read[2:], "pose_frame": "own"}
    elif kind == "share":
        expected = {"validation": 0.35}
    names = "leg_armature,platform_com" if kind == "all" else "platform_mass"
    method = "geometry" if kind == "all" else "linear"
    assert notes.one("identify") == ((read[:2] if kind == "all" else read, nominal, names, method), expected)
    more: list[Any] = []
    if kind == "all":
        (experiment, of, changed), _ = notes.one("before_and_after")
        assert (experiment.loop.delay, of, changed) == (3, nominal, ("identified", nominal))
        more = [notes.bars[-1]["description"]]
        assert more == ["before and after"]
    files, options = notes.one("identification_files")
    assert (files, options) == ((found, nominal), {})
    (of, name, extra), asked = notes.one("estimate_report")
    assert (of, name, [each.title for each in extra]) == (found, nominal.name, more_tables)
    assert asked == {"charts": kind == "all"}
    if kind == "all":
        assert opened == [Path(out, "report.html").absolute().as_uri()]
        tables.insert(1, "set: loop.delay = 3")
        lines.append(f"Next: gough-stewart excite --platform own.toml --estimate {names}")
        assert done.exit_code == 3
        assert done.stderr == "warning: bad\nwarning: worse\n"
        done.exit_code = 0
    else:
        assert opened == []
        if kind == "default":
            lines.append(f"Next: gough-stewart excite --preset liu2000 --estimate {names}")
        assert done.stderr == ""
    said(done, *tables, *lines)


@pytest.mark.parametrize("kind", ["default", "order", "report", "open", "preset", "own"])
def test_reproduce(notes: Notes, kind: str) -> None:
    files, told = {"report.md": b"x" * 10}, list[bool]()

    def document(*, charts: bool) -> Report:
        told.append(charts)
        return made_report("agreement")

    made = SimpleNamespace(document=document, files=files, agrees=kind != "preset")
    notes.replace("harness.paper.reproduce.reproduce", made)
    opened = notes.opened()
    done = invoke("reproduce", *{
        "default": (), "report": ("--report",),
        "order": ("--order", "minus-first", "--preset", "liu2000", "--out", "o"),
        "open": ("--open", "--order", "plus-first"), "preset": ("--preset", "motion_base"),
        "own": ("--platform", "own.toml", "--out", "o"),
    }[kind])  # fmt: skip
    out = {"preset": "results/reproduce_motion_base", "own": "o", "order": "o"}.get(kind, "results/reproduce_liu2000")
    (case, errors), given = notes.one("reproduce")
    assert (errors is terminal.errors, told, given) == (True, [kind in ("report", "open")], {})
    assert ("− before +" in case.title) == (kind == "order")
    expected = {"preset": load_preset("motion_base"), "own": UNEVEN}.get(kind, load_preset("liu2000"))
    assert case.platform.name == expected.name
    assert kind == "order" or case.platform == expected
    page = {"report.html"} if kind in ("report", "open") else set()
    assert {path.name for path in Path(out).iterdir()} == {*files, "report.json", *page}
    lines = ["agreement found", "agreement", f"Done in T s. Wrote to {out} (2 kB):"]
    if kind == "report":
        lines.append(f"Open {out}/report.html in a browser.")
    if kind == "preset":
        assert done.exit_code == 3
        assert done.stderr == "error: a comparison misses its bound; see the table above and report.md\n"
        done.exit_code = 0
    assert opened == ([Path(out, "report.html").absolute().as_uri()] if kind == "open" else [])
    said(done, *lines)


@pytest.mark.usefixtures("notes")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("--order", "plus-first", "--platform", "own.toml"),
            "--order applies only to the paper's own platform; omit it",
        ),
        (
            ("--order", "plus-first", "--preset", "motion_base"),
            "--order applies only to the paper's own platform; omit it",
        ),
        (("--preset", "liu2000", "--platform", "own.toml"), "--preset and --platform exclude each other; give one"),
    ],
)
def test_an_order_is_that_of_the_paper(arguments: tuple[str, ...], message: str) -> None:
    done = invoke("reproduce", *arguments)
    assert done.exit_code == 2
    assert message in done.stderr


def test_view(notes: Notes) -> None:
    def act(_: Any, out: Path, **options: Any) -> None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(b"x" * 1_234_000)
        options["progress"]("reading it")

    opened = notes.opened()
    notes.replace("harness.view.file.view", act=act)
    done = invoke("view", "a", "b/record.csv", "--out", "new/p.htm", "--open")
    assert notes.one("view") == (([Path("a"), Path("b/record.csv")], Path("new/p.htm")), {})
    assert done.exit_code == 0
    assert re.fullmatch(r"Done in \d\.\d s\. Wrote new/p\.htm \(1\.2 MB\)\.\n", done.stdout) or opened == []
    assert notes.bars[-1]["description"] == "reading it"
    done = invoke("view", "a")
    said(done, "Done in T s. Wrote report.html (1.2 MB).", "Open report.html in a browser.")
    assert notes.one("view") == (([Path("a")], Path("report.html")), {})
    for wrong in ("page", "page.pdf"):
        done = invoke("view", "a", "--out", wrong)
        message = f"error: --out {wrong}: expected the name of a page, such as {wrong}.html\n"
        assert (done.exit_code, done.stderr) == (2, message)


WORKSPACE = "harness.workspace"


@pytest.mark.parametrize("kind", ["default", "two", "three", "open"])
def test_workspace(notes: Notes, kind: str) -> None:
    space = SimpleNamespace()

    def act(*args: Any) -> None:
        args[4](77)

    opened = notes.opened()
    notes.replace("model.workspace.sweep", space, act)
    told = (Note("nothing is reached", "warning"),) if kind == "two" else ()
    notes.replace(f"{WORKSPACE}.report.workspace_report", replace(made_report("limits"), notes=told))
    notes.replace(f"{WORKSPACE}.report.workspace_csv", b"c" * 400)
    done = invoke("workspace", *{
        "default": (),
        "two": (*("--over", " x = -1200mm : 1.2 ,yaw", "--at", "pitch=5deg", "--at", "z = 2.5", "--points", "9"),
                *("--preset", "motion_base", "--out", "o p")),
        "three": ("--over", "z,roll=-10deg:0.3,y=-5mm:5mm", "--platform", "own.toml"),
        "open": ("--open", "--over", "x,y"),
    }[kind])  # fmt: skip
    platform = {"two": load_preset("motion_base"), "three": UNEVEN}.get(kind, load_preset("liu2000"))
    (chosen, ranges, fixed, points, _), given = notes.one("sweep")
    assert (chosen, given) == (platform, {})
    if kind == "two":
        assert ranges == {"x": (-1.2, 1.2), "yaw": None}
        assert fixed == {"pitch": pytest.approx(0.0872664626), "z": 2.5}
    elif kind == "three":
        assert list(ranges) == ["z", "roll", "y"]
        assert ranges["z"] is None
        assert ranges["roll"] == pytest.approx((-0.174532925, 0.3))
        assert ranges["y"] == pytest.approx((-0.005, 0.005))
    else:
        assert (ranges, fixed) == (None if kind == "default" else {"x": None, "y": None}, {})
    assert points == (9 if kind == "two" else None)
    total = {"two": 81, "three": 31**3}.get(kind, 101**2)
    assert notes.bars[-1] == {"description": "files", "total": total, "completed": 77, "done": 0}
    out = {"two": "o p", "three": "results/workspace_own"}.get(kind, "results/workspace_liu2000")
    data = {"report.json"} | ({"report.html"} if kind == "open" else set())
    assert data <= {path.name for path in Path(out).iterdir()}
    written = {path.name: path.read_bytes() for path in Path(out).iterdir() if path.name not in data}
    assert written == {"workspace.csv": b"c" * 400}
    assert {name: calls[0][0][0] is space for name, calls in notes.calls.items()} == dict.fromkeys(
        ("workspace_report", "workspace_csv"), True
    )
    # the surface takes seconds
    assert notes.calls["workspace_report"][0][1] == {"surface": kind == "open"}
    assert done.stderr == ("warning: nothing is reached\n" if kind == "two" else "")
    said(done, "limits found", "limits", f"Done in T s. Wrote to {out} (1 kB):")
    assert opened == ([Path(out, "report.html").absolute().as_uri()] if kind == "open" else [])


@pytest.mark.usefixtures("notes")
def test_presets_and_experiments_are_listed_with_their_numbers() -> None:
    """Expected: of each platform the mass of its file, the mean length and the condition of its legs at home.

    Recomputed: |t + R p − b|, and the ratio of singular values of the rows [u, c × u / ρ], ρ the mean arm's length.
    """
    done = invoke("presets", columns=300)
    heads = [cell.strip() for cell in done.stdout.splitlines()[1].strip("┃").split("┃")]
    assert heads == ["name", "platform [kg]", "home leg [m]", "condition", "source"]
    rows = {}
    for line in done.stdout.splitlines():
        if line.startswith("│"):
            name, *cells = [cell.strip() for cell in line.strip("│").split("│")]
            rows[name] = cells
    for name, (mass, length, condition, source) in rows.items():
        p = load_preset(name)
        R = Rotation.from_euler("xyz", p.home_orientation.copy()).as_matrix()
        arms = p.platform_points @ R.T
        legs = p.home_position + arms - p.base_points
        size = np.linalg.norm(legs, axis=1)
        assert float(mass) == p.platform_mass
        assert length == f"{size.mean():.5g}"
        assert source == p.source
        assert f'name = "{name}"' in preset_text(name)
        u = legs / size[:, None]
        scaled = np.hstack([u, np.cross(arms, u) / p.characteristic_length])
        values = np.linalg.svd(scaled, compute_uv=False)
        assert condition == f"{values[0] / values[-1]:.3g}"
    listed = invoke("experiments", columns=300).stdout
    assert [cell.strip() for cell in listed.splitlines()[1].strip("┃").split("┃")] == ["name", "platform", "what"]
    (row,) = [line for line in listed.splitlines() if line.startswith("│ heave_tolerances ")]
    name, platform, what = [cell.strip() for cell in row.strip("│").split("│")]
    assert platform == "motion_base"
    assert f'description = "{what}"' in invoke("experiments", "heave_tolerances").stdout
