"""`make release-check`: sdist and wheel of a clean clone, in an empty environment of every Python that is here.

In each, README's commands run in an empty folder: without the repository, without a compiler on the path, without
network where the system can cut it off. If the wheel carries no prebuilt libraries, they run with the extra `compile`,
which brings a compiler. Then the licences of all that is shipped, installed and in the pages are listed; an unknown one
is an error.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from tools.pages.blocks import ROOT
from tools.pages.story import TERMINAL, FailedCommandError, run_page
from tools.release.licences import Licence, of_install, of_page, of_wheel

PREBUILT = "gough_stewart/prebuilt/"
OLDEST = (3, 11)
_VERSION = "import sys; print('%d.%d.%d' % sys.version_info[:3])"


def pythons() -> dict[str, str]:
    """Interpreters of supported versions by `major.minor`, each the first that is found: on the path, of pyenv."""
    places = [Path(sys.executable), *map(Path, filter(None, (shutil.which(f"python3.{k}") for k in range(11, 25))))]
    places += sorted(Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob("versions/*/bin/python"))
    found: dict[str, str] = {}
    for place in places:
        done = subprocess.run([str(place), "-c", _VERSION], capture_output=True, text=True, check=False)
        version = tuple(map(int, done.stdout.strip().split("."))) if done.returncode == 0 else (0,)
        if version >= OLDEST:
            found.setdefault(f"{version[0]}.{version[1]}", str(place))
    return dict(sorted(found.items(), key=lambda each: int(each[0].partition(".")[2])))


def say(text: str) -> None:
    """A line, at once."""
    print(text, flush=True)


def called(*command: str, cwd: Path | None = None) -> None:
    """A step of the check that must not fail."""
    env = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    done = subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"failed: {' '.join(command)}\n{done.stdout[-3000:]}{done.stderr[-3000:]}")


def built(folder: Path) -> tuple[Path, Path]:
    """The sdist of a clean clone, and the wheel that pip makes of it in an environment of its own."""
    clone, out = folder / "clone", folder / "dist"
    called("git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(clone))
    python = environment(sys.executable, folder / "builder")
    called(python, "-m", "pip", "install", "--quiet", "build")
    called(python, "-m", "build", "--sdist", "--outdir", str(out), str(clone))
    (sdist,) = out.glob("*.tar.gz")
    called(python, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(sdist))
    (wheel,) = out.glob("*.whl")
    return sdist, wheel


def environment(python: str, folder: Path) -> str:
    """A new virtual environment of an interpreter; returns its own."""
    called(python, "-m", "venv", str(folder))
    return str(folder / "bin" / "python")


def can_cut_network() -> bool:
    """Whether a process here can have a network of its own, which is empty."""
    command = ["unshare", "--map-root-user", "--net", "true"]
    return (
        shutil.which("unshare") is not None
        and subprocess.run(command, check=False, capture_output=True).returncode == 0
    )


def readme(python: str, folder: Path, *, cut: bool) -> int:
    """Run README's commands in an empty folder; returns their number."""
    path = str(Path(python).parent)
    kept = {k: v for k, v in os.environ.items() if not re.match("PYTHON|VIRTUAL_ENV|CC$|PATH$", k)}
    # a home of its own: no cache of compiled code
    env = {**kept, **TERMINAL, "PATH": path, "HOME": str(folder.parent), "XDG_CACHE_HOME": str(folder.parent / "cache")}
    number = 0

    def run(command: str, cwd: Path) -> str:
        nonlocal number
        number += 1
        words = ["/bin/sh", "-c", command]
        if cut:
            words = [str(shutil.which("unshare")), "--map-root-user", "--net", *words]
        done = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
        if done.returncode:
            raise FailedCommandError(command, done)
        return done.stdout

    run_page("README.md", folder, run)
    return number


def licences_of(wheel: Path, python: str, folder: Path) -> list[Licence]:
    """Everything: the wheel, an install, and the pages that README's commands and one more wrote."""
    with zipfile.ZipFile(wheel) as archive:
        contents = {name: archive.read(name) for name in archive.namelist()}
    found = [*of_wheel(contents), *of_install(python)]
    command = [str(Path(python).with_name("gough-stewart")), "workspace", "--points", "3", "--out", str(folder / "map")]
    called(*command)
    for page in folder.rglob("*.html"):
        found += of_page(page.read_bytes())
    return list(dict.fromkeys(found))


def main() -> int:
    """0 if all is right; 1 with an unknown licence, and SystemExit with the command that failed."""
    parser = argparse.ArgumentParser(prog="python -m tools.release", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--python", action="append", help="only this version, such as 3.12; may be repeated")
    options = parser.parse_args()
    chosen = {v: p for v, p in pythons().items() if not options.python or v in options.python}
    if not chosen:
        raise SystemExit(f"no Python of {' or '.join(options.python or ['3.11 or later'])} was found")
    cut, unknown = can_cut_network(), 0
    with tempfile.TemporaryDirectory(prefix="gough-stewart-release-") as place:
        folder = Path(place)
        sdist, wheel = built(folder)
        for archive in (sdist, wheel):
            say(f"{archive.name}: {archive.stat().st_size / 1e6:.2f} MB")
        with zipfile.ZipFile(wheel) as opened:
            has_libraries = any(name.startswith(PREBUILT) for name in opened.namelist())
        if not has_libraries:
            say("the wheel carries no prebuilt libraries: README's commands need the extra compile, and its compiler")
        say(f"network: {'cut off' if cut else 'not cut off, since this system has no unshare'}")
        for k, (version, interpreter) in enumerate(chosen.items()):
            own = folder / f"python{version}"
            python = environment(interpreter, own)
            wanted = str(wheel) if has_libraries else f"{wheel}[compile]"
            called(python, "-m", "pip", "install", "--quiet", wanted)
            if has_libraries:
                there = "import importlib.util as u; assert not u.find_spec('ziglang'), 'a compiler is installed'"
                called(python, "-c", there)
            (own / "empty").mkdir()
            try:
                number = readme(python, own / "empty", cut=cut)
            except FailedCommandError as error:
                raise SystemExit(f"Python {version}: failed: {error} {' '.join(error.__notes__)}") from None
            size = sum(f.stat().st_size for f in own.glob("lib/**/*") if f.is_file() and not f.is_symlink())
            say(f"Python {version}: {number} commands of README, install of {size / 2**20:.0f} MiB")
            if k == 0:
                for each in sorted(licences_of(wheel, python, own / "empty"), key=lambda each: each.part.lower()):
                    unknown += not each.is_known
                    say(f"  {each.name or 'UNKNOWN':14} {each.part}{'' if each.is_known else '  <- not known'}")
            shutil.rmtree(own)
    say(f"{unknown} licences are not known" if unknown else "all licences are known")
    return int(unknown > 0)


if __name__ == "__main__":
    sys.exit(main())
