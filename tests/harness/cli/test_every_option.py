"""Every option of every command, alone and with all others: what the function behind the command is asked.

The functions are replaced by notes of what they were called with, so a call costs nothing; what they do with it is
tested in their rooms. Expected: the values as given, in SI units, and the defaults that the help states.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars
import pytest
from rich.progress import Progress
from scipy.spatial.transform import Rotation
from typer.testing import Result

from gough_stewart.fmu_build.builder import number_of_steps
from gough_stewart.harness.cli import terminal
from gough_stewart.harness.ensemble.columns import AMPLITUDE, FREQUENCY
from gough_stewart.harness.experiment.schema import Experiment
from gough_stewart.harness.output.tables import Sheet
from gough_stewart.harness.results.record import Record
from gough_stewart.model.platform import Platform
from gough_stewart.model.platform_toml import load_preset, platform_to_toml, preset_text
from tests.support.commands import invoke
from tests.support.records import oscillating, waving_record
from tests.support.uneven import UNEVEN

BAR = Path("bar")


class Notes:
    """What replaced functions were called with, and what commands showed while they ran."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch
        self.calls: dict[str, list[tuple[tuple[Any, ...], dict[str, Any]]]] = {}
        self.bars: list[dict[str, Any]] = []
        self.places: dict[tuple[int, int], int] = {}
        notes = self

        class Told(Progress):
            def add_task(self, description: str, *args: Any, **options: Any) -> Any:
                assert isinstance(description, str)
                task = super().add_task(description, *args, **options)
                notes.places[id(self), task] = len(notes.bars)
                notes.bars.append({"description": description, **options, "done": 0})
                return task

            def update(self, task_id: Any, **options: Any) -> None:
                bar = notes.bars[notes.places[id(self), task_id]]
                bar |= {name: value for name, value in options.items() if name != "advance"}
                bar["done"] += options.get("advance", 0)
                super().update(task_id, **options)

        monkeypatch.setattr(terminal, "Progress", Told)

    def replace(self, place: str, result: Any = None, act: Callable[..., Any] | None = None) -> None:
        """Let the function at this place note its call, act, and give this result."""

        def noted(*args: Any, **options: Any) -> Any:
            given = {name: value for name, value in options.items() if not callable(value)}
            self.calls.setdefault(place.rpartition(".")[2], []).append((args, given))
            done = None if act is None else act(*args, **options)
            return done if result is None else result

        self._patch.setattr(f"gough_stewart.{place}", noted)

    def set(self, place: str, value: Any) -> None:
        self._patch.setattr(place, value)

    def opened(self) -> list[str]:
        """Addresses that are opened in the browser from now on."""
        addresses: list[str] = []

        def opens(address: str) -> bool:
            addresses.append(address)
            return True

        self.set("webbrowser.open", opens)
        return addresses

    def one(self, name: str) -> tuple[tuple[Any, ...], dict[str, Any]]:
        (call,) = self.calls.pop(name)
        return call


@pytest.fixture
def notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Notes:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.toml").write_text(platform_to_toml(UNEVEN))
    return Notes(monkeypatch)


def sheet(title: str) -> Sheet:
    made = Sheet(title, ("", "value"))
    made.add("row", title + "!")
    return made


def said(done: Result, *lines: str) -> None:
    """The command is done, and its output has these lines, apart from tables."""
    assert done.exit_code == 0, done.output
    plain = [line for line in done.stdout.splitlines() if line[:1] not in "┏┃┡│└├ "]
    assert [re.sub(r"\d+\.\d s", "T s", line) for line in plain] == list(lines)


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
    said(done, f"Done in T s. Wrote {Path(out, 'sub', 'a.fmu')} (1.5 kB).")
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
    notes.replace("harness.identify.excite.excite", found, steps("motion 3"))
    notes.replace("harness.identify.experiment_text.experiment_text", "the text")
    more = {
        "default": (),
        "preset": ("--preset", "desktop_hexapod"),
        "all": (
            *("--platform", "own.toml", "--estimate", "platform_mass", "--duration", "12.5", "--frequency", "0.3"),
            *("--harmonics", "7", "--fade", "0.75", "--criterion", "determinant", "--trials", "9", "--seed", "4"),
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
    expected |= {"criterion": "condition", "trials": 150, "seed": 0}
    other: dict[str, Any] = {"duration": 12.5, "frequency": 0.3, "harmonics": 7, "fade": 0.75}
    other |= {"criterion": "determinant", "trials": 9, "seed": 4}
    assert given == (other if kind == "all" else expected)
    line = 'file = "platform.toml"' if kind == "all" else f'preset = "{platform.name}"'
    assert notes.one("experiment_text") == ((found, platform, line, names, 4 if kind == "all" else 0), {})
    assert Path(out, "excitation.toml").read_text() == "the text"
    assert notes.bars[-1] == {"description": "motion 3", "total": None, "done": 0}
    if kind == "all":
        assert Path(out, "platform.toml").read_text() == platform_to_toml(UNEVEN)
        wrote = f"Done in T s. Wrote to {out} ({len(platform_to_toml(UNEVEN).encode() + b'the text') / 1e3:.3g} kB):"
    else:
        wrote = f"Done in T s. Wrote {out}/excitation.toml (0.008 kB)."
    place = f"'{out}/excitation.toml'" if " " in out else f"{out}/excitation.toml"
    said(done, "Condition number 12.35, log det -3.457", wrote, f"Next: gough-stewart run {place}")


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
        *("--as", "c, ssp,fmu", "--fmi", "3.0", "--target", "x86_64-windows", "--target", "aarch64-linux"),
        *("--reference", "inputs", "--safe-force", "zero", "--frozen", "50,1.5 mm", "--anyway", "--real", "float"),
        *("--set", "loop.duration=0.7", "--set", "loop.delay=2", "--out", "there"),
    )  # fmt: skip
    done = invoke("export", "heave_step", *more)
    (chosen,), given = notes.one("export")
    loop = (chosen.loop.duration, chosen.loop.delay)
    versions, targets = list(given.pop("fmi")), given.pop("targets")
    assert list(given.pop("forms")) == (["fmu"] if is_default else ["fmu", "c", "ssp"])
    if is_default:
        assert (loop, versions, targets) == ((2.0, 1), ["2.0", "3.0"], ["native"])
        other: dict[str, Any] = {"out": Path(), "reference": "inside", "safe_force": "feedforward", "real": "double"}
        assert given == {**other, "frozen": None, "anyway": False}
        total = number_of_steps(versions, targets)
    else:
        assert (loop, versions, targets) == ((0.7, 2), ["3.0"], ["x86_64-windows", "aarch64-linux"])
        other = {"out": Path("there"), "reference": "inputs", "safe_force": "zero", "real": "float"}
        assert given == {**other, "frozen": (50, 0.0015), "anyway": True}
        # the C at once; the FMUs; an SSP with two FMUs of version 2.0, and itself
        total = 1 + number_of_steps(["3.0"], targets) + 1 + 2 * number_of_steps(["2.0"], targets)
    assert done.stderr == "warning: take care\n"
    where = "." if is_default else "there"
    said(done, "it is stable", f"Done in T s. Wrote to {where} (4 kB):")
    assert "  d/a.c, b.h" in done.stdout.splitlines()
    assert notes.bars[-2:] == [
        {"description": "compiling", "total": total, "done": 1},
        {"description": "judging the members", "total": 7, "visible": True, "completed": 3, "done": 0},
    ]


@pytest.mark.parametrize("kind", ["folder", "file", "out"])
def test_frf(notes: Notes, kind: str) -> None:
    found = SimpleNamespace(notes=("a note", "another"))
    notes.replace("harness.experiment.frf.frf", found)
    notes.replace("harness.experiment.frf.frf_files", {"frf.csv": b"x" * 100, "frf.svg": b""})
    notes.replace("harness.experiment.frf.frf_sheet", sheet("responses"))
    Path("run 1").mkdir()
    Path("run 1/record.csv").touch()
    record = "run 1/record.csv" if kind == "file" else "run 1"
    done = invoke("frf", record, *(("--out", "here", "--experiment", "circle") if kind == "out" else ()))
    place = "here" if kind == "out" else "run 1"
    said(done, "responses", "a note", "another", f"Done in T s. Wrote to {place} (0.1 kB):")
    assert "responses!" in done.stdout
    (given,), options = notes.one("frf")
    experiment = options.pop("experiment")
    assert (given, options) == (Path(record), {})
    assert "circle" in experiment.title if kind == "out" else experiment is None
    assert notes.one("frf_files") == notes.one("frf_sheet") == ((found,), {})
    assert {path.name for path in Path(place).glob("frf*")} == {"frf.csv", "frf.svg"}


class Identified(SimpleNamespace):
    def platform(self, nominal: Platform) -> tuple[str, Platform]:
        return ("identified", nominal)


@pytest.mark.parametrize("kind", ["default", "all", "share"])
def test_identify(notes: Notes, kind: str) -> None:
    found = Identified(
        notes=["half a note"], not_excited=kind != "share", alarms=["bad", "worse"] if kind == "all" else []
    )
    notes.replace("harness.identify.log.read_log", act=lambda log, *_, **__: f"read {log}")
    notes.replace("harness.identify.identify.identify", found)
    notes.replace("harness.identify.retuned.before_and_after", SimpleNamespace(sheet=sheet("before and after")))
    notes.replace("harness.identify.files.identification_files", {"platform.toml": b"x" * 3000, "identify.html": b""})
    notes.replace("harness.identify.tables.sheets_of", [sheet("parameters"), sheet("residuals")])
    opened = notes.opened()
    arguments = {
        "default": ("log.csv", "--estimate", "platform_mass"),
        "share": ("a/log.csv", "--estimate", "platform_mass", "--preset", "motion_base", "--validation", "0.35"),
        "all": (
            *("one.csv", "two.csv", "--estimate", "leg_armature,platform_com", "--platform", "own.toml"),
            *("--method", "output_error", "--force-per-current", "57.5", "--holds-force", "--validate", "three.csv"),
            *("--validate", "four.csv", "--pose-frame", "own", "--experiment", "circle", "--set", "loop.delay=3"),
            *("--out", "there", "--open"),
        ),
    }[kind]
    done = invoke("identify", *arguments)
    nominal = {"default": load_preset("liu2000"), "share": load_preset("motion_base"), "all": UNEVEN}[kind]
    out = {"default": "results/identify_log", "share": "results/identify_log", "all": "there"}[kind]
    lines = ["half a note", f"Done in T s. Wrote to {out} (3 kB):"]
    tables = ["parameters", "residuals"] + ["before and after"] * (kind == "all")
    factor, holds = (57.5, True) if kind == "all" else (None, None)
    logs = {"default": ["log.csv"], "share": ["a/log.csv"], "all": ["one.csv", "two.csv", "three.csv", "four.csv"]}[
        kind
    ]
    assert notes.calls.pop("read_log") == [((Path(log), factor), {"holds_force": holds}) for log in logs]
    read = [f"read {log}" for log in logs]
    expected: dict[str, Any] = {}
    if kind == "all":
        expected = {"validation": read[2:], "pose_frame": "own"}
    elif kind == "share":
        expected = {"validation": 0.35}
    names = "leg_armature,platform_com" if kind == "all" else "platform_mass"
    method = "output_error" if kind == "all" else "linear"
    assert notes.one("identify") == ((read[:2] if kind == "all" else read, nominal, names, method), expected)
    more: list[Any] = []
    if kind == "all":
        (experiment, of, changed), _ = notes.one("before_and_after")
        assert (experiment.loop.delay, of, changed) == (3, nominal, ("identified", nominal))
        more = [notes.bars[-1]["description"]]
        assert more == ["before and after"]
    files, options = notes.one("identification_files")
    assert (files[:2], [each.title for each in files[2]], options) == ((found, nominal), tables[2:], {})
    assert notes.one("sheets_of") == ((found,), {})
    if kind == "all":
        assert opened == [Path(out, "identify.html").absolute().as_uri()]
        lines.append(f"Next: gough-stewart excite --platform own.toml --estimate {names}")
        assert done.exit_code == 3
        assert done.stderr == "alarm: bad\nalarm: worse\n"
        done.exit_code = 0
    else:
        assert opened == []
        lines.append(f"Open {out}/identify.html in a browser.")
        if kind == "default":
            lines.append(f"Next: gough-stewart excite --preset liu2000 --estimate {names}")
        assert done.stderr == ""
    said(done, *tables, *lines)


@pytest.mark.parametrize("is_default", [True, False])
def test_margins(notes: Notes, is_default: bool) -> None:
    notes.replace("harness.experiment.analysis.margins", "margins found")
    notes.replace("harness.experiment.analysis.margins_files", {"margins.json": b"x" * 700})
    notes.replace("harness.experiment.analysis.margins_sheets", [sheet("gains"), sheet("modes")])
    more = () if is_default else ("--set", "controller.bandwidth=3.5", "--set", "loop.delay=2", "--out", "x y")
    done = invoke("margins", "heave_step", *more)
    out = "results/margins_heave_step" if is_default else "x y"
    said(done, "gains", "modes", f"Done in T s. Wrote {out}/margins.json (0.7 kB).")
    (chosen,), given = notes.one("margins")
    assert given == {}
    assert chosen.loop.delay == (1 if is_default else 2)
    assert not is_default or chosen.title == "heave step of 0.05 m"
    assert notes.one("margins_files") == notes.one("margins_sheets") == (("margins found",), {})


@pytest.mark.parametrize("kind", ["default", "order", "report", "open", "preset", "own"])
def test_reproduce(notes: Notes, kind: str) -> None:
    files = {"report.md": b"x" * 10} | ({"report.html": b"x" * 1990} if kind in ("report", "open") else {})
    of_paper = kind in ("default", "order", "report", "open")
    report = {"readings": ["one"] if of_paper else [], "published_forces": "forces"}
    notes.replace(
        "harness.paper.reproduce.reproduce", SimpleNamespace(report=report, files=files, agrees=kind != "preset")
    )
    notes.replace("harness.paper.report.report_sheets", [sheet("agreement")])
    notes.replace("harness.paper.report.weight_sentence", "the weight")
    opened = notes.opened()
    done = invoke("reproduce", *{
        "default": (), "report": ("--report",),
        "order": ("--order", "minus-first", "--preset", "liu2000", "--out", "o"),
        "open": ("--open", "--order", "plus-first"), "preset": ("--preset", "motion_base"),
        "own": ("--platform", "own.toml", "--out", "o"),
    }[kind])  # fmt: skip
    out = {"preset": "results/reproduce_motion_base", "own": "o", "order": "o"}.get(kind, "results/reproduce_liu2000")
    (case, errors, with_page), given = notes.one("reproduce")
    assert (errors is terminal.errors, with_page, given) == (True, kind in ("report", "open"), {})
    assert ("− before +" in case.title) == (kind == "order")
    expected = {"preset": load_preset("motion_base"), "own": UNEVEN}.get(kind, load_preset("liu2000"))
    assert case.platform.name == expected.name
    assert kind == "order" or case.platform == expected
    assert notes.one("report_sheets") == ((report,), {})
    assert {path.name for path in Path(out).iterdir()} == files.keys()
    lines = ["agreement", *(["the weight"] if of_paper else [])]
    if len(files) == 2:
        lines.append(f"Done in T s. Wrote to {out} (2 kB):")
        lines += [] if kind == "open" else [f"Open {out}/report.html in a browser."]
    else:
        lines.append(f"Done in T s. Wrote {out}/report.md (0.01 kB).")
    if of_paper:
        assert notes.one("weight_sentence") == (("forces",), {})
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


def recorded(status: str = "completed", time: float = 0.5, **more: Any) -> Record:
    """Half a second of sines, as if it had been run."""
    made = waving_record(load_preset("motion_base"), **more)
    outcome = {"status": status, "time": time, "cause": None if status == "completed" else "a cause"}
    return Record(made.table, {**made.metadata, "outcome": outcome})


RUNS = "harness.experiment"


@pytest.mark.parametrize("kind", ["default", "all", "report", "open", "own unit", "member"])
def test_run(notes: Notes, kind: str) -> None:  # noqa: PLR0915
    record = recorded()

    def act(*_: Any, **options: Any) -> None:
        options["status"]("building")
        options["progress"](0.123)
        options["warn"]("near a limit")

    def write(_: Record, folder: Path, with_page: bool) -> tuple[list[str], str]:
        folder.mkdir(parents=True)
        names = ["record.csv", "report.html"] if with_page else ["record.csv", "metrics.json"]
        for name in names:
            (folder / name).write_bytes(b"x" * 600)
        return names, "measured"

    @contextmanager
    def exported(*args: Any, **options: Any) -> Iterator[str]:
        options["warn"]("run anyway")
        args[2]("exporting")
        units.append((args[0].title, args[1], options["anyway"]))
        yield "unit made"

    units: list[Any] = []
    notes.replace(f"{RUNS}.run.run", record, act)
    notes.replace(f"{RUNS}.files.write_results", act=write)
    notes.replace(f"{RUNS}.files.warnings_of", ["it hangs"])
    notes.replace("harness.results.tables.metrics_sheets", [sheet("errors")])
    notes.set("gough_stewart.harness.export.own_unit.exported_controller", exported)
    opened = notes.opened()
    done = invoke("run", "heave_step", *{
        "default": (),
        "all": (*("--plant", "fmu2", "--fmu", "u.fmu", "--controller", "fmu3", "--anyway", "--no-python", "--report"),
                *("--out", "o p", "--set", "loop.duration=0.75", "--set", "loop.delay=2")),
        "report": ("--report",),
        "open": ("--open", "--out", "o"),
        "own unit": ("--controller", "~x/c.fmu"),
        "member": ("--member", "4", "--plant", "fmu3"),
    }[kind])  # fmt: skip
    out = {"all": "o p", "open": "o", "member": "results/run_heave_step_member_4"}.get(kind, "results/run_heave_step")
    (chosen,), given = notes.one("run")
    expected: dict[str, Any] = {"plant": None, "fmu": None, "controller": None, "member": None}
    if kind == "all":
        expected |= {"plant": "fmu2", "fmu": Path("u.fmu"), "controller": "unit made"}
        assert units == [("heave step of 0.05 m", "3.0", True)]
    elif kind == "own unit":
        expected["controller"] = Path("~x/c.fmu")
    elif kind == "member":
        expected |= {"member": 4, "plant": "fmu3"}
    assert given == expected
    duration, delay = (0.75, 2) if kind == "all" else (2.0, 1)
    assert (chosen.loop.duration, chosen.loop.delay) == (duration, delay)
    with_page = kind in ("all", "report", "open")
    assert notes.one("write_results") == ((record, Path(out), with_page), {})
    assert notes.one("metrics_sheets") == (("measured",), {})
    assert notes.one("warnings_of") == ((record,), {})
    warnings = ["warning: near a limit", "warning: it hangs"]
    if kind == "all":
        warnings.insert(0, "warning: run anyway")
    if kind == "own unit":
        warnings.insert(0, "warning: the stability of the loop with ~x/c.fmu is not judged: an FMU has no linear form")
    assert done.stderr.splitlines() == warnings
    # bars for imports come first
    expected_bar = {"description": "files and figures", "total": None, "completed": 0.123, "done": 0}
    assert notes.bars[-1] == expected_bar
    lines = ["errors", f"Completed: 0.5 s simulated in T s. Wrote to {out} (1.2 kB):"]
    page = f"Open {out}/report.html in a browser."
    quoted = f"'{out}'" if " " in out else out
    lines += [page] if with_page and kind != "open" else []
    lines += [] if with_page else [f"Next: gough-stewart view {quoted} --open"]
    assert opened == ([Path(out, "report.html").absolute().as_uri()] if kind == "open" else [])
    done_lines = [line.replace("0.5 s simulated", "0.5 S simulated") for line in lines]
    assert done.exit_code == 0, done.output
    plain = [line for line in done.stdout.splitlines() if line[:1] not in "┏┃┡│└├ "]
    assert [re.sub(r"in \d+\.\d s", "in T s", line) for line in plain] == [
        line.replace("0.5 S simulated", "0.5 s simulated") for line in done_lines
    ]


@pytest.mark.parametrize(
    ("status", "time", "code", "end"),
    [
        ("diverged", 0.3123456789, 3, "diverged at 0.312346 s: a cause"),
        ("stopped", 1.5, 3, "stopped at 1.5 s: a cause"),
        ("interrupted", 0.25, 130, "interrupted at 0.25 s: a cause"),
    ],
)
def test_how_a_run_ends(notes: Notes, status: str, time: float, code: int, end: str) -> None:
    """Expected: the files, how much was simulated of how much, and the cause with the exit code of the table."""
    notes.replace(f"{RUNS}.run.run", recorded(status, time))
    notes.replace(f"{RUNS}.files.write_results", (["a"], "measured"))
    notes.replace(f"{RUNS}.files.warnings_of", [])
    notes.replace("harness.results.tables.metrics_sheets", [])
    Path("o").mkdir()
    Path("o/a").touch()
    done = invoke("run", "heave_step", "--set", "loop.duration=1.75", "--out", "o")
    assert done.exit_code == code
    assert done.stderr == f"{end}\n"
    assert done.stdout.startswith(f"Not completed: {time:.6g} of 1.75 s simulated in ")


@pytest.mark.parametrize(("growing", "code"), [(False, 0), (True, 3)])
def test_a_loop_that_moves_by_itself(notes: Notes, growing: bool, code: int) -> None:
    """Expected: a warning with the frequency of a steady cycle, and no success of one that grows."""
    still = waving_record(load_preset("motion_base"), size=0.0)
    record = oscillating(still)
    if growing:
        wave = record["error.leg_length[5]"] * 30 ** (record["time"] / 0.5) / 10
        record = Record(record.table.with_columns(**{"error.leg_length[5]": wave}), record.metadata)
    notes.replace(f"{RUNS}.run.run", record)
    notes.replace(f"{RUNS}.files.write_results", (["a"], "measured"))
    notes.replace(f"{RUNS}.files.warnings_of", [])
    notes.replace("harness.results.tables.metrics_sheets", [])
    Path("o").mkdir()
    Path("o/a").touch()
    done = invoke("run", "heave_step", "--out", "o")
    assert done.exit_code == code
    (line,) = done.stderr.splitlines()
    assert done.stdout.startswith("Completed: 0.5 s simulated in ")
    if growing:
        assert re.match(r"growing: leg 5: by itself, the error grows at (39\.\d|40|40\.\d) Hz from ", line)
    else:
        assert re.match(r"warning: leg 5 oscillates at (39\.\d|40|40\.\d) Hz by itself", line)


class Searched(SimpleNamespace):
    pass


@pytest.mark.parametrize("kind", ["default", "ensemble", "without", "all", "interrupted"])
def test_tune(notes: Notes, kind: str) -> None:
    found = Searched(left_out=3 if kind == "all" else 0, is_interrupted=kind == "interrupted")
    search = SimpleNamespace(
        goal=SimpleNamespace(metric="tracking.position.norm_rms"),
        best=SimpleNamespace(value=0.00123456),
        generation=[0, 1, 4],
    )

    def act(*_: Any, **options: Any) -> None:
        options["status"](SimpleNamespace(goal=search.goal, best=None, generation=[0]))
        shown.append(notes.bars[-1]["description"])
        options["status"](search)
        shown.append(notes.bars[-1]["description"])

    shown: list[str] = []
    notes.replace("harness.tuning.tune.tune", found, act)
    notes.replace("harness.tuning.files.tuning_files", {"tuned.toml": b"x" * 400})
    notes.replace("harness.tuning.result.tuning_sheets", [sheet("tuned")])
    notes.replace("harness.tuning.result.statement", "it is better")
    notes.replace("harness.experiment.setting_file.text_with_settings", "text")
    base = ("--vary", "controller.bandwidth=1..6Hz", "--minimise", "tracking.position.norm_rms")
    name = "heave_step" if kind in ("default", "interrupted") else "heave_tolerances"
    done = invoke("tune", name, *base, *{
        "ensemble": ("--over-ensemble", " quantile = 0.8"),
        "all": (*("--vary", "loop.delay=1..3", "--subject-to", "disk_margin > 0.5", "--subject-to", "force.peak < 5"),
                *("--over-ensemble", "quantile=1", "--members", "7", "--fresh", "8", "--generations", "9"),
                *("--population", "11", "--seed", "12", "--set", "loop.duration=0.3", "--out", "o p", "--no-python")),
    }.get(kind, ()))  # fmt: skip
    out = "o p" if kind == "all" else f"results/tune_{name}"
    settings = ["loop.duration=0.3"] if kind == "all" else []
    (chosen, vary, minimise), given = notes.one("tune")
    assert minimise == "tracking.position.norm_rms"
    assert vary == ["controller.bandwidth=1..6Hz", *(["loop.delay=1..3"] if kind == "all" else [])]
    expected: dict[str, Any] = {"quantile": 0.95, "members": None, "fresh": None, "generations": 25, "population": None}
    expected |= {"seed": 0, "subject_to": []}
    if kind == "all":
        expected |= {"quantile": 1.0, "members": 7, "fresh": 8, "generations": 9, "population": 11, "seed": 12}
        expected["subject_to"] = ["disk_margin > 0.5", "force.peak < 5"]
    elif kind == "ensemble":
        expected["quantile"] = 0.8
    given["subject_to"] = list(given["subject_to"])
    assert given == expected
    # the members take part only if they are asked for
    assert (chosen.ensemble is not None) == (kind in ("ensemble", "all"))
    assert chosen.loop.duration == 0.3 or kind != "all"
    checked, options = notes.one("text_with_settings")
    assert (checked[0], list(checked[1]), options) == (name, settings, {"folder": Path(out)})
    files, _ = notes.one("tuning_files")
    assert (*files[:3], list(files[3])) == (found, name, Path(out), settings)
    assert notes.one("tuning_sheets") == notes.one("statement") == ((found,), {})
    assert shown == ["best none yet", "best 1.235 mm"]
    generations = expected["generations"]
    bar = {"description": "files and figures", "total": None, "completed": 5, "done": 0}
    assert notes.bars[-1] == bar or notes.bars[-1] == {**bar, "total": generations}
    place = f"'{out}/tuned.toml'" if " " in out else f"{out}/tuned.toml"
    errors = {
        "all": "warning: 3 members have impossible parameters and are left out\n",
        "interrupted": "interrupted; the best candidate so far is written\n",
    }
    assert done.stderr == errors.get(kind, "")
    assert done.exit_code == (130 if kind == "interrupted" else 0)
    done.exit_code = 0
    said(
        done,
        "tuned",
        "it is better",
        f"Done in T s. Wrote {out}/tuned.toml (0.4 kB).",
        f"Next: gough-stewart run {place}",
    )


@pytest.mark.usefixtures("notes")
@pytest.mark.parametrize(
    "text", ["0.95", "quantile", "quantile=", "quantile=0", "quantile=1.01", "quantile=x", "share=0.5"]
)
def test_a_quantile_has_a_name_and_is_a_share(text: str) -> None:
    done = invoke("tune", "heave_tolerances", "--vary", "a=1..2", "--minimise", "b", "--over-ensemble", text)
    assert done.exit_code == 2
    message = f"--over-ensemble {text}: expected quantile=Q with Q above 0, up to 1, such as quantile=0.95"
    assert done.stderr == f"error: {message}\n"


@pytest.mark.usefixtures("notes")
def test_an_ensemble_is_needed_to_tune_over_it() -> None:
    done = invoke("tune", "heave_step", "--vary", "controller.bandwidth=1..6Hz", "--minimise", "force.peak",
                  "--over-ensemble", "quantile=0.5")  # fmt: skip
    assert done.exit_code == 2
    assert (
        "--over-ensemble quantile=0.5: heave_step has no [ensemble], so there are no machines that differ"
        in done.stderr
    )


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
    notes.replace("model.workspace_grid.sweep", space, act)
    notes.replace(f"{WORKSPACE}.explained.notices", ["nothing is reached"] if kind == "two" else [], lambda _: [])
    notes.replace(f"{WORKSPACE}.figures.workspace_figures", {"workspace.png": b"p" * 100, "workspace.svg": b"s" * 200})
    notes.replace(f"{WORKSPACE}.page.workspace_page", b"h" * 300)
    notes.replace(f"{WORKSPACE}.tables.workspace_csv", b"c" * 400)
    notes.replace(f"{WORKSPACE}.tables.sheets_of", [sheet("swept"), Sheet("empty", ("",)), sheet("limits")])
    notes.replace(f"{WORKSPACE}.tables.size_text", "3 of 7 poses")
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
    written = {path.name: path.read_bytes() for path in Path(out).iterdir()}
    assert written == {
        "workspace.csv": b"c" * 400, "workspace.png": b"p" * 100, "workspace.svg": b"s" * 200,
        "workspace.html": b"h" * 300,
    }  # fmt: skip
    assert {name: calls[0][0][0] is space for name, calls in notes.calls.items()} == dict.fromkeys(
        ("notices", "workspace_figures", "workspace_page", "workspace_csv", "sheets_of", "size_text"), True
    )
    assert done.stderr == ("warning: nothing is reached\n" if kind == "two" else "")
    page = [] if kind == "open" else [f"Open {out}/workspace.html in a browser."]
    said(done, "swept", "limits", "3 of 7 poses", f"Done in T s. Wrote to {out} (1 kB):", *page)
    assert opened == ([Path(out, "workspace.html").absolute().as_uri()] if kind == "open" else [])


class Checked(SimpleNamespace):
    def settings_that_fit(self, what: str) -> dict[str, str]:
        return {"fit by": what}


@pytest.mark.parametrize("kind", ["within", "beyond", "near", "time", "amplitude", "misses"])
def test_check(notes: Notes, kind: str) -> None:
    """Expected: exit code 3 beyond limits; a fit only of what is beyond or too near, beside the experiment."""
    first = Checked(
        within=kind in ("within", "near"), keeps_margin=kind == "within", needs=SimpleNamespace(notes=["10 kW", "3 N"]),
        experiment=SimpleNamespace(folder=Path("beside")), shares=[],
    )  # fmt: skip
    second = Checked(within=kind != "misses", keeps_margin=True, shares=[], needs=SimpleNamespace(notes=["less"]))
    results = [first, second]
    Path("beside").mkdir()
    notes.replace("harness.experiment.checking.check", act=lambda *_: results.pop(0))
    notes.replace("harness.experiment.check_files.check_files", {"check.json": b"x" * 50})
    notes.replace("harness.motion.shares_tables.shares_sheets", [sheet("shares")])
    notes.replace("harness.experiment.checking.verdict", act=lambda found: "first" if found is first else "second")
    notes.replace("harness.experiment.setting_file.text_with_settings", "fitted text")
    fit = {"within": "time", "near": "time", "time": "time", "amplitude": "amplitude", "misses": "amplitude"}.get(kind)
    more = ("--set", "loop.delay=1", "--out", "o") if kind == "time" else ()
    done = invoke("check", "circle", *more, *(("--fit", fit) if fit else ()))
    out = "o" if kind == "time" else "results/check_circle"
    lines = ["shares", "Needs: 10 kW; 3 N.", "first", f"Done in T s. Wrote {out}/check.json (0.05 kB)."]
    settings = ["loop.delay=1"] if kind == "time" else []
    calls: list[Any] = [(("circle", settings), {})]
    if kind not in ("within", "beyond"):
        calls.append((("beside/circle-fitted.toml",), {}))
        lines += ["circle-fitted.toml:", "shares", "Needs: less.", "second"]
        lines += ["Wrote beside/circle-fitted.toml (0.011 kB).", "Next: gough-stewart run beside/circle-fitted.toml"]
        assert Path("beside/circle-fitted.toml").read_text() == "fitted text"
        assert notes.one("text_with_settings") == (("circle", settings, {"fit by": fit}), {})
    else:
        assert list(Path("beside").iterdir()) == []
    assert notes.calls["check"] == calls
    assert done.exit_code == (3 if kind in ("beyond", "misses") else 0)
    done.exit_code = 0
    said(done, *lines)


def members(*outcomes: str) -> Any:
    """Of an ensemble in which loops also grow by themselves, 3 mm at 2.5 Hz."""
    ended = ["completed" if outcome == "grows" else outcome for outcome in outcomes]
    table = {
        "member": list(range(len(outcomes))),
        "outcome": ended,
        "cause": [None if outcome == "completed" else f"cause {k}" for k, outcome in enumerate(ended)],
        "oscillation": ["growing" if outcome == "grows" else None for outcome in outcomes],
        AMPLITUDE: [3e-3 if outcome == "grows" else None for outcome in outcomes],
        FREQUENCY: [2.5 if outcome == "grows" else None for outcome in outcomes],
    }
    schema = {
        "oscillation": polars.String,
        "cause": polars.String,
        AMPLITUDE: polars.Float64,
        FREQUENCY: polars.Float64,
    }
    return SimpleNamespace(members=polars.DataFrame(table, schema_overrides=schema), metadata={"tolerance": 1e-9})


@pytest.mark.parametrize("kind", ["default", "all", "scheduler", "none", "grows"])
def test_ensemble(notes: Notes, kind: str) -> None:
    found = {
        "none": members("diverged", "stopped", "diverged"),
        "grows": members("diverged", "grows", "stopped"),
    }.get(kind, members("diverged", "completed"))

    def act(*_: Any, **options: Any) -> None:
        options["status"]("chunks")
        seen.append(dict(notes.bars[-1]))
        options["progress"](12, 40)
        seen.append(dict(notes.bars[-1]))

    def write(_: Any, folder: Path) -> tuple[list[str], list[Sheet]]:
        for name in ("members.parquet", "bands.parquet", "ensemble.json", "report.html"):
            (folder / name).write_bytes(b"x" * 250)
        return ["report.html"], [sheet("members"), sheet("metrics")]

    seen: list[dict[str, Any]] = []
    opened = notes.opened()
    notes.replace("harness.ensemble.ensemble.ensemble", found, act)
    notes.replace("harness.ensemble.files.write_report", act=write)
    notes.replace(
        "harness.ensemble.statistics.integration_warning", "too coarse" if kind == "all" else None, lambda *_: ""
    )
    done = invoke("ensemble", "heave_tolerances", *{
        "all": (*("--members", "40", "--seed", "5", "--out", "o p", "--open", "--resume", "--workers", "3"),
                *("--set", "loop.duration=0.3", "--no-python")),
        "scheduler": ("--scheduler", "tcp://h:1"),
    }.get(kind, ()))  # fmt: skip
    out = "o p" if kind == "all" else "results/ensemble_heave_tolerances"
    (chosen,), given = notes.one("ensemble")
    expected: dict[str, Any] = {"members": None, "seed": None, "out": Path(out), "resume": False}
    expected |= {"workers": None, "scheduler": None}
    if kind == "all":
        expected |= {"members": 40, "seed": 5, "resume": True, "workers": 3}
        assert chosen.loop.duration == 0.3
    elif kind == "scheduler":
        expected["scheduler"] = "tcp://h:1"
    assert given == expected
    assert seen[0]["description"] == "chunks"
    assert {key: seen[1][key] for key in ("completed", "total", "description")} == {
        "completed": 12, "total": 40, "description": chosen.title,
    }  # fmt: skip
    assert notes.bars[-1]["description"] == "figures and page"
    assert notes.one("write_report") == ((found, Path(out)), {})
    warning = "warning: too coarse\n" if kind == "all" else ""
    if kind in ("none", "grows"):
        assert done.exit_code == 3
        warning = "error: none of 3 members completed its run; the first: cause 0\n"
        done.exit_code = 0
    if kind == "grows":
        text = "the loops of 1 of 3 members grow by themselves; member 1 has the largest amplitude, 3 mm at 2.5 Hz. "
        text += "`run --member K` shows one"
        warning = f"warning: {text}\nerror: no member completed its run with a loop that does not grow: {text}\n"
    assert done.stderr == warning
    page = [] if kind == "all" else [f"Open {out}/report.html in a browser."]
    said(done, "members", "metrics", f"Done in T s. Wrote to {out} (1 kB):", *page)
    assert "  members.parquet, bands.parquet, ensemble.json, report.html" in done.stdout.splitlines()
    assert opened == ([Path(out, "report.html").absolute().as_uri()] if kind == "all" else [])


@pytest.mark.parametrize("fails", ["", "a", "b"])
def test_ensembles_compared(notes: Notes, fails: str) -> None:
    """Expected: the first with the settings, the second as it is, all other options for both."""
    a = members("diverged", "diverged") if fails == "a" else members("completed", "diverged")
    b = members("stopped") if fails == "b" else members("completed")

    def act(_: Any, __: Any, folder: Path, status: Callable[[str], None], **options: Any) -> None:
        status("first")
        options["progress"](3, 8)
        folder.mkdir(parents=True)
        for name in ("heave_tolerances", "circle", "differences.parquet", "compare.html"):
            (folder / name).write_bytes(b"x" * 500)

    notes.replace("harness.ensemble.compared.run_compared", SimpleNamespace(a=a, b=b), act)
    notes.replace("harness.ensemble.compare.compare_sheets", [sheet("differences")])
    options = ("--members", "8", "--seed", "2", "--workers", "3", "--resume", "--set", "loop.duration=0.4")
    done = invoke("ensemble", "heave_tolerances", "--compare", "circle", *options)
    out = "results/ensemble_heave_tolerances_compared"
    (experiments, names, folder, _), given = notes.one("run_compared")
    assert [each.title for each in experiments][1].startswith("circle")
    assert experiments[0].loop.duration == 0.4 != experiments[1].loop.duration
    assert (tuple(names), folder) == (("heave_tolerances", "circle"), Path(out))
    assert given == {"members": 8, "seed": 2, "resume": True, "workers": 3, "scheduler": None}
    assert {k: notes.bars[-1][k] for k in ("description", "completed", "total")} == {
        "description": "first", "completed": 3, "total": 8,
    }  # fmt: skip
    failed = {"a": "error: none of 2 members completed its run; the first: cause 0\n",
              "b": "error: none of 1 members completed its run; the first: cause 0\n"}  # fmt: skip
    assert done.stderr == failed.get(fails, "")
    assert done.exit_code == (3 if fails else 0)
    done.exit_code = 0
    said(done, "differences", f"Done in T s. Wrote to {out} (2 kB):", f"Open {out}/compare.html in a browser.")
    assert notes.one("compare_sheets")[1] == {}
    other = invoke("ensemble", "heave_tolerances", "--compare", "circle", "--out", "elsewhere")
    assert notes.one("run_compared")[0][2] == Path("elsewhere")
    assert "elsewhere" in other.stdout


@pytest.mark.usefixtures("notes")
def test_presets_and_experiments_are_listed_with_their_numbers() -> None:
    """Expected: of each platform the mass of its file, the mean length and the condition of its legs at home.

    Recomputed: |t + R p − b|, and the ratio of singular values of the rows [u, c × u / ρ], ρ the mean arm's length.
    """
    done = invoke("presets", columns=250)
    heads = [cell.strip() for cell in done.stdout.splitlines()[1].strip("┃").split("┃")]
    assert heads == ["name", "platform kg", "home leg m", "condition", "source"]
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
        assert length == f"{size.mean():.4g}"
        assert source == p.source
        assert f'name = "{name}"' in preset_text(name)
        u = legs / size[:, None]
        scaled = np.hstack([u, np.cross(arms, u) / p.characteristic_length])
        values = np.linalg.svd(scaled, compute_uv=False)
        assert condition == f"{values[0] / values[-1]:.2f}"
    listed = invoke("experiments", columns=300).stdout
    assert [cell.strip() for cell in listed.splitlines()[1].strip("┃").split("┃")] == ["name", "platform", "what"]
    (row,) = [line for line in listed.splitlines() if line.startswith("│ heave_tolerances ")]
    name, platform, what = [cell.strip() for cell in row.strip("│").split("│")]
    assert platform == "motion_base"
    assert f'description = "{what}"' in invoke("experiments", "heave_tolerances").stdout
