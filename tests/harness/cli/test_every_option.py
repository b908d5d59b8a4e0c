"""Every option of every command, alone and with all others: what the function behind the command is asked.

The functions are replaced by notes of what they were called with, so a call costs nothing; what they do with it is
tested in their rooms. Expected: the values as given, in SI units, and the defaults that the help states.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import polars
import pytest

import gough_stewart as gs
from gough_stewart.harness.ensemble.data import AMPLITUDE, FREQUENCY
from gough_stewart.harness.ensemble.worst import Worst
from gough_stewart.harness.experiment.run import Written
from gough_stewart.harness.report.codec import from_json
from gough_stewart.harness.report.document import Note, Report
from gough_stewart.harness.results.record import Record
from gough_stewart.model.platform import load_preset
from tests.support.commands import invoke
from tests.support.noted_calls import Notes, made_report, said
from tests.support.records import oscillating, waving_record

BAR = Path("bar")


@pytest.mark.parametrize("kind", ["folder", "file", "out"])
def test_frf(notes: Notes, kind: str) -> None:
    told = replace(made_report("responses"), notes=tuple(Note(text, "warning") for text in ("a note", "another")))
    found = SimpleNamespace(notes=("a note", "another"), requirements=(), report=lambda **_: told)
    notes.replace("harness.experiment.frf.frf", found)
    notes.replace("harness.experiment.frf.frf_files", {"frf.csv": b"x" * 100, "frf.svg": b""})
    Path("run 1").mkdir()
    Path("run 1/record.csv").touch()
    record = "run 1/record.csv" if kind == "file" else "run 1"
    done = invoke("frf", record, *(("--out", "here", "--experiment", "circle") if kind == "out" else ()))
    place = "here" if kind == "out" else "run 1"
    said(done, "responses found", "responses", f"Done in T s. Wrote to {place} (0.1 kB):")
    assert "responses!" in done.stdout
    assert done.stderr == "warning: a note\nwarning: another\n"
    (given,), options = notes.one("frf")
    experiment = options.pop("experiment")
    assert (given, options) == (Path(record), {})
    assert "circle" in experiment.title if kind == "out" else experiment is None
    assert notes.one("frf_files") == ((found,), {})
    assert {path.name for path in Path(place).glob("frf*")} == {"frf.csv", "frf.svg"}


def size_of(folder: str) -> str:
    """The size of all files in a folder, in kB with three digits."""
    return f"{sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e3:.3g} kB"


@pytest.mark.parametrize("is_default", [True, False])
def test_margins(notes: Notes, is_default: bool) -> None:
    found = SimpleNamespace(report=lambda *, charts: made_report("gains") if not charts else None)
    notes.replace("harness.experiment.margins.margins", found)
    notes.replace("harness.experiment.margins.margins_file", b"x" * 700)
    more = () if is_default else ("--set", "controller.bandwidth=3.5", "--set", "loop.delay=2", "--out", "x y")
    done = invoke("margins", "heave_step", *more)
    out = "results/margins_heave_step" if is_default else "x y"
    said(done, "gains found", "gains", f"Done in T s. Wrote to {out} ({size_of(out)}):")
    (chosen,), given = notes.one("margins")
    assert given == {}
    assert chosen.loop.delay == (1 if is_default else 2)
    assert not is_default or chosen.title == "heave step"
    assert notes.one("margins_file") == ((found,), {})
    assert Path(out, "margins.json").read_bytes() == b"x" * 700
    assert from_json(Path(out, "report.json").read_bytes()).verdict.text == "gains found"


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

    def write(_: Record, folder: Path, *, page: bool, notes: list[Note], **__: Any) -> Written:
        folder.mkdir(parents=True)
        names = ["record.csv", "report.html"] if page else ["record.csv", "metrics.json"]
        for name in names:
            (folder / name).write_bytes(b"x" * 600)
        return Written(names, replace(made_report("errors"), notes=tuple(notes)))

    @contextmanager
    def exported(*args: Any, **options: Any) -> Iterator[str]:
        options["warn"]("run anyway")
        args[2]("exporting")
        units.append((args[0].title, args[1], options["anyway"]))
        yield "unit made"

    units: list[Any] = []
    notes.replace(f"{RUNS}.run.run", record, act)
    notes.replace(f"{RUNS}.run.write_results", act=write)
    notes.replace(f"{RUNS}.run.warnings_of", ["it hangs"])
    notes.set("gough_stewart.harness.export.own_unit.exported_controller", exported)
    opened = notes.opened()
    done = invoke("run", "heave_step", *{
        "default": (),
        "all": (*("--plant", "fmu2", "--fmu", "u.fmu", "--controller", "fmu3", "--anyway", "--no-python", "--report"),
                *("--figures", "--require", "force.peak < 2 kN", "--out", "o p", "--set", "loop.duration=0.75"),
                *("--set", "loop.delay=2")),
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
        assert units == [("heave step", "3.0", True)]
    elif kind == "own unit":
        expected["controller"] = Path("~x/c.fmu")
    elif kind == "member":
        expected |= {"member": 4, "plant": "fmu3"}
    assert given == expected
    duration, delay = (0.75, 2) if kind == "all" else (2.0, 1)
    assert (chosen.loop.duration, chosen.loop.delay) == (duration, delay)
    with_page = kind in ("all", "report", "open")
    (of, folder), asked = notes.one("write_results")
    assert (of, folder) == (record, Path(out))
    assert {name: asked[name] for name in ("page", "figures", "charts")} == {
        "page": with_page, "figures": kind == "all", "charts": False,
    }  # fmt: skip
    assert [each.text for each in asked["requirements"]] == (["force.peak < 2 kN"] if kind == "all" else [])
    assert asked["notes"] == [Note("it hangs", "warning")]
    assert notes.one("warnings_of") == ((record,), {})
    warnings = ["warning: near a limit", "warning: it hangs"]
    if kind == "all":
        warnings.insert(0, "warning: run anyway")
    if kind == "own unit":
        warnings.insert(0, "warning: the stability of the loop with ~x/c.fmu is not judged: an FMU has no linear form")
    assert done.stderr.splitlines() == warnings
    # bars for imports come first
    expected_bar = {"description": "files and report", "total": None, "completed": 0.123, "done": 0}
    assert notes.bars[-1] == expected_bar
    lines = ["errors found", "errors", f"Completed: 0.5 s simulated in T s. Wrote to {out} (1.2 kB):"]
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
    notes.replace(f"{RUNS}.run.write_results", Written(["a"], made_report("errors")))
    notes.replace(f"{RUNS}.run.warnings_of", [])
    Path("o").mkdir()
    Path("o/a").touch()
    done = invoke("run", "heave_step", "--set", "loop.duration=1.75", "--out", "o")
    assert done.exit_code == code
    assert done.stderr == f"{end}\n"
    assert done.stdout.splitlines()[0] == "errors found"
    assert done.stdout.splitlines()[-2].startswith(f"Not completed: {time:.6g} of 1.75 s simulated in ")


@pytest.mark.parametrize(("growing", "code"), [(False, 0), (True, 3)])
def test_a_loop_that_moves_by_itself(notes: Notes, growing: bool, code: int) -> None:
    """Expected: a warning with the frequency of a steady cycle, and no success of one that grows."""
    still = waving_record(load_preset("motion_base"), size=0.0)
    record = oscillating(still)
    if growing:
        wave = record["error.leg_length[5]"] * 30 ** (record["time"] / 0.5) / 10
        record = Record(record.table.with_columns(**{"error.leg_length[5]": wave}), record.metadata)
    notes.replace(f"{RUNS}.run.run", record)

    def write(*_: Any, notes: list[Note], **__: Any) -> Written:
        return Written(["a"], replace(made_report("errors"), notes=tuple(notes)))

    notes.replace(f"{RUNS}.run.write_results", act=write)
    notes.replace(f"{RUNS}.run.warnings_of", [])
    Path("o").mkdir()
    Path("o/a").touch()
    done = invoke("run", "heave_step", "--out", "o")
    assert done.exit_code == code
    (line,) = done.stderr.splitlines()
    assert "\nCompleted: 0.5 s simulated in " in done.stdout
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
    found.report = lambda **_: made_report("tuned")
    notes.replace("harness.experiment.file.text_with_settings", "text")
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
    assert shown == ["best none yet", "best 1.235 mm"]
    generations = expected["generations"]
    bar = {"description": "files and report", "total": None, "completed": 5, "done": 0}
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
        "tuned found",
        "tuned",
        f"Done in T s. Wrote to {out} (0.4 kB):",
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


class Checked(SimpleNamespace):
    def report(self, *, charts: bool) -> Report:
        assert not charts
        return made_report(self.name)

    def settings_that_fit(self, what: str) -> dict[str, str]:
        return {"fit by": what}


@pytest.mark.parametrize("kind", ["within", "beyond", "near", "time", "amplitude", "misses"])
def test_check(notes: Notes, kind: str) -> None:
    """Expected: exit code 3 beyond limits; a fit only of what is beyond or too near, beside the experiment."""
    first = Checked(
        within=kind in ("within", "near"), keeps_margin=kind == "within", name="first",
        experiment=SimpleNamespace(folder=Path("beside"), requirements=()),
    )  # fmt: skip
    second = Checked(within=kind != "misses", keeps_margin=True, name="second")
    results = [first, second]
    Path("beside").mkdir()
    checked: list[Any] = []

    def check(experiment: Any, **load: str | None) -> Checked:
        assert load == {"payload": "3kg" if kind == "time" else None, "payload_height": "0 m"}
        checked.append(experiment)
        return results.pop(0)

    notes.replace("harness.experiment.checking.check", act=check)
    notes.replace("harness.experiment.checking.check_files", {"check.json": b"x" * 50})
    notes.replace("harness.experiment.file.text_with_settings", "fitted text")
    fit = {"within": "time", "near": "time", "time": "time", "amplitude": "amplitude", "misses": "amplitude"}.get(kind)
    more = ("--set", "loop.delay=1", "--payload", "3kg", "--out", "o") if kind == "time" else ()
    done = invoke("check", "circle", *more, *(("--fit", fit) if fit else ()))
    out = "o" if kind == "time" else "results/check_circle"
    lines = ["first found", "first", f"Done in T s. Wrote to {out} ({size_of(out)}):"]
    settings = ["loop.delay=1"] if kind == "time" else []
    if kind not in ("within", "beyond"):
        lines += ["circle-fitted.toml:", "second found", "second"]
        lines += ["Wrote beside/circle-fitted.toml (0.011 kB).", "Next: gough-stewart run beside/circle-fitted.toml"]
        assert Path("beside/circle-fitted.toml").read_text() == "fitted text"
        assert notes.one("text_with_settings") == (("circle", settings, {"fit by": fit}), {})
    else:
        assert list(Path("beside").iterdir()) == []
    assert checked[0] == gs.load_experiment("circle", settings)
    assert checked[1:] == ([] if kind in ("within", "beyond") else ["beside/circle-fitted.toml"])
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
    return SimpleNamespace(
        members=polars.DataFrame(table, schema_overrides=schema), metadata={"tolerance": 1e-9, "substeps": 4}
    )


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

    def write(_: Any, folder: Path, *, pages: bool) -> Worst:
        for name in ("members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"):
            (folder / name).write_bytes(b"x" * 250)
        return Worst({17: "there"} if pages else {}, None, "")

    seen: list[dict[str, Any]] = []
    opened = notes.opened()
    notes.replace("harness.ensemble.ensemble.ensemble", found, act)
    notes.replace("harness.ensemble.worst.write_worst", act=write)
    told = (Note("too coarse", "warning"),) if kind == "all" else ()
    asked: list[dict[str, Any]] = []

    def report(**given: Any) -> Report:
        asked.append(given)
        return replace(made_report("members"), notes=told)

    found.report = report
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
    assert notes.bars[-1]["description"] == "worst members and report"
    assert notes.one("write_worst") == ((found, Path(out)), {"pages": kind == "all"})
    assert asked == [{"charts": kind == "all", "worst": {17: "there"} if kind == "all" else {}}]
    warning = "warning: too coarse\n" if kind == "all" else ""
    if kind in ("none", "grows"):
        assert done.exit_code == 3
        warning = "error: none of 3 members completed its run; the first: cause 0\n"
        done.exit_code = 0
    if kind == "grows":
        text = "the loops of 1 of 3 members grow by themselves; member 1 has the largest amplitude, 3 mm at 2.5 Hz. "
        text += "`run --member K` shows one"
        warning = f"error: no member completed its run with a loop that does not grow: {text}\n"
    assert done.stderr == warning
    done_line = f"Done in T s. Wrote to {out} ({size_of(out)}):"
    said(done, "members found", "members", done_line)
    more = "worst, report.json, report.html" if kind == "all" else "report.json"
    assert f"members.parquet, bands.parquet, samples.parquet, ensemble.json, {more}" in " ".join(done.stdout.split())
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
        (folder / "differences.parquet").write_bytes(b"x" * 500)

    for each, name in ((a, "slow"), (b, "fast")):
        each.report = lambda *, charts, worst, name=name: made_report(f"{name} {charts} {worst}")
    compared = SimpleNamespace(a=a, b=b)
    notes.replace("harness.ensemble.compare.run_compared", compared, act)
    notes.replace("harness.ensemble.compare.comparison_report", made_report("differences"))
    notes.replace("harness.ensemble.worst.write_worst", Worst({3: "there"}, None, ""))
    options = ("--members", "8", "--seed", "2", "--workers", "3", "--resume", "--set", "loop.duration=0.4")
    done = invoke("ensemble", "heave_tolerances", "--compare", "circle", *options)
    out = "results/ensemble_heave_tolerances_compared"
    (experiments, names, folder, _), given = notes.one("run_compared")
    assert [each.title for each in experiments][1].startswith("circle")
    assert experiments[0].loop.duration == 0.4 != experiments[1].loop.duration
    assert (tuple(names), folder) == (("heave_tolerances", "circle"), Path(out))
    assert given == {"members": 8, "seed": 2, "resume": True, "workers": 3, "scheduler": None}
    assert {k: notes.bars[-1][k] for k in ("description", "completed", "total")} == {
        "description": "worst members and reports", "completed": 3, "total": None,
    }  # fmt: skip
    worst = [(of, place) for (of, place), given in notes.calls.pop("write_worst") if given == {"pages": False}]
    assert worst == [(a, Path(out, "heave_tolerances")), (b, Path(out, "circle"))]
    for name, of in (("heave_tolerances", "slow"), ("circle", "fast")):
        kept = from_json(Path(out, name, "report.json").read_bytes())
        assert kept.verdict.text == f"{of} False {{3: 'there'}} found"
    failed = {"a": "error: none of 2 members completed its run; the first: cause 0\n",
              "b": "error: none of 1 members completed its run; the first: cause 0\n"}  # fmt: skip
    assert done.stderr == failed.get(fails, "")
    assert done.exit_code == (3 if fails else 0)
    done.exit_code = 0
    assert done.stdout.startswith("differences found\n")
    assert "heave_tolerances, circle, differences.parquet, report.json" in " ".join(done.stdout.split())
    assert notes.one("comparison_report") == ((compared,), {"charts": False})
    other = invoke("ensemble", "heave_tolerances", "--compare", "circle", "--out", "elsewhere")
    assert notes.one("run_compared")[0][2] == Path("elsewhere")
    assert "elsewhere" in other.stdout
