"""What `import gough_stewart as gs` offers: these names, explained, typed, and loaded only when they are used."""

import ast
import doctest
import inspect
import io
import pydoc
import re
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path
from types import UnionType
from typing import Any, Self, assert_type, get_args, get_origin

import numpy as np
import pytest
from numpy.typing import NDArray

import gough_stewart as gs
from tests.support.snippets import BLOCKS
from tools.pages.blocks import ROOT

# The promise to users. A name that goes, or comes, is a line in the changelog.
# fmt: off
NAMES = [
    "__version__",
    "Platform", "load_platform", "save_platform", "load_preset", "preset_names",
    "leg_geometry", "leg_jacobian", "forward_kinematics", "static_leg_forces", "mass_matrix", "inverse_dynamics",
    "compliance",
    "State", "Acceleration", "stack",
    "SteppingModel", "build", "VARIABLES",
    "plant_system", "linearise", "trim", "modes",
    "PD", "PID", "Notch", "gains_from_bandwidth", "Gains", "pid", "sampled", "LinearController", "Sample",
    "Hold", "Step", "PointToPoint", "Sine", "Chirp", "Circle", "ViaPath",
    "Excitation",
    "experiment_names", "load_experiment", "Experiment", "check", "MotionCheck", "run", "margins", "LoopMargins",
    "frf", "FrequencyResponse",
    "ensemble", "Ensemble", "read_ensemble", "tune", "Tuning", "vector_env", "env", "export",
    "Record", "read_record", "save_record", "metrics", "view",
    "sweep", "evaluate_poses",
    "identify", "Estimate", "excite", "before_and_after", "read_log", "Log",
    "reproduce",
    "GoughStewartError", "StepError", "UnstableLoopError", "IdentificationWarning",
]
# fmt: on
# What takes longer to import than all of Python; nobody pays for it who does not use it.
HEAVY = ("numpy", "scipy", "casadi", "control", "matplotlib", "polars", "pydantic", "bokeh", "fmpy", "rich", "typer")


def python(*arguments: str) -> str:
    """What a fresh interpreter prints."""
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_public_class_name_stands_in_one_file() -> None:
    """Expected: no two classes of one name, so that a name leads to one place."""
    files = [path for folder in ("model", "fmu_build", "harness") for path in (ROOT / folder).rglob("*.py")]
    statements = [statement for path in files for statement in ast.parse(path.read_text("utf-8")).body]
    names = [statement.name for statement in statements if isinstance(statement, ast.ClassDef)]
    public = sorted(name for name in names if not name.startswith("_"))
    assert public == sorted({*public})


def test_pages_and_examples_use_nothing_else() -> None:
    """Expected: no module of the package but itself is imported in a code block or an example."""
    programs = {path.name: path.read_text("utf-8") for path in (ROOT / "examples").glob("*.py")}
    programs |= {block.place: block.text for block in BLOCKS if block.language == "python"}
    assert len(programs) > 15
    deep = re.compile(r"^\s*(?:from|import) gough_stewart[. ](?!as gs$).*", re.MULTILINE)
    assert {place: deep.findall(text) for place, text in programs.items() if deep.search(text)} == {}


def test_the_names_are_those_promised_explained_and_what_their_modules_hold() -> None:
    """Expected: a text that begins with a sentence; VARIABLES is data."""
    assert sorted(NAMES) == dir(gs)
    for name in set(NAMES) - {"__version__", "VARIABLES"}:
        value = getattr(gs, name)
        assert getattr(sys.modules[value.__module__], name) is value, name
        assert (inspect.getdoc(value) or "").split("\n\n")[0].rstrip().endswith((".", ";", ":")), name


def says_to_return(text: str) -> str:
    """The type in the section "Returns" of a docstring; "" if there is none, or if nothing explains it."""
    found = re.search(r"^Returns\n-------\n(\S.*)\n    \S", text, re.MULTILINE)
    return found[1] if found else ""


def words_for(annotation: Any, owner: type | None = None) -> str:
    """A type as in a docstring: `list[Path]` is "list of Path", `FloatArray | float` is "ndarray or float"."""
    kind, parts = get_origin(annotation) or annotation, get_args(annotation)
    if isinstance(annotation, str):
        return annotation
    if annotation is Self and owner is not None:
        return owner.__name__
    if kind is UnionType:
        return " or ".join(map(words_for, parts))
    return f"{kind.__name__} of {parts[0].__name__}" if kind in (list, tuple) else str(kind.__name__)


def test_what_is_said_to_be_returned_is_the_type_of_the_annotation() -> None:
    """Expected: of each function, and of each method with sections; nothing of those that return None."""
    found, expected = {}, {}
    for name in set(NAMES) - {"__version__", "VARIABLES"}:
        each = getattr(gs, name)
        methods = inspect.getmembers(each, inspect.isroutine) if inspect.isclass(each) else [("", inspect.unwrap(each))]
        for method, routine in methods:
            text, module = inspect.getdoc(routine) or "", getattr(routine, "__module__", None) or ""
            if not method or (method[0] != "_" and module.startswith("gough_stewart") and "\n---" in text):
                returned = inspect.signature(routine).return_annotation
                found[name, method] = says_to_return(text)
                expected[name, method] = "" if returned is None else words_for(returned, each if method else None)
    assert len(found) > 45
    assert found == expected


def test_help_tells_all_names_in_their_groups_and_little_else() -> None:
    """Expected: each name once, at the beginning of a line that says what it is; no more than a few screens."""
    text = pydoc.plain(pydoc.render_doc(gs))
    listed = re.findall(r"^ {8}((?:\w+, )*\w+)  +\S+", text.partition("PACKAGE CONTENTS")[0], re.MULTILINE)
    assert [name for each in listed for name in each.split(", ")] == NAMES[1:]
    assert len(text.splitlines()) < 130


# Those that take long run elsewhere, and the one that plans a fastest path before a release.
QUICK = [name for name in sorted(NAMES) if name not in {"__version__", "build", "reproduce", "ViaPath"}]


@pytest.mark.parametrize("name", [*QUICK, pytest.param("ViaPath", marks=pytest.mark.evidence)])
def test_the_examples_of_a_docstring_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: what stands behind an example, else that it runs."""
    monkeypatch.chdir(tmp_path)
    found = doctest.DocTestFinder(recurse=False).find(getattr(gs, name), name, globs={"gs": gs, "np": np})
    for example in found[0].examples if found else []:
        shown = io.StringIO()
        with redirect_stdout(shown):
            value = run_line(example.source, found[0].globs)
        if example.want:
            assert f"{value!r}\n" == example.want


def run_line(source: str, names: dict[str, Any]) -> Any:
    """The value of an expression; nothing of other statements."""
    try:
        code = compile(source.strip(), "example", "eval")
    except SyntaxError:
        exec(compile(source, "example", "exec"), names)
        return None
    return eval(code, names)


def test_importing_it_loads_nothing_heavy() -> None:
    """Expected: nothing at first, with all names there for completion; then what a platform needs, which is NumPy."""
    for code, heavy in (("dir(gs)", ""), ("gs.load_preset('liu2000')", "numpy")):
        look = f"import sys, gough_stewart as gs; {code}; print(*(n for n in {HEAVY} if n in sys.modules))"
        assert python("-c", look).strip() == heavy


def test_a_wrong_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'gough_stewart' has no attribute 'load_presets'") as caught:
        gs.load_presets  # type: ignore[attr-defined]  # noqa: B018
    assert caught.value.name == "load_presets"


def test_the_module_is_the_command() -> None:
    assert python("-m", "gough_stewart", "--version") == f"gough-stewart {gs.__version__}\n"


def test_type_checkers_know_names_and_signatures() -> None:
    """Expected: the types below, and errors where they are ignored; mypy, which sees the tests, holds them against."""
    platform = assert_type(gs.load_preset("liu2000"), gs.Platform)
    assert_type(gs.SteppingModel(platform).get("position"), NDArray[np.float64] | float)
    assert_type(gs.gains_from_bandwidth(platform, 2.0), gs.Gains)
    assert_type(gs.load_experiment("heave_step", {"loop.duration": 0.01}), gs.Experiment)
    found = assert_type(gs.margins("heave_step"), gs.LoopMargins)
    assert_type(found.disk.alpha, float)
    with pytest.raises(gs.GoughStewartError):
        gs.SteppingModel("liu2000")  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        gs.run("heave_step", plannt="model")  # type: ignore[call-arg]
