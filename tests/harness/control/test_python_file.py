"""Controllers in Python: what a file may name, with modules and files of its own; what it takes and gives."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs

T = 0.002
MASS = gs.load_preset("motion_base").platform_mass
REST: dict[str, Any] = {
    "reference": {"type": "hold"},
    "loop": {"duration": 3 * T, "sample_time": T, "plant_step": T},
    "actuators": {"force_limit": "none"},
}


def write(folder: Path, **files: str) -> Path:
    """Modules by name, in packages with __: `pack__part` is pack/part.py; the file `mine`, if there is one."""
    for name, text in files.items():
        path = folder / f"{name.replace('__', '/', 1)}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder / "mine.py"


def forces(file: Path, **keys: Any) -> list[list[float]]:
    """What its controller commands at the samples of a run."""
    controller = {"type": "python", "file": str(file), "feedforward": "none", **keys}
    found = gs.run("heave_step", {**REST, "controller": controller})["controller.force"][:3]
    return [row.tolist() for row in found]


def at_first(file: Path, **keys: Any) -> list[float]:
    return forces(file, **keys)[0]


OF_CLASS = "class C:\n def __init__(self, platform, T): self.T = T\n def __call__(self, sample): return [self.T] * 6\n"
OF_DATA = (
    "from __future__ import annotations\nfrom dataclasses import dataclass\n@dataclass\nclass C:\n platform: object\n"
    " sample_time: float\n a: float = 2.0\n def __call__(self, sample): return [self.a] * 6\n"
)
# a dataclass looks for its module among the loaded ones
LATE = (
    "from __future__ import annotations\nfrom dataclasses import dataclass\ndef make(platform, T):\n @dataclass\n"
    " class C:\n  a: float = 8.0\n return lambda sample: [C().a] * 6\n"
)
CASADI = (
    "import casadi\ndef make(platform, T, n=9.0):\n y = casadi.SX.sym('y', 6)\n"
    " return casadi.Function('law', [y], [0 * y + n], ['leg_length'], ['actuator_force'])\n{}"
)
LINEAR = "import control, numpy as np\n{} = control.ss([], [], [], np.zeros((6, 6)), True)\n"


@pytest.mark.parametrize(
    ("text", "keys", "expected"),
    [
        ("def controller(sample): return [1] * 6", {}, 1),
        ("import numpy as np\ndef controller(sample): return np.full(6, 200, dtype=np.uint8)", {}, 200),
        ("from pathlib import Path\nn = len(Path(__file__).name)\ndef controller(sample): return [n] * 6", {}, 7),
        ("class C:\n def __call__(self, sample): return [2] * 6\nmine = C()", {"name": "mine"}, 2),
        ("class C:\n def step(self, sample): return [3] * 6\nmine = C().step", {"name": "mine"}, 3),
        (OF_CLASS, {"name": "C"}, T),
        ("def make(platform, T, a=1): return lambda sample: [platform.platform_mass + a] * 6", {"factory": "make"},
         MASS + 1),
        ("from functools import partial\nmake = partial(lambda platform, T, *, a: lambda sample: [a] * 6, a=5)",
         {"factory": "make"}, 5),
        ("def make(platform, T, *, a, **rest): return lambda sample: [a + rest['b']] * 6",
         {"factory": "make", "parameters": {"a": 4, "b": 2}}, 6),
        (OF_DATA, {"name": "C", "parameters": {"a": 7.0}}, 7),
        (LATE, {"factory": "make"}, 8),
        (CASADI.format("law = make(0, 1)"), {"name": "law"}, 9),
        (CASADI.format(""), {"factory": "make", "parameters": {"n": 4.5}}, 4.5),
        (LINEAR.format("controller"), {}, 0),
        ("import gough_stewart as gs\n" + LINEAR.format("it") + "controller = gs.LinearController(it)", {}, 0),
        ("def make(platform, T):\n " + LINEAR.format("it").replace("\n", "\n ") + "return it", {"factory": "make"}, 0),
    ],
)  # fmt: skip
def test_a_file_may_name_any_kind_of_controller(text: str, keys: Any, expected: float, tmp_path: Path) -> None:
    assert at_first(write(tmp_path, mine=text), **keys) == [expected] * 6


PID = "class Pid:\n def __init__(self, platform, T, kp, *, ki=0.0): pass\n def __call__(self, sample): pass\n"
MAKE = "def make(platform, T): return "


@pytest.mark.parametrize(
    ("text", "keys", "message"),
    [
        (PID, {"name": "Pid", "parameters": {"kp": 1, "kd": 2}},
         r"parameters: class Pid accepts kp, ki; found 'kd'; did you mean 'k[pi]'\?"),
        (PID, {"name": "Pid"}, "parameters: class Pid accepts kp, ki; missing kp, add it"),
        (PID, {"factory": "Pid", "parameters": {"kp": 1, "platform": 3}}, "accepts kp, ki; found 'platform'"),
        ("def make(platform, T): pass", {"factory": "make", "parameters": {"a": 1}},
         r"make\(\) accepts no parameters; found 'a'$"),
        ("def make(platform, T, *, gain, **rest): pass", {"factory": "make"}, "accepts gain; missing gain, add it to"),
        ("def make(platform, T, **rest): pass", {"factory": "make", "parameters": {"a": 1, "platform": 4}},
         r"make\(\) accepts no parameters; found 'platform'"),
        ("def controller(a, b, c, /): pass", {}, r"takes \(a, b, c, /\); expected a function of one Sample"),
        ("controller = dict", {}, "class dict failed with TypeError: dict expected at most 1 argument"),
        ("controller = max", {}, r"the control function failed at time 0 s with (Type|Value)Error"),
        ("class C: pass", {"name": "C"}, r"class C takes \(\); expected to be called as make\(platform, sample_time"),
        ("def controller(sample): pass", {"parameters": {"a": 1}},
         "parameters: a are for a class or factory; 'controller' is neither"),
        ("def controller(platform, T): pass", {}, "expected factory = 'controller' instead of name"),
        ("def controller(): pass", {}, r"takes \(\); expected a function of one Sample, or a class or factory"),
        ("make = 3", {"factory": "make"}, "factory = 'make' is 3; expected a function or class"),
        ("controller = 3", {}, "controller is int; expected a control.StateSpace"),
        (MAKE + "None", {"factory": "make"}, "controller is NoneType; expected a control.StateSpace"),
        (MAKE + "int", {"factory": "make"}, "a factory gave the class int; expected an object"),
        (MAKE + "1 / 0", {"factory": "make"}, r"make\(\) failed with ZeroDivisionError: .* \(mine\.py, line 1\)$"),
        ("\ndef controller(sample):\n return sample.measured['leg_lenght']", {},
         r"failed at time 0 s with KeyError: 'leg_lenght' \(mine\.py, line 3\)$"),
        ("def f(x):\n return x.measured['leg_lenght']\ndef controller(sample): return f(sample)", {},
         r"KeyError: 'leg_lenght' \(mine\.py, line 2\)$"),
        (MAKE + "exit(3)", {"factory": "make"}, r"make\(\) failed with SystemExit: 3"),
        ("def controller(sample): return [1.0] * 5", {},
         r"returned \[1\.0, 1\.0, 1\.0, 1\.0, 1\.0\] at time 0 s; expected 6 forces"),
        *[(f"import numpy as np\ndef controller(sample): return {wrong}", {}, "at time 0 s; expected 6 forces")
          for wrong in ("None", "np.ones((6, 1))", "['1'] * 6", "[1j] * 6", "[True] * 6", "[[1], [1, 2]]")],
        ("", {"name": "a", "factory": "b"}, "expected name or factory, not both"),
        ("", {}, "mine.py: defines no 'controller'; expected the controller under that name"),
        ("from json import nothing", {}, "mine.py: fails with ImportError: cannot import name 'nothing' from 'json'"),
        ("import gone", {}, r"mine.py: fails with ModuleNotFoundError: No module named 'gone' \(mine\.py, line 1\)$"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(text: str, keys: Any, message: str, tmp_path: Path) -> None:
    loaded, paths, here = set(sys.modules), list(sys.path), Path.cwd()
    with pytest.raises(gs.GoughStewartError, match=message):
        forces(write(tmp_path, mine=text), **keys)
    assert not {name for name in set(sys.modules) - loaded if "mine" in name}
    assert (paths, here) == (sys.path, Path.cwd())


def test_each_run_executes_the_file_and_the_modules_beside_it(tmp_path: Path) -> None:
    """Expected: what the globals count begins anew, though a run goes on counting."""
    count = (
        "import aside\nn = 0\ndef controller(sample):\n global n\n n += 1\n aside.n += 2\n return [n, aside.n] * 3\n"
    )
    file = write(tmp_path, mine=count, aside="n = 0")
    for _ in range(2):
        assert forces(file) == [[1, 2] * 3, [2, 4] * 3, [3, 6] * 3]


def test_modules_packages_and_relative_imports_are_those_beside_each_file(tmp_path: Path) -> None:
    """Expected: each file its own, in turn, also where a factory imports late, and no trace for others."""
    text = "import aside, plain.leaf\nfrom pack import deep\nfrom pack.deep.end import *\naside.seen = 5\n"
    text += "def make(platform, T):\n import aside as late, pack.part\n"
    text += " return lambda sample: [aside.n, late.n + deep.end.z - z, pack.part.n, plain.leaf.n, late.seen, z]\n"
    before = set(sys.modules)
    for n in (1, 2, 1):
        one, part = f"n = {n}", "from .deep.end import z\nn = z - 6\n"
        inside = {"pack____init__": "from . import part\nfrom .deep import end\n", "pack__part": part}
        file = write(tmp_path / str(n), mine=text, aside=one, plain__leaf=one, **inside)
        write(tmp_path / str(n) / "pack", deep____init__="", deep__end=f"z = {n} + 6\n")
        assert at_first(file, factory="make") == [n, n, n, n, 5, n + 6]
    assert not {"aside", "pack", "pack.part", "plain", "plain.leaf"} & (set(sys.modules) - before)


def test_a_module_beside_the_file_comes_before_an_installed_one_but_never_before_this_package(tmp_path: Path) -> None:
    """Expected: as when Python runs a file; everybody else still has the installed one."""
    text = (
        "import json, gough_stewart\ndef controller(sample): return [json.own, 0 + hasattr(gough_stewart, 'run')] * 3\n"
    )
    file = write(tmp_path, mine=text, json="own = 4", gough_stewart="")
    assert at_first(file) == [4, 1] * 3
    assert sys.modules["json"] is json
    assert not hasattr(json, "own")


def test_a_changed_helper_is_read_again_even_within_the_same_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same size and time: `__pycache__` would not see it, and is not written."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    for n in (1, 2):
        file = write(tmp_path, mine="from aside import n\ndef controller(sample): return [n] * 6", aside=f"n = {n}")
        assert at_first(file) == [n] * 6
    assert not (tmp_path / "__pycache__").exists()
    assert not sys.dont_write_bytecode


def test_relative_file_names_resolve_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: at import and in the factory; elsewhere the working folder is as before."""
    text = "import numpy as np, os\na = float(np.loadtxt('n.txt'))\ndef make(platform, T):\n"
    text += " b = float(np.loadtxt('n.txt'))\n return lambda sample: [a, b, len(os.getcwd()), 0, 0, 0]\n"
    file = write(tmp_path / "there", mine=text)
    (tmp_path / "there/n.txt").write_text("3\n")
    (tmp_path / "n.txt").write_text("9\n")
    monkeypatch.chdir(tmp_path)
    assert at_first(file, factory="make") == [3, 3, len(str(tmp_path)), 0, 0, 0]


def experiment(folder: Path, **keys: Any) -> Any:
    """An experiment beside the file, whose machine and clocks are not those of the design."""
    whole = {
        **REST,
        "title": "told",
        "platform": {"preset": "motion_base", "parameters": {"platform_mass": 1000.0}},
        "plant": {"parameters": {"platform_mass": 1300.0}},
        "controller": {"type": "python", "file": "mine.py", **keys},
        "loop": {"duration": 0.02, "sample_time": 0.005, "plant_step": 0.0025},
    }
    return gs.Experiment(**whole).from_file("told", folder)


def test_a_maker_is_told_the_nominal_model_and_the_sample_time(tmp_path: Path) -> None:
    text = "def make(platform, sample_time, a, words):\n return lambda sample: ["
    text += "platform.platform_mass, sample_time, a, len(words), sample.platform.platform_mass, 0]"
    write(tmp_path, mine=text)
    told = experiment(tmp_path, factory="make", parameters={"a": 4, "words": "six"})
    record = gs.run(told, {"controller.parameters.a": 5})
    assert record["controller.force"][0].tolist() == [1000.0, 0.005, 5, 3, 1000.0, 0]


def test_files_that_count_are_those_that_imports_and_texts_reach(tmp_path: Path) -> None:
    """Expected: also through others, from packages, inside functions; not what lies there without a reference."""
    write(
        tmp_path,
        mine="import numpy, a\ndef controller(sample):\n if sample is None:\n  from pack.part import x\n"
        "  open('gains/k.csv')\n return [0] * 6\n",
        a="try:\n import b\nexcept SyntaxError:\n pass\nname = 'b.csv', 'no file', '\\0'",
        b="syntax error",
        unused="",
        pack____init__="",
        pack__part="",
        pack__other="from plain import name",
        plain__leaf="",
    )
    for name in ("b.csv", "gains/k.csv", "unused.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1")
    packages = {"pack/__init__.py", "pack/part.py", "pack/other.py", "plain/leaf.py"}
    found = gs.run(experiment(tmp_path)).metadata["files"]
    assert found.keys() == {"mine.py", "a.py", "b.py", "b.csv", "gains/k.csv", *packages}
    assert all(np.fromiter(map(len, found.values()), int) == 64)
