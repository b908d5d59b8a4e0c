"""Wrong and clumsy uses of the command line: the exit code, what the one line says, and that nothing is written."""

import os
import re
import shlex
from pathlib import Path

import pytest

import gough_stewart as gs
from tests.support.commands import invoke
from tests.support.records import waving_record

TUNE = "tune heave_step --minimise tracking.position.norm_rms"
BANDWIDTH = "--vary controller.bandwidth=1..6Hz"
MEMBERS = "ensemble heave_tolerances --set loop.duration=0.1"
SHARE = "tracking.position.norm_peak<=1mm for 90% of members"
# Words, the exit code, a pattern of the message.
WRONG = [
    # names
    ("presets nope", 2, "no such preset; expected one of desktop_hexapod"),
    ("workspace --preset nope", 2, "no such preset; expected one of desktop_hexapod"),
    ("build --target nope", 2, "no target 'nope'; expected native, all"),
    ("export heave_step --as fmi", 2, r"no form 'fmi'; did you mean 'fmu'\?"),
    ("reproduce --order sideways", 2, "plus-first"),
    ("check pitch_sine --fit both", 2, "'time'"),
    ("run nothing.toml", 1, "nothing.toml: cannot read this experiment: No such file.*; expected a TOML file, or a"),
    ("reproduce --platform none.toml", 1, "none.toml: cannot read this platform file: No such file"),
    ("workspace motion_base", 2, r"unexpected extra argument.*; a platform is given as `--preset motion_base`"),
    ("build mine.toml", 2, r"unexpected extra argument.*; a platform is given as `--platform mine.toml`"),
    ("margins heave_step motion_base", 2, "unexpected extra argument(?!.*a platform)"),
    # platforms
    ("reproduce --platform heavy.toml", 1, "platform_mass: is -10 kg; expected > 0"),
    ("reproduce --platform typo.toml", 1, r"did you mean 'platform_mass'\?"),
    ("reproduce --platform broken.toml", 1, "is not TOML"),
    ("reproduce --platform turned.toml", 1, "singular pose"),
    # places
    ("run heave_step --out heavy.toml", 1, "heavy.toml is a file; expected a folder"),
    ("reproduce --out taken", 1, "comparison.json is a folder there"),
    ("run heave_step --out ''", 2, r"Invalid value for '--out': is empty; expected a path, or \. for the current"),
    ("run heave_step --fmu ''", 2, "Invalid value for '--fmu': is empty"),
    ("live heave_step --no-open --out x.txt", 2, "expected the name of a page, such as x.txt.html"),
    # records and reports
    ("view", 2, "Missing argument"),
    ("view waves --out page", 2, "--out page: expected the name of a page"),
    ("view waves --out heavy.toml/page.html", 1, "is a file; expected a folder"),
    ("view waves nowhere", 1, "no such file or folder; expected the folder of a command, its report.json, or the re"),
    ("view waves tuned", 1, "the folder has no record; it has a tuning; run tuned.toml"),
    ("view waves text.csv", 1, "metadata.json.*expected record.parquet"),
    ("view waves text.parquet", 1, "cannot be read as a record.*expected record.parquet"),
    (f"view {7 * 'waves '}", 1, "7 records; expected 1 to 6"),
    *((f"view report{k}", 1, "report.json: cannot be read as a report: ") for k in range(5)),
    # options that contradict each other
    ("reproduce --preset liu2000 --platform heavy.toml", 2, "exclude each other"),
    ("reproduce --preset motion_base --order plus-first", 2, "--order applies only to the paper's own"),
    (f"{MEMBERS} --workers 2 --scheduler tcp://h:1", 2, "--workers and --scheduler exclude each other"),
    ("identify a.csv --validate b.csv --validation 0.2 --estimate platform_mass", 2, "exclude each other; give one"),
    ("identify waves --preset desktop_hexapod --estimate platform_mass --validation 1.5", 1,
     "validation is 1.5; expected a share of the log"),
    ("run heave_step --fmu no.fmu", 1, "plant 'model' does not accept the file no.fmu"),
    ("build --target x86_64-windows --check", 2, "add `--target native`"),
    # values
    ("run heave_step --plant fmu4", 2, "'--plant': 'fmu4' is not one of 'model', 'scipy', 'fmu2', 'fmu3'"),
    (f"{MEMBERS} --members x", 2, "'--members': expected a whole number"),
    (f"{MEMBERS} --members 0", 2, "'--members': expected a number greater than or equal to 1"),
    ("excite --duration long", 2, "'--duration': expected a number"),
    ("run heave_step --set x", 2, "--set x: expected key=value"),
    ("run heave_step --set loop.latency=1", 1, "loop.latency: unknown key"),
    ("run heave_step --set platform.parameters.platform_mass=-1", 1, "platform: platform_mass: is -1"),
    (f"run heave_step --set title={os.fsdecode(b'caf' + bytes([0xE9]))}", 1, "expected text in UTF-8"),
    ("run heave_tolerances --member 1000", 1, "member: is 1000; expected 0 to 999"),
    ("run heave_step --set platform.file=no.toml", 1, "platform: no.toml: cannot read this platform file"),
    ("run heave_step --plant fmu3 --fmu no.fmu", 1, "no.fmu: no such file"),
    ("check pitch_sine --set reference.time_scale=0", 1, "reference.time_scale: is 0; expected > 0"),
    ("check pitch_sine --set limits.reference=ignore", 1, "is 'ignore'; expected 'refuse' or 'warn'"),
    ("check paper_open_loop", 1, "is missing; add one"),
    ("margins paper_open_loop", 1, "an open loop has no margins"),
    ("margins too_slow", 1, r"the closed loop is unstable \(worst eigenvalue"),
    ("export heave_step --as ssp --reference inputs", 1, "leaves an SSP without a reference"),
    ("export heave_step --set 'reference.position_change=[0, 0, 3]'", 1, "leg"),
    ("export paper_open_loop", 1, "its forces are constant"),
    ("export saturation --as c --frozen 50", 1, "--frozen is '50'; expected a number of samples and a length"),
    ("run circle --controller fmu3", 1, "expected a loop.delay of at least 1, for instance by --set loop.delay=1"),
    ("excite --duration 0", 2, "--duration is 0; expected a number > 0"),
    ("excite --frequency inf --fade -1", 2, "--frequency is inf; expected a number > 0"),
    ("workspace --at yaw=40", 2, "yaw is 40 rad, 2291.83°; expected .*numbers without a unit are in rad"),
    ("serve heave_step --udp 0 --rate 251", 2, "a stream of 251 rows a second; expected 1 to 250"),
    ("serve heave_step --udp 0 --silence 0", 2, "expected a time above 0"),
    ("serve heave_step --udp 0 --duration -1", 2, "greater than or equal to 0"),
    ("serve paper_open_loop --udp 0", 2, "follows no reference"),
    ("serve heave_step --udp 0 --host 1.2.3.4.5", 2, "choose others"),
    # ensembles and searches
    ("ensemble heave_step", 1, "ensemble: is missing; add it to declare what varies, or start from heave_tolerances"),
    (f"{MEMBERS} --set ensemble.worst_by=force.peek", 1, r"no metric 'force.peek'; did you mean 'force.peak'\?"),
    (f"{MEMBERS} --set 'ensemble.platform_mas={{normal=[1,1]}}'", 1, r"did you mean 'platform_mass'"),
    (f"{TUNE} --vary x", 2, r"--vary x: expected KEY=LOW\.\.HIGH"),
    (f"{TUNE} --vary controller.nope=1..2", 2, r"controller\.nope: .*did you mean|unknown|no such|no key"),
    (f"{TUNE} {BANDWIDTH} --subject-to stroke.margin", 2, "cannot be read; expected PATH <= NUMBER UNIT"),
    (f"tune heave_step {BANDWIDTH} --minimise nope", 2, "--minimise: no metric 'nope'"),
    (f"{TUNE} {BANDWIDTH} --over-ensemble quantile=1", 2, "quantile=1: heave_step has no .ensemble."),
    (f"{TUNE} {BANDWIDTH} --over-ensemble quantile=2", 2, "expected quantile=Q with Q above 0, up to 1"),
    (f"{TUNE} {BANDWIDTH} --members 8", 2, "members is 8, and all members would be the same"),
    (f"{TUNE} {BANDWIDTH} --fresh 8", 2, "fresh is 8, and all members would be the same"),
    # requirements, before anything is computed; a number that another command has is named with it
    ("run heave_step --require 'tracking.positoin.norm_peak<=1mm'", 2, r"did you mean 'tracking\.position\.norm_peak'"),
    (f"run heave_step --require '{SHARE}'", 2, "is on a share of members, and this study has none"),
    ("run heave_step --require 'limits.stroke<=90%'", 2, "no number 'limits.stroke'; `gough-stewart check` has it"),
    ("check frequency_response --require 'limits.stroke<=1' --set platform.preset=liu2000", 2,
     "no limit of the stroke is stated; set platform.parameters.leg_length_min or platform.parameters.leg_length_max"),
    ("check heave_step --require 'limits.actuator_force_max<=1' --set actuators.force_limit=none", 2,
     "no limit of the force is stated; set actuators.force_limit"),
    (f"{MEMBERS} --require 'margins.disk>=0.1'", 2, "no number 'margins.disk'; `gough-stewart margins` has it"),
    (f"{TUNE} {BANDWIDTH} --require 'valeu<=1'", 2, "no number 'valeu'; did you mean 'value'"),
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files and folders with something wrong; no test adds to them."""
    place = tmp_path_factory.mktemp("refused")
    text = invoke("presets", "liu2000").stdout
    for name, old, new in (
        ("heavy", "platform_mass = 10.0", "platform_mass = -10.0"),
        ("typo", "platform_mass", "platfom_mass"),
        ("broken", text, "= 3"),
        # with its start turned by −0.1 − 1.5 rad the mechanism stands beside its singular pose
        ("turned", "home_orientation = [0.0, 0.0, 0.0]", "home_orientation = [0.0, 0.0, -1.5]"),
    ):
        (place / f"{name}.toml").write_text(text.replace(old, new))
    gs.save_record(waving_record(gs.load_preset("desktop_hexapod"), rows=50), place / "waves")
    for name in ("taken/comparison.json/x", "tuned/tuning.json"):
        (place / name).parent.mkdir(parents=True)
        (place / name).touch()
    for name in ("text.csv", "text.parquet"):
        (place / name).write_text("a,b\n1,2\n")
    for k, content in enumerate(("{", "[]", '{"version": 7}', '{"version": 1}', "ü")):
        (place / f"report{k}").mkdir()
        (place / f"report{k}/report.json").write_text(content, encoding="cp1252")
    return place


@pytest.mark.parametrize(("words", "code", "says"), WRONG, ids=[ascii(words) for words, *_ in WRONG])
def test_what_is_wrong_is_one_line_and_writes_nothing(
    words: str, code: int, says: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(folder.rglob("*"))
    monkeypatch.chdir(folder)
    done = invoke(*shlex.split(words))
    said = " ".join(done.stderr.replace("│", " ").split())
    assert (done.exit_code, bool(re.search(says, said))) == (code, True), done.output
    if "Usage" not in said:
        assert len([line for line in done.stderr.splitlines() if not line.startswith("warning: ")]) == 1
    assert sorted(folder.rglob("*")) == before


def test_a_folder_without_permission_is_refused_before_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    done = invoke("run", "heave_step", "--out", str(tmp_path / "out"))
    assert (done.exit_code, "no permission to write" in done.output) == (1, True)


def test_the_documentation_has_the_table_of_exit_codes() -> None:
    """Expected: its rows have the codes and meanings that the help states."""
    docs = Path(__file__).parents[3] / "docs"
    rows = re.findall(r"^\| (\d+) \| ([^|]+) \|", (docs / "commands.md").read_text(encoding="utf-8"), re.MULTILINE)
    (codes,) = re.findall(r"Exit codes: (.*)\.", " ".join(invoke("--help", columns=400).stdout.split()))
    told = [entry.partition(" ")[::2] for entry in codes.split("; ")]
    assert rows[: len(told)] == told
    assert len(told) == 6
