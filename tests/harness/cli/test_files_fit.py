"""Every file that a command writes goes through every command and every key that takes such a file."""

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from itertools import cycle, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import gough_stewart as gs
from tests.support.commands import commands, invoke

EXPERIMENT, PLATFORM, RECORD, LOG, POSES = "experiment", "platform", "record", "log", "poses"
PLANT, CONTROLLER, ENSEMBLE, OTHER = "plant FMU", "controller FMU", "ensemble", "for people and other programs"

# The first pattern that a file's path ends with says what it is.
KINDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    *((f"record.{suffix}", (RECORD, LOG, POSES)) for suffix in ("parquet", "csv")),
    *((name, (POSES,)) for name in ("open_loop.csv", "poses.csv", "poses.parquet")),
    *((name, (EXPERIMENT,)) for name in ("excitation.toml", "tuned.toml", "*-fitted.toml", "printed/experiment.toml")),
    *((name, (PLATFORM,)) for name in ("printed/preset.toml", "platform.toml")),
    ("gough_stewart_fmi[23].fmu", (PLANT,)),
    ("*_controller_fmi[23].fmu", (CONTROLLER,)),
    ("members.parquet", (ENSEMBLE,)),
    *((f"{name}.parquet", (OTHER,)) for name in ("bands", "samples", "differences", "frf")),
    *((name, (OTHER,)) for name in ("frf.csv", "candidates.csv", "workspace.csv", "needs.csv", "*.ssp", "*.c", "*.h")),
    *((f"*.{suffix}", (OTHER,)) for suffix in ("png", "svg", "html", "json", "md")),
)

OWN = """
title = "own"

[platform]
file = "../platforms/own.toml"

[plant.parameters]
platform_mass = "1.03 t"
leg_coulomb_friction = ["100 N", 90, 80, 100, 90, 80]

[reference]
type = "file"
file = "data/../recorded.csv"
at_home = "start"

[controller]
type = "pd"
bandwidth = "3 Hz"
feedforward = "computed_torque"

[loop]
duration = "0.2 s"
sample_time = "2 ms"
delay = 1

[injection]
type = "multisine"
leg = 2
amplitude = "20 N"
band = [20, 200]
period = 0.05

[ensemble]
members = 2
worst = 1
platform_com = { normal = "1 mm" }
"""
LOOP = "--set loop.duration=0.2"
VARY = "--vary plant.platform_mass=900..1100kg --vary controller.bandwidth=2..4Hz"
TUNE = f"{VARY} --minimise tracking.position.norm_rms --generations 1 --population 5"
MASS = "--estimate platform_mass"
EXCITE = "--duration 1 --frequency 1 --fade 0.3 --trials 1 --harmonics 2"
MEMBERS = "--set \"ensemble={members=2,worst=0,platform_com={normal='1 mm'}}\" --workers 1"
OWN_PLATFORM, OWN_RUN = "--platform platforms/own.toml", "run mine/own.toml --out used/run --set"
# What writes files: every command, in an order in which each has what it needs. `>` is the file of what is printed.
PRODUCERS = (
    "presets motion_base > printed/preset.toml",
    "experiments recorded_ride > printed/experiment.toml",
    "run mine/own.toml --out out/run",
    "frf out/run",
    "view out/run --out out/page.html",
    "margins mine/own.toml --out out/margins",
    "check mine/own.toml --set reference.amplitude_scale=100 --fit amplitude --out out/check",
    f"tune mine/own.toml {TUNE} --out out/tune",
    "ensemble mine/own.toml --workers 1 --out out/ensemble",
    f"excite {OWN_PLATFORM} {EXCITE} {MASS} --out out/excite",
    "run out/excite/excitation.toml --out out/excited",
    f"identify out/excited {OWN_PLATFORM} {MASS} --out out/found",
    f"poses out/excited {OWN_PLATFORM} --out out/poses",
    "export mine/own.toml --as fmu,c,ssp --out out/export",
    "live mine/own.toml --no-open --out out/live.html",
    "serve mine/own.toml --udp 0 --duration 0.1",
    f"build {OWN_PLATFORM} --out out/build",
    f"workspace {OWN_PLATFORM} --points 3 --out out/workspace",
    "reproduce --platform out/excite/platform.toml --out out/reproduce",
)


class Use(NamedTuple):
    """A command line that takes files: `takes` names the kind of each parameter or key, in braces in the line."""

    line: str
    takes: dict[str, str]
    exits: tuple[int, ...] = (0,)
    # the right refusal of some of these files
    unless: tuple[str, ...] = ()


OF_EXPERIMENT, OF_PLATFORM = {"experiment": EXPERIMENT}, {"platform": PLATFORM}
# 3: written, with an alarm that the platform of another command is not that of the log
CONSUMERS = (
    Use(f"run {{experiment}} {LOOP} --out used/run", OF_EXPERIMENT),
    Use(f"check {{experiment}} {LOOP} --out used/check", OF_EXPERIMENT, (0, 3)),
    Use("margins {experiment} --out used/margins", OF_EXPERIMENT),
    Use(f"tune {{experiment}} {LOOP} {TUNE} --out used/tune", OF_EXPERIMENT),
    Use(f"ensemble {{experiment}} --compare {{compare}} {LOOP} {MEMBERS} --out used/compared",
        {"experiment": EXPERIMENT, "compare": EXPERIMENT}),
    Use("export {experiment} --as c --out used/export", OF_EXPERIMENT),
    Use(f"live {{experiment}} {LOOP} --no-open --out used/live.html", OF_EXPERIMENT),
    Use(f"serve {{experiment}} {LOOP} --udp 0 --duration 0.1", OF_EXPERIMENT,
        unless=("follows no reference that a sender can take over",)),
    Use("view {records} --out used/page.html", {"records": RECORD}),
    Use("frf {record} --experiment {experiment} --out used/frf", {"record": RECORD, "experiment": EXPERIMENT},
        unless=("the record's run had no [injection]",)),
    Use(f"identify {{logs}} --validate {{validate}} --platform {{platform}} {MASS} --out used/found",
        {"logs": LOG, "validate": LOG, "platform": PLATFORM}, (0, 3),
        ("the log contradicts this platform", "too short: after the filters")),
    Use(f"identify out/excited {OWN_PLATFORM} {MASS} --experiment {{experiment}} {LOOP} --out used/found",
        OF_EXPERIMENT, (0, 3)),
    Use("poses {log} --platform {platform} --out used/poses", {"log": LOG, "platform": PLATFORM},
        unless=("no pose of this platform has the leg lengths", "no pose near this guess")),
    Use(f"excite --platform {{platform}} {EXCITE} --out used/excite", OF_PLATFORM),
    Use("build --platform {platform} --fmi 3.0 --out used/build", OF_PLATFORM),
    Use("workspace --platform {platform} --points 3 --out used/map", OF_PLATFORM),
    Use("run mine/own.toml --plant {kind} --fmu {fmu} --out used/run", {"fmu": PLANT}),
    Use("run mine/own.toml --controller {controller} --out used/run", {"controller": CONTROLLER}),
    Use(f"{OWN_RUN} platform.file={{platform.file}}", {"platform.file": PLATFORM}),
    Use(f"{OWN_RUN} plant.file={{plant.file}}", {"plant.file": PLATFORM}),
    Use(f"{OWN_RUN} plant.fmu={{plant.fmu}} --set plant.kind={{kind}}", {"plant.fmu": PLANT}),
    Use(f"{OWN_RUN} \"controller={{type='fmu',file='{{fmu.file}}'}}\"", {"fmu.file": CONTROLLER}),
    Use(f"{OWN_RUN} reference.file={{file.file}}", {"file.file": POSES}),
    # of a motion that begins at rest
    Use(f"{OWN_RUN} \"reference={{type='path',timing=5,file='{{path.file}}'}}\"", {"path.file": POSES},
        unless=("poses 1 and 2 of the path are the same",)),
)  # fmt: skip
# Takes seconds, and its option is that of the others: once among the producers, with the file of another command.
TAKEN_ABOVE = {("reproduce", "platform")}


def test_no_command_is_forgotten() -> None:
    """Expected: the commands of the command line, and those of their parameters that take a file."""
    assert {line.split()[0] for line in PRODUCERS} == set(commands())
    declared = {
        (name, parameter.name)
        for name, command in commands().items()
        for parameter in command.params
        if parameter.name != "out" and re.search("FILE|FOLDER|RECORD|LOG", parameter.metavar or "")
    }
    taken = {(use.line.split()[0], name) for use in CONSUMERS for name in use.takes if "." not in name}
    assert taken == declared - TAKEN_ABOVE


def checked(words: Sequence[str], use: Use | None = None) -> str:
    done = invoke(*words)
    said = " ".join(done.output.split())
    if use is not None and any(reason in said for reason in use.unless):
        return said
    assert done.exit_code in (use.exits if use else (0, 3)), f"{' '.join(words)}: {done.output}"
    return str(done.stdout)


def what_is(path: Path) -> tuple[str, ...]:
    found = [kinds for pattern, kinds in KINDS if fnmatch(path.as_posix(), f"*/{pattern}")]
    assert found, f"{path}: is of no kind; enter it in KINDS"
    return found[0]


def lines_of(use: Use, written: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, ...]]:
    """The command lines with which each file of the kinds is taken once in each place."""
    number = max(len(written[kind]) for kind in use.takes.values())
    # different files beside each other where a line takes two of one kind
    places = {name: islice(cycle(written[kind]), k, k + number) for k, (name, kind) in enumerate(use.takes.items())}
    for files in zip(*places.values(), strict=True):
        values = dict(zip(places, files, strict=True))
        kind = "fmu2" if any("fmi2" in file for file in files) else "fmu3"
        yield tuple(filled(word, {**values, "kind": kind}) for word in shlex.split(use.line))


def filled(word: str, values: Mapping[str, str]) -> str:
    for name, value in values.items():
        word = word.replace(f"{{{name}}}", value)
    return word


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapping[str, Sequence[str]]]:
    """The files of all commands by kind, in a folder that is the present one."""
    folder = tmp_path_factory.mktemp("files")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name in ("mine", "mine/data", "platforms", "printed"):
            (folder / name).mkdir()
        (folder / "mine" / "own.toml").write_text(OWN)
        gs.save_platform(gs.load_preset("motion_base"), "platforms/own.toml")
        time = np.linspace(0, 2, 201)
        rows = ["time,position[1],position[2],position[3],orientation[1],orientation[2],orientation[3]"]
        rows += [f"{t:.3f},{0.02 * (1 - np.cos(3 * t)):.6f},0,0,0,0,0" for t in time]
        (folder / "mine" / "recorded.csv").write_text("\n".join(rows))
        given = set(folder.rglob("*"))
        for line in PRODUCERS:
            words, _, target = line.partition(" > ")
            printed = checked(shlex.split(words))
            if target:
                (folder / target).write_text(printed)
        found: dict[str, list[str]] = {}
        for path in sorted(set(folder.rglob("*")) - given):
            if path.is_file():
                for kind in what_is(path):
                    found.setdefault(kind, []).append(str(path))
        # a record is also its folder
        found[RECORD] += sorted({str(Path(each).parent) for each in found[RECORD]})
        yield found


@pytest.mark.evidence
def test_every_file_is_taken_where_such_a_file_is(written: Mapping[str, Sequence[str]]) -> None:
    """Expected: success, or the one refusal that is right; of each kind there are the files of several commands."""
    assert len(written[EXPERIMENT]) == 4
    assert len(written[PLATFORM]) == 3
    for use in CONSUMERS:
        for words in lines_of(use, written):
            checked(words, use)
    for path in written[ENSEMBLE]:
        assert gs.read_ensemble(Path(path).parent).members.height == 2
