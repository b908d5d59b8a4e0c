"""What users install: the sdist, the wheel of it, and a plain install, which links to what the wheel declares alone."""

import base64
import os
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from hashlib import sha256
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement

from gough_stewart.fmu_build.toolchain import native

pytestmark = pytest.mark.evidence
ROOT = Path(__file__).parents[2]
FOLDERS = ("model", "fmu_build", "harness")
PREBUILT = "gough_stewart/prebuilt/"
PACKED = (
    *(*FOLDERS, "build_backend", "gough_stewart", "tests", "pyproject.toml", "MANIFEST.in"),
    *("README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"),
)


class Install(NamedTuple):
    """Archives, and where they are installed."""

    sdist: Path
    wheel: Path
    environment: Path

    def run(self, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """A program of the environment, outside of the repository and with none of its variables."""
        command = [str(self.environment / "bin" / program), *arguments]
        kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        # no compiler on the path, and a cache of its own
        env = {**kept, "MPLBACKEND": "agg", "COLUMNS": "200", "NO_COLOR": "1", "PATH": str(self.environment / "bin")}
        env |= {"XDG_CACHE_HOME": str(self.environment / "cache"), "ZIG_GLOBAL_CACHE_DIR": ""}
        return subprocess.run(command, cwd=self.environment, env=env, capture_output=True, text=True, check=False)


def link_packages(wheel: Path, site: Path) -> None:
    """Link to all that the wheel needs, and to nothing else."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        archive.extractall(site.parent / "metadata", [name, name.replace("METADATA", "WHEEL")])
    waiting = list(Distribution.at((site.parent / "metadata" / name).parent).requires or ())
    known = set[str]()
    while waiting:
        need = Requirement(waiting.pop())
        if need.name not in known and (need.marker is None or need.marker.evaluate({"extra": ""})):
            known.add(need.name)
            each = distribution(need.name)
            waiting += each.requires or ()
            for top in {file.parts[0] for file in each.files or () if file.parts[0] not in ("..", "__pycache__")}:
                if not (site / top).exists():
                    (site / top).symlink_to(Path(str(each.locate_file(top))))


def packed(kind: str, source: Path, folder: Path) -> list[Path]:
    """The sdist or the wheel of some sources, as their build system makes it."""
    settings = {"only-here": "yes"} if kind == "wheel" else {}
    script = "import sys; sys.path.insert(0, 'build_backend'); import prebuilt_wheel as backend\n"
    script += f"backend.build_{kind}(sys.argv[1], {settings})"
    subprocess.run([sys.executable, "-c", script, str(folder)], cwd=source, capture_output=True, check=True)
    return list(folder.glob({"sdist": "*.tar.gz", "wheel": "*.whl"}[kind]))


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Install:
    folder = tmp_path_factory.mktemp("install")
    source = folder / "source"
    source.mkdir()
    for name in PACKED:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "prebuilt")
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source)
    (sdist,) = packed("sdist", source, folder)
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (wheel,) = packed("wheel", folder / "unpacked" / sdist.name.removesuffix(".tar.gz"), folder)
    environment = folder / "plain"
    venv.create(environment, symlinks=True)
    (site,) = environment.glob("lib/python*/site-packages")
    link_packages(wheel, site)
    python = str(environment / "bin" / "python")
    command = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(command, capture_output=True, check=True)
    return Install(sdist, wheel, environment)


def test_the_sdist_has_no_tests_that_cannot_run_and_what_a_reader_looks_for(install: Install) -> None:
    with tarfile.open(install.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert not [name for name in names if name.startswith(("tests", "benchmarks", "docs", "tools", PREBUILT))]
    assert {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff"} <= names


def test_the_wheel_has_every_file_of_the_package_and_compiled_code_in_its_record(install: Install) -> None:
    """Expected: files of the folders, names of the standard's platform tuple, digests and sizes as PEP 376 has them."""
    sources = {path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if "__pycache__" not in path.parts}
    expected = {f"gough_stewart/{path.relative_to(ROOT).as_posix()}" for path in sources if path.is_file()}
    expected |= {f"gough_stewart/{name}" for name in ("__init__.py", "__init__.pyi", "__main__.py", "py.typed")}
    own = native()
    compiled = (f"{own.name}/{name}{own.suffix}.xz" for name in ("gough_stewart", "loop", "folds"))
    others = ("kernel.c.xz", "dependencies.json.xz", "machine.wasm.xz", "manifest.json")
    expected |= {PREBUILT + name for name in (f"{own.name}/kernel{own.suffix}", *compiled, *others)}
    with zipfile.ZipFile(install.wheel) as wheel:
        contents = {name: wheel.read(name) for name in wheel.namelist()}
    assert install.wheel.name.endswith("-py3-none-any.whl")
    assert {name for name in contents if ".dist-info/" not in name} == expected
    (record,) = (name for name in contents if name.endswith("/RECORD"))
    rows = [line.rsplit(",", 2) for line in contents[record].decode().splitlines()]
    assert {row[0] for row in rows} == set(contents)
    for name, digest, size in rows:
        if name != record:
            raw = base64.urlsafe_b64encode(sha256(contents[name]).digest()).decode().rstrip("=")
            assert (digest, int(size)) == (f"sha256={raw}", len(contents[name])), name


def test_a_plain_install_shows_builds_runs_varies_and_plays_without_a_compiler(install: Install) -> None:
    """Expected: units that FMPy's check finds right, a run on one, an ensemble, a page; no compiler is used."""
    heavy = ("casadi", "ziglang", "pandas")
    there = f"from importlib.util import find_spec; print([each for each in {heavy} if find_spec(each)])"
    assert install.run("python", "-c", there).stdout == "[]\n"
    out = install.environment / "made"
    for command in (
        ["--help"],
        ["experiments"],
        ["run", "heave_step", "--set", "loop.duration=0.1", "--report", "--figures", "--out", str(out / "shown")],
        ["build", "--check", "--preset", "motion_base", "--out", str(out / "units")],
        ["run", "heave_step", "--plant", "fmu3", "--set", "loop.duration=0.1", "--out", str(out / "run")],
        ["ensemble", "heave_tolerances", "--members=8", "--set", "loop.duration=0.1", "--out", str(out / "ensemble")],
        ["live", "heave_step", "--no-open", "--out", str(out / "heave_live.html")],
        ["export", "pitch_sine", "--as", "page", "--out", str(out / "page")],
    ):
        done = install.run("gough-stewart", *command)
        assert done.returncode == 0, (command, done.stdout, done.stderr)
        assert "NumPy" not in done.stderr, done.stderr
    assert "heave_step" in install.run("gough-stewart", "experiments").stdout
    assert {"record.csv", "pose.png", "report.html"} <= {path.name for path in (out / "shown").iterdir()}
    cached = {path.name for path in (install.environment / "cache/gough-stewart/build").iterdir()}
    assert cached == {"agrees", "fmus", "unpacked"}
    assert f'"{native().name} ' in (out / "ensemble" / "ensemble.json").read_text()


def test_a_plain_install_says_what_tracing_and_compiling_need(install: Install) -> None:
    """Expected: the one error base and the extra's name at every door."""
    script = """
import gough_stewart as gs

for each in (
    lambda: gs.export("heave_step", forms=["c"], out="exported"),
    lambda: gs.identify("log.csv", platform="liu2000"),
    lambda: gs.excite("liu2000"),
    lambda: gs.build("units", targets=["all"]),
):
    try:
        each()
    except gs.GoughStewartError as error:
        assert "pip install 'gough-stewart[compile]'" in str(error), error
    else:
        raise AssertionError(each)
"""
    done = install.run("python", "-c", script)
    assert done.returncode == 0, done.stderr
    done = install.run("gough-stewart", "export", "heave_step", "--as", "c")
    assert (done.returncode, done.stderr.count("gough-stewart[compile]")) == (1, 1), done.stderr
    assert "Traceback" not in done.stderr
