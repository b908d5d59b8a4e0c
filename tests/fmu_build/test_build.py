"""Building: the same bytes every time, one compilation for all, caches that heal, nothing half-written."""

import hashlib
import json
import shutil
import signal
import struct
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.fmu_plants import Fmu, plant
from tests.support.uneven import UNEVEN

_PROGRAM = """
import json, os, pathlib, shutil, signal, subprocess, sys, time
folder, command = pathlib.Path(os.environ["FAKE_ZIG"]), sys.argv[1:]
with (folder / "calls").open("a") as calls:
    print(json.dumps(command), file=calls)
objects, target = pathlib.Path(os.environ["ZIG_LOCAL_CACHE_DIR"]), "here"
if "-target" in command:
    target = command[command.index("-target") + 1]
exec((folder / "rule.py").read_text())
out = pathlib.Path(command[command.index("-o") + 1])
start = next(pathlib.Path(name) for name in command if name.endswith("/model.c"))
kept = folder.parent / f"{start.parent.name}.o"
if not kept.exists():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {f"ZIG_{name}_CACHE_DIR": str(folder.parent) for name in ("LOCAL", "GLOBAL")}
    made = f"{kept}.{os.getpid()}"
    arguments = ["-c", "-std=c11", "-I", command[command.index("-I") + 1], str(start), "-o", made]
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *arguments], env=environment, check=True)
    os.replace(made, kept)
out.write_bytes(kept.read_bytes() + target.encode())
"""


class FakeZig:
    """The fake in a folder of its own, which the next builds find; their cache is empty at first."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.cache = folder, folder / "cache" / "gough-stewart"
        (folder / "ziglang").mkdir(parents=True)
        (folder / "ziglang" / "__init__.py").write_text("")
        (folder / "ziglang" / "__main__.py").write_text(_PROGRAM)
        self.rule("")
        for name, value in (("FAKE_ZIG", folder), ("PYTHONPATH", folder), ("ZIG_GLOBAL_CACHE_DIR", folder / "cache")):
            monkeypatch.setenv(name, str(value))

    def rule(self, code: str) -> None:
        """Python that runs first; knows `command`, `target`, `folder`, and the folder of `objects`."""
        (self.folder / "rule.py").write_text(code)

    def calls(self) -> list[list[str]]:
        """Arguments of all runs since this was last asked."""
        log = self.folder / "calls"
        lines = log.read_text().splitlines() if log.exists() else []
        log.unlink(missing_ok=True)
        return [json.loads(line) for line in lines]

    def as_cc(self) -> Path:
        """A program that is the same compiler under another name."""
        path = self.folder / "mycc"
        path.write_text(f'#!/bin/sh\nexec {sys.executable} -m ziglang "$@"\n')
        path.chmod(0o755)
        return path


# Names of FMI 3.0, folders of FMI 2.0, and zig's triples with the oldest system.
TARGETS = {
    "x86_64-linux": ("linux64", ".so", "x86_64-linux-gnu.2.17"),
    "aarch64-linux": ("aarch64-linux", ".so", "aarch64-linux-gnu.2.17"),
    "x86_64-windows": ("win64", ".dll", "x86_64-windows-gnu"),
    "x86_64-darwin": ("darwin64", ".dylib", "x86_64-macos.10.15"),
    "aarch64-darwin": ("darwin64", ".dylib", "aarch64-macos.11.0"),
}
LINKER = "ld.lld: error: o/0123/kernel.o: section header table goes past the end of the file"


@pytest.fixture
def zig(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> FakeZig:
    """A compiler whose runs are counted; what it has made once is kept for all tests."""
    return FakeZig(tmp_path_factory.getbasetemp() / "zig" / tmp_path_factory.mktemp("zig").name, monkeypatch)


def fails(words: str, condition: str = "True") -> str:
    return f"if {condition}:\n    sys.exit({words!r})\n"


def built(out: Path, *targets: str, fmi: str = "3.0", **options: Any) -> Path:
    return gs.build(out, platform=UNEVEN, fmi=[fmi], targets=targets or ["native"], **options)[0]


def binaries_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name.startswith("binaries/")}


def test_units_of_other_values_share_their_library_but_for_the_values(fmus: dict[str, Fmu], tmp_path: Path) -> None:
    """Expected: bytes that differ within the length of the numbers and tokens; the numbers are the other platform's."""
    other = gs.load_preset("motion_base")
    paths = gs.build(tmp_path, platform=other)
    first, *others = (binaries_of(path).popitem()[1] for path in (fmus["2.0"].path, *paths))
    for library in others:
        at = [k for k, (a, b) in enumerate(zip(first, library, strict=True)) if a != b]
        assert 0 < at[-1] - at[0] < 104 + 8 * 160
    for fmu in map(Fmu, paths):
        assert fmu.token not in {unit.token for unit in fmus.values()}
        with plant(fmu) as p:
            for name in ("platform_mass", "base_points", "platform_inertia"):
                assert np.array_equal(p.get(name), getattr(other, name))
            for name in ("position", "actuator_force"):
                assert np.array_equal(p.get(name), getattr(other, f"home_{name}"))


@pytest.mark.parametrize("version", [pytest.param("2.0", marks=pytest.mark.evidence), "3.0"])
def test_the_sources_compile_by_themselves(fmus: dict[str, Fmu], version: str, tmp_path: Path) -> None:
    """Expected: `fmpy compile`, CMake with the system's compiler, makes a unit with the same trajectory."""
    from fmpy.build import build_platform_binary

    bare = tmp_path / "bare"
    with zipfile.ZipFile(fmus[version].path) as archive:
        archive.extractall(bare, [name for name in archive.namelist() if not name.startswith("binaries/")])
    (tmp_path / "build").mkdir()
    # without optimising, which takes a quarter of a minute: "Release" would add -O3
    build_platform_binary(bare, tmp_path / "build", configuration="Debug")
    with zipfile.ZipFile(tmp_path / "rebuilt.fmu", "w") as archive:
        for file in bare.rglob("*"):
            archive.write(file, file.relative_to(bare))
    ends = []
    for unit in (Fmu(tmp_path / "rebuilt.fmu"), fmus[version]):
        with plant(unit) as p:
            p.start({"actuator_force": [30.0, 28, 30, 28, 30, 28]})
            p.do_step(0.0, 0.5)
            ends.append(p.pose)
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)


def test_all_targets_are_compiled_once_for_both_versions_and_lie_where_importers_look(
    zig: FakeZig, tmp_path: Path
) -> None:
    """Expected: options of `zig cc` by hand; FMI 2.0 has a folder for a system, and one file for Apple's processors."""
    told, order = list[str](), ["3.0", "2.0", "3.0"]
    two, three = gs.build(tmp_path, platform=UNEVEN, fmi=order, targets=["x86_64-linux", "all"], progress=told.append)
    parts = ("sources and documents", *TARGETS)
    assert sorted(told) == sorted(f"FMI {version}: {part}" for version in ("2.0", "3.0") for part in parts)
    calls = {call[call.index("-target") + 1]: call for call in zig.calls()}
    assert set(calls) == {triple for _, _, triple in TARGETS.values()}
    general = {*("-O3", "-std=c11", "-g0", "-s", "-shared", "-fvisibility=hidden", "-ffp-contract=off")}
    of_system = {".so": {"-fPIC"}, ".dylib": {"-Wl,-install_name,@rpath/gough_stewart.dylib"}, ".dll": set[str]()}
    for _, suffix, triple in TARGETS.values():
        call = calls[triple]
        assert call[:3] == ["cc", "-target", triple]
        assert Path(call[call.index("-o") + 1]).name == f"gough_stewart{suffix}"
        sources = [Path(word).name for word in call if word.endswith(".c")]
        assert sources == sorted(sources)
        assert {"fmi2.c", "fmi3.c", "kernel.c"} < set(sources)
        headers = {file.name for file in Path(call[call.index("-I") + 1]).iterdir()}
        assert {"fmi2Functions.h", "fmi3Functions.h", "kernel.h"} < headers
        flags = {word for word in call if word[0] == "-"} - {"-target", "-I", "-o", "-lm", "-mllvm"}
        assert flags - {"-enable-misched=false"} == general | {"-fno-math-errno"} | of_system[suffix]
    for name, (_, suffix, triple) in TARGETS.items():
        assert binaries_of(three)[f"binaries/{name}/gough_stewart{suffix}"].endswith(triple.encode())
    found = binaries_of(two)
    assert set(found) == {f"binaries/{folder}/gough_stewart{suffix}" for folder, suffix, _ in TARGETS.values()}
    assert found["binaries/linux64/gough_stewart.so"].endswith(b"x86_64-linux-gnu.2.17")
    universal = found["binaries/darwin64/gough_stewart.dylib"]
    magic, n = struct.unpack_from(">II", universal)  # Apple's <mach-o/fat.h> and <mach/machine.h>
    assert (magic, n) == (0xCAFEBABE, 2)
    for k, (processor, kind, name) in enumerate(((0x01000007, 3, "x86_64-darwin"), (0x0100000C, 0, "aarch64-darwin"))):
        *found_kind, offset, size, power = struct.unpack_from(">IIIII", universal, 8 + 20 * k)
        assert found_kind == [processor, kind]
        assert power == 14
        assert offset % 2**power == 0
        assert universal[offset : offset + size].endswith(TARGETS[name][2].encode())
    # alone it is where FMPy looks on such a machine, too
    arm = binaries_of(built(tmp_path, "aarch64-linux", fmi="2.0"))
    assert arm["binaries/linux64/gough_stewart.so"] == arm["binaries/aarch64-linux/gough_stewart.so"]
    apple = binaries_of(built(tmp_path, "aarch64-darwin", fmi="2.0"))
    assert apple["binaries/darwin64/gough_stewart.dylib"].endswith(TARGETS["aarch64-darwin"][2].encode())
    assert zig.calls() == []


def test_a_library_for_apples_processors_has_the_digests_of_its_pages(tmp_path: Path) -> None:
    """Expected: SHA-256 of each page in the signature's code directory; start values are written after signing."""
    (library,) = binaries_of(built(tmp_path, "aarch64-darwin")).values()
    (n_commands,) = struct.unpack_from("<I", library, 16)
    at, signature = 32, 0
    for _ in range(n_commands):
        command, size, offset = struct.unpack_from("<III", library, at)
        signature, at = (offset if command == 0x1D else signature), at + size  # LC_CODE_SIGNATURE
    (directory,) = (
        signature + place
        for k in range(struct.unpack_from(">I", library, signature + 8)[0])
        for kind, place in [struct.unpack_from(">II", library, signature + 12 + 8 * k)]
        if kind == 0  # CSSLOT_CODEDIRECTORY
    )
    hashes, _, _, n_pages, limit = struct.unpack_from(">IIIII", library, directory + 16)
    size, kind, _, power = struct.unpack_from(">BBBB", library, directory + 36)
    assert (size, kind, limit) == (32, 2, signature)
    for page in range(n_pages):
        content = library[page << power : min(page + 1 << power, limit)]
        place = directory + hashes + 32 * page
        assert library[place : place + 32] == hashlib.sha256(content).digest(), page


def test_a_library_is_kept_and_a_damaged_one_is_compiled_anew(zig: FakeZig, tmp_path: Path) -> None:
    """Expected: one run for both versions; another after a flipped bit, a lost digest, or with another compiler."""
    path = built(tmp_path / "first")
    assert path.name == "gough_stewart_fmi3.fmu"
    first = path.read_bytes()
    assert built(tmp_path / "first", fmi="2.0").exists()
    assert len(zig.calls()) == 1
    (library,) = (path for path in (zig.cache / "gough_stewart").rglob("gough_stewart.*") if path.suffix != ".sha256")
    for damaged in (0, -1):
        content = bytearray(library.read_bytes())
        content[damaged] ^= 1
        library.write_bytes(content)
        assert built(tmp_path / "second").read_bytes() == first
        assert len(zig.calls()) == 1
    library.with_name(f"{library.name}.sha256").unlink()
    assert built(tmp_path / "second").read_bytes() == first
    assert len(zig.calls()) == 1


def test_the_environment_chooses_the_compiler_of_this_machine(
    zig: FakeZig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: $CC with its options; other targets stay zig's; what one has made is not taken for another's."""
    monkeypatch.setenv("CC", f"{zig.as_cc()} -m64 '-DA=b c'")
    built(tmp_path)
    (call,) = zig.calls()
    assert call[:2] == ["-m64", "-DA=b c"]
    assert "-target" not in call
    other = next(name for name in TARGETS if "linux" in name and name not in str(binaries_of(built(tmp_path))))
    built(tmp_path, other)
    ((first, *_),) = zig.calls()
    assert first == "cc"
    monkeypatch.delenv("CC")
    built(tmp_path)
    assert len(zig.calls()) == 1
    monkeypatch.setenv("CC", "nowhere --fast")
    with pytest.raises(
        gs.GoughStewartError, match=r"the environment variable CC is 'nowhere --fast'; expected a C com"
    ):
        built(tmp_path)


STUMBLES = fails(LINKER, "objects.is_file() or (objects / 'cut').exists()") + "objects.mkdir(exist_ok=True)\n"


@pytest.mark.parametrize("damage", ["object", "file", "link"])
def test_objects_that_the_compiler_stumbles_over_are_made_anew(zig: FakeZig, tmp_path: Path, damage: str) -> None:
    """Expected: a second run in an empty folder; what lies beside it, or behind a link, stays."""
    zig.rule("(folder / 'objects').write_text(str(objects))")
    built(tmp_path)
    objects = Path((zig.folder / "objects").read_text())
    assert objects.parent == zig.cache
    shutil.rmtree(zig.cache / "gough_stewart")
    place = tmp_path / "elsewhere" if damage == "link" else objects
    if damage == "file":
        objects.write_text("")
    else:
        place.mkdir()
        (place / "cut").write_text("")
    if damage == "link":
        objects.symlink_to(place)
    zig.calls()
    zig.rule(STUMBLES)
    built(tmp_path)
    assert len(zig.calls()) == 2
    assert not objects.is_symlink()
    assert not (objects / "cut").exists()
    assert damage != "link" or (place / "cut").exists()
    assert (zig.cache / "gough_stewart").exists()


def test_a_cache_that_cannot_be_written_is_named_with_a_remedy(
    zig: FakeZig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: where a file is in the place of its folder, which keeps even root from writing there."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(tmp_path / "file"))
    with pytest.raises((gs.GoughStewartError, OSError), match="set ZIG_GLOBAL_CACHE_DIR or XDG_CACHE_HOME") as caught:
        built(tmp_path)
    assert str(tmp_path / "file") in str(caught.value)
    assert zig.calls() == []


@pytest.fixture
def kept(tmp_path: Path) -> Iterator[Path]:
    """The folder of a unit from before, which a failure leaves as it was, with nothing beside it."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "gough_stewart_fmi3.fmu").write_bytes(b"old")
    yield tmp_path / "out"
    assert [(file.name, file.read_bytes()) for file in (tmp_path / "out").iterdir()] == [
        ("gough_stewart_fmi3.fmu", b"old")
    ]


@pytest.mark.parametrize("kind", ["error", "fatal error", "warning"])
def test_a_fault_of_a_source_is_shown_as_it_is(zig: FakeZig, kept: Path, kind: str) -> None:
    """Expected: one run and the compiler's words alone; a warning is not why it failed, and the cache is emptied."""
    words = f"{zig.cache}/0123/a.c:3:14: {kind}: expected ';'"
    zig.rule(fails(words))
    with pytest.raises(gs.GoughStewartError) as caught:
        built(kept)
    assert str(caught.value).startswith("the compiler failed for ")
    assert str(caught.value).endswith(f":\n{words}") == (kind != "warning")
    assert len(zig.calls()) == (2 if kind == "warning" else 1)


@pytest.mark.parametrize("words", ["", LINKER])
@pytest.mark.parametrize("full", ["temporary", "cache", "neither"])
def test_a_full_disk_is_named_with_the_variable_that_helps(
    zig: FakeZig, kept: Path, full: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: the folder that has no 16 MB left; else, after another try, the cache itself."""
    zig.rule(fails(words or 7))  # type: ignore[arg-type]
    room = shutil.disk_usage

    def usage(folder: Path) -> Any:
        is_cache = Path(folder) == zig.cache
        is_full = full == ("cache" if is_cache else "temporary")
        return SimpleNamespace(free=1_500_000 if is_full else 16_000_000)

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with pytest.raises(gs.GoughStewartError) as caught:
        built(kept)
    monkeypatch.setattr(shutil, "disk_usage", room)
    remedy = {
        "temporary": f"Only 1.5 MB are free in {tempfile.gettempdir()}, set TMPDIR to a folder with at least 16 MB.",
        "cache": f"Only 1.5 MB are free in {zig.cache}, set ZIG_GLOBAL_CACHE_DIR to a folder with at least 16 MB.",
        "neither": f"if there is no other explanation, delete the folder {zig.cache}",
    }
    assert str(caught.value).endswith(remedy[full])
    assert (words or "exit code 7 without a message") in str(caught.value)
    assert len(zig.calls()) == (2 if full == "neither" else 1)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
@pytest.mark.parametrize("end", ["interrupt", "failure"])
def test_an_end_of_the_build_ends_the_compilers_and_all_they_have_started(
    zig: FakeZig, kept: Path, tmp_path: Path, end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: no process left, and nothing in the temporary folder; one compiler takes for ever, another fails."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    zig.rule(
        f"if {'x86_64' if end == 'interrupt' else 'aarch64'!r} in target:\n"
        "    child = subprocess.Popen(['sleep', '1000'])\n"
        "    (folder / 'child.new').write_text(str(child.pid))\n"
        "    (folder / 'child.new').rename(folder / 'child')\n"
        + ("    os.kill(os.getppid(), signal.SIGINT)\n" if end == "interrupt" else "")
        + "    time.sleep(1000)\n"
        "while not (folder / 'child').exists(): time.sleep(0.02)\n" + fails(f"{zig.cache}/a.c:1:1: error: no")
    )
    # a test run in the background may have been told to ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt if end == "interrupt" else gs.GoughStewartError):
            built(kept, *(["x86_64-linux"] if end == "interrupt" else ["x86_64-linux", "aarch64-linux"]))
    finally:
        signal.signal(signal.SIGINT, before)
    child = Path("/proc", (zig.folder / "child").read_text())
    # it may take a moment to die, and init to bury it
    given_up = time.monotonic() + 20
    while child.exists() and "State:\tZ" not in (child / "status").read_text():
        assert time.monotonic() < given_up
        time.sleep(0.02)
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_wrong_option_is_named(tmp_path: Path) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"fmi": 3.0}, "no FMI version 3.0; expected '2.0' or '3.0'"),
        ({"targets": ["amiga"]}, f"no target 'amiga'; expected native, all, or one of {', '.join(TARGETS)}$"),
        ({"targets": []}, "no target"),
        ({"targets": None}, "no target None; expected native, all"),
        ({"forms": ["urdf"]}, "no form 'urdf'; expected 'fmu' or 'mjcf'"),
        ({"forms": []}, "no form"),
    ]
    for options, expected in cases:
        with pytest.raises(gs.GoughStewartError, match=expected):
            gs.build(tmp_path, **options)
    assert list(tmp_path.iterdir()) == []
