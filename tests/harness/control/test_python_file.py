"""Controllers from Python files: what a file may name, with modules, globals and files of its own."""

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.controllers import PythonController
from gough_stewart.harness.control.laws import LinearController, fresh_controller, linear_of
from gough_stewart.harness.control.python.makers import Maker
from gough_stewart.harness.control.python.private_modules import files_beside
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.experiment.file import experiment_from

T = 0.002
PLATFORM = gs.load_preset("motion_base")


def write(folder: Path, **files: str) -> Path:
    """Modules by name, in packages with __: `pack__part` is pack/part.py; the file `mine`, if there is one."""
    for name, text in files.items():
        path = folder / f"{name.replace('__', '/', 1)}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder / "mine.py"


def made(file: Path, **keys: Any) -> Any:
    """A fresh controller of a file."""
    return fresh_controller(PythonController(file=file.name, **keys).controller(PLATFORM, T, file.parent))


def value(file: Path, **keys: Any) -> Any:
    """What its controller gives at a sample."""
    return made(file, **keys)(None)


LINEAR = "import control, numpy as np\n{} = control.ss([], [], [], 3 * np.eye(6), True)\n"


@pytest.mark.parametrize(
    ("text", "keys", "expected"),
    [
        ("def controller(sample): return 'function'", {}, "function"),
        ("class C:\n def __call__(self, sample): return 'object'\nmine = C()", {"name": "mine"}, "object"),
        ("class C:\n def step(self, sample): return 'method'\nmine = C().step", {"name": "mine"}, "method"),
        (
            "class C:\n def __init__(self, platform, T): self.T = T\n def __call__(self, sample): return self.T\n",
            {"name": "C"},
            T,
        ),
        ("def make(platform, T, a=1):\n return lambda sample: (platform.platform_mass, T, a)", {"factory": "make"},
         (PLATFORM.platform_mass, T, 1)),
        ("from functools import partial\nmake = partial(lambda platform, T, *, a: lambda sample: a, a=5)",
         {"factory": "make"}, 5),
        ("from __future__ import annotations\nfrom dataclasses import dataclass\n@dataclass\nclass C:\n"
         " platform: object\n sample_time: float\n a: float = 2.0\n def __call__(self, sample): return self.a",
         {"name": "C", "parameters": {"a": 7.0}}, 7.0),
    ],
)  # fmt: skip
def test_a_file_may_name_any_kind_of_controller(text: str, keys: Any, expected: Any, tmp_path: Path) -> None:
    assert value(write(tmp_path, mine=text), **keys) == expected


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (LINEAR.format("controller"), {}),
        ("import gough_stewart as gs\n" + LINEAR.format("it") + "controller = gs.LinearController(it)", {}),
        ("def make(platform, T):\n  " + LINEAR.format("it").replace("\n", "\n  ") + "return it", {"factory": "make"}),
    ],
)
def test_a_file_may_name_or_make_a_linear_controller(text: str, keys: Any, tmp_path: Path) -> None:
    """Expected: three times the error; the loop runs it in matrices, and margins know it."""
    found = PythonController(file=write(tmp_path, mine=text).name, **keys).controller(PLATFORM, T, tmp_path)
    linear = linear_of(found)
    assert isinstance(linear, LinearController)
    assert np.array_equal(linear.system.D, 3 * np.eye(6))


PID = "class Pid:\n def __init__(self, platform, T, kp, *, ki=0.0): pass\n def __call__(self, sample): pass\n"


@pytest.mark.parametrize(
    ("text", "keys", "message"),
    [
        (PID, {"name": "Pid", "parameters": {"kp": 1, "kd": 2}},
         r"parameters: class Pid accepts kp, ki; found 'kd'; did you mean 'k[pi]'\?"),
        (PID, {"name": "Pid"}, "parameters: class Pid accepts kp, ki; missing kp, add it"),
        (PID, {"factory": "Pid", "parameters": {"kp": 1, "platform": 3}}, "accepts kp, ki; found 'platform'"),
        ("def make(platform, T): pass", {"factory": "make", "parameters": {"a": 1}},
         r"make\(\) accepts no parameters; found 'a'$"),
        ("class C: pass", {"name": "C"}, r"class C takes \(\); expected to be called as make\(platform, sample_time"),
        ("def controller(sample): pass", {"parameters": {"a": 1}},
         "parameters: a are for a class or factory; 'controller' is neither"),
        ("def controller(platform, T): pass", {}, "expected factory = 'controller' instead of name"),
        ("def controller(): pass", {}, r"takes \(\); expected a function of one Sample, or a class or factory"),
        ("make = 3", {"factory": "make"}, "factory = 'make' is 3; expected a function or class"),
        ("controller = 3", {}, "controller is int; expected a control.StateSpace"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(text: str, keys: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(ControllerError, match=message):
        PythonController(file=write(tmp_path, mine=text).name, **keys).controller(PLATFORM, T, tmp_path)


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ("None", "controller is NoneType; expected a control.StateSpace"),
        ("int", "a factory gave the class int; expected an object"),
        ("1 / 0", r"make\(\) failed with ZeroDivisionError"),
        ("exit(3)", r"make\(\) failed with SystemExit: 3"),
    ],
)
def test_a_factory_that_makes_no_controller_says_so(result: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ControllerError, match=message):
        made(write(tmp_path, mine=f"def make(platform, T): return {result}"), factory="make")


def test_name_and_factory_exclude_each_other() -> None:
    with pytest.raises(ControllerError, match="expected name or factory, not both"):
        PythonController(file="mine.py", name="a", factory="b")


COUNTS = "import aside\nn = 0\ndef controller(sample):\n global n\n n += 1\n aside.n += 1\n return n, aside.n\n"


def test_each_controller_has_globals_of_its_own_and_modules_beside_it_too(tmp_path: Path) -> None:
    """Expected: three controllers of one file count alone, in the file and in the module beside it."""
    file = write(tmp_path, mine=COUNTS, aside="n = 0")
    maker = PythonController(file="mine.py").controller(PLATFORM, T, tmp_path)
    assert isinstance(maker, Maker)
    one, two = (fresh_controller(maker) for _ in range(2))
    assert [one(None), one(None), two(None), one(None)] == [(1, 1), (2, 2), (1, 1), (3, 3)]  # type: ignore[operator, arg-type]
    assert value(file) == (1, 1)


def test_helpers_of_one_name_in_two_folders_do_not_meet(tmp_path: Path) -> None:
    """Expected: each its own, in turn, also where the import is made late; and no trace for others."""
    text = "import aside\ndef controller(sample):\n import aside as late\n from aside import n\n return late.n, n\n"
    files = [write(tmp_path / name, mine=text, aside=f"n = {name!r}") for name in ("a", "b")]
    controllers = [made(file) for file in files]
    assert [c(None) for c in (*controllers, *controllers)] == [("a", "a"), ("b", "b")] * 2
    assert "aside" not in sys.modules
    assert str(tmp_path / "a") not in sys.path


def test_packages_beside_a_file_and_relative_imports_work(tmp_path: Path) -> None:
    file = write(
        tmp_path,
        mine="import pack.part\nfrom pack import part as p, deep\nfrom pack.deep.end import *\nimport plain.leaf\n"
        "def controller(sample): return pack.part.a, p.a, deep.end.z, z, plain.leaf.b, pack.__name__.count('pack')\n",
        pack____init__="from . import part\nfrom .deep import end\n",
        pack__part="from .deep.end import z\na = z + 1\n",
    )
    (tmp_path / "pack/deep").mkdir()
    (tmp_path / "pack/deep/__init__.py").write_text("")
    (tmp_path / "pack/deep/end.py").write_text("z = 5\n")
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain/leaf.py").write_text("import mine\nb = mine.__name__.endswith('.mine')\n")
    assert value(file) == (6, 6, 5, 5, True, 1)


def test_a_module_beside_the_file_comes_before_an_installed_one_and_only_there(tmp_path: Path) -> None:
    """Expected: as when Python runs a file; what the file imports from elsewhere still gets the installed one."""
    file = write(tmp_path, mine="import json, plistlib\ndef controller(sample): return json.own", json="own = 4")
    assert value(file) == 4
    import json

    assert not hasattr(json, "own")


def test_a_changed_helper_is_read_again_even_within_the_same_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the same size and time: `__pycache__` would not see it, and is not written."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    file = write(tmp_path, mine="from aside import n\ndef controller(sample): return n", aside="n = 1")
    assert value(file) == 1
    write(tmp_path, aside="n = 2")
    assert value(file) == 2
    assert not (tmp_path / "__pycache__").exists()


def test_relative_file_names_resolve_beside_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: at import, in the factory, and at a sample; elsewhere the working folder is as before."""
    (tmp_path / "there").mkdir()
    (tmp_path / "there/n.txt").write_text("3\n")
    (tmp_path / "n.txt").write_text("9\n")
    text = "import numpy as np\na = np.loadtxt('n.txt')\ndef make(platform, T):\n b = float(open('n.txt').read())\n"
    text += " return lambda sample: (a, b, float(np.loadtxt('n.txt')))\n"
    file = write(tmp_path / "there", mine=text.replace("open('n.txt').read()", "np.loadtxt('n.txt')"))
    monkeypatch.chdir(tmp_path)
    assert value(file, factory="make") == (3, 3, 3)
    assert Path.cwd() == tmp_path


def test_a_module_that_is_missing_is_named_as_the_user_knows_it(tmp_path: Path) -> None:
    file = write(tmp_path, mine="from aside import nothing", aside="n = 1")
    with pytest.raises(ControllerError, match=r"cannot import name 'nothing' from 'aside'"):
        made(file)
    with pytest.raises(ControllerError, match=r"fails with ModuleNotFoundError: No module named 'gone'"):
        made(write(tmp_path, mine="import gone"))


def test_modules_of_controllers_that_are_gone_are_forgotten(tmp_path: Path) -> None:
    """Expected: ten thousand members leave nothing behind; a running controller keeps its own."""
    file = write(tmp_path, mine=COUNTS, aside="n = 0")

    def own() -> int:
        gc.collect()
        return sum(str(getattr(module, "__file__", "")).startswith(str(tmp_path)) for module in [*sys.modules.values()])

    controller = made(file)
    assert own() == 2
    assert [made(file)(None) for _ in range(5)] == [(1, 1)] * 5
    assert own() == 2
    assert controller(None) == (1, 1)
    del controller
    assert own() == 0


def test_this_package_is_never_taken_for_a_module_beside_the_file(tmp_path: Path) -> None:
    file = write(tmp_path, mine="import gough_stewart\ndef controller(sample): return gough_stewart", gough_stewart="")
    assert value(file) is gs


def test_files_that_count_are_those_that_imports_and_texts_reach(tmp_path: Path) -> None:
    """Expected: also through others, from packages, inside functions; not what lies there without a reference."""
    file = write(
        tmp_path,
        mine="import numpy, a\ndef controller(sample):\n from pack.part import x\n open('gains/k.csv')\n",
        a="import b\nname = 'b.csv'",
        b="",
        unused="",
        pack____init__="",
        pack__part="",
        pack__other="from a import name",
    )
    for name in ("b.csv", "gains/k.csv", "unused.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1")
    found = {path.relative_to(tmp_path).as_posix() for path in files_beside(file)}
    packages = {"pack/__init__.py", "pack/part.py", "pack/other.py"}
    assert found == {"mine.py", "a.py", "b.py", "b.csv", "gains/k.csv", *packages}


def test_a_maker_is_told_the_nominal_model_and_the_sample_time(tmp_path: Path) -> None:
    """Expected: of the experiment, where machine and clocks are others; and the keywords of its file."""
    write(
        tmp_path,
        mine="def make(platform, sample_time, a, words):\n"
        " return lambda sample: [platform.platform_mass, sample_time, a, len(words), sample.platform.platform_mass, 0]",
    )
    experiment = {
        "title": "told",
        "platform": {"preset": "motion_base", "parameters": {"platform_mass": 1000.0}},
        "plant": {"parameters": {"platform_mass": 1300.0}},
        "reference": {"type": "hold"},
        "controller": {"type": "python", "file": "mine.py", "factory": "make", "parameters": {"a": 4, "words": "six"}},
        "loop": {"duration": 0.02, "sample_time": 0.005, "plant_step": 0.0025},
        "actuators": {"force_limit": "none"},
    }
    whole = experiment_from(experiment).from_file("told", tmp_path)
    record = gs.run(whole, {"controller.parameters.a": 5})
    assert record["controller.force"][0].tolist() == [1000.0, 0.005, 5, 3, 1000.0, 0]
