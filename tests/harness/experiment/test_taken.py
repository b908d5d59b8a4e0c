"""What `run` and `margins` take: files, shipped names, experiments, settings, controllers; and what is made of runs."""

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

import gough_stewart as gs
from gough_stewart.harness.control.loop_transfer import loop_transfer
from gough_stewart.harness.control.margins import loop_margins
from gough_stewart.harness.errors import ControllerError, ExperimentError, RecordError
from gough_stewart.harness.experiment.file import experiment_of, shipped_experiment, shipped_text
from gough_stewart.harness.experiment.files import warnings_of
from gough_stewart.model.errors import OutputError

SHORT = {"loop.duration": 0.03, "loop.plant_step": 0.0005, "reference.frequency": 3.0, "plant.kind": "model"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An experiment of one's own, with its platform beside it."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "mine.toml").write_text(
        shipped_text("circle").replace('preset = "liu2000"', 'file = "heavy.toml"'), encoding="utf-8"
    )
    text = (Path(__file__).parents[3] / "model/presets/liu2000.toml").read_text("utf-8")
    (folder / "heavy.toml").write_text(text.replace("platform_mass = 10", "platform_mass = 13"), encoding="utf-8")
    return folder


def test_settings_are_a_mapping_or_texts() -> None:
    """Expected: the same experiment; arrays are lists, and what is in no text stays as it is."""
    texts = ["loop.delay=3", "plant.kind=fmu2", "reference.position_change=[0, 0, '5 mm']", "sensors.seed=7"]
    mapping: dict[str, Any] = {
        "loop.delay": np.int64(3),
        "plant.kind": "fmu2",
        "reference.position_change": [0, 0, "5 mm"],
        "sensors.seed": 7,
    }
    assert gs.load_experiment("heave_step", mapping) == shipped_experiment("heave_step", texts)
    change = gs.load_experiment("heave_step", {"reference.position_change": np.array([0.01, 0, 0.02])}).reference
    assert change.position_change == (0.01, 0, 0.02)  # type: ignore[union-attr]
    one_text = gs.load_experiment("heave_step", "loop.delay=3")
    assert one_text.loop.delay == 3


@pytest.mark.parametrize("key", ["", "loop..delay", "title.more"])
def test_a_key_that_is_none_is_refused_by_its_name(key: str) -> None:
    with pytest.raises(ExperimentError, match=f"setting '{key}'"):
        gs.load_experiment("heave_step", {key: 1})


def test_a_file_a_name_and_an_experiment_run_alike(folder: Path) -> None:
    """Expected: bit by bit the same records; the file names a platform of 13 kg beside it, settings leave it there."""
    from_file = gs.run(folder / "mine.toml", SHORT)
    as_text = gs.run(str(folder / "mine.toml"), SHORT)
    loaded = gs.run(gs.load_experiment(folder / "mine.toml"), SHORT)
    whole = gs.run(gs.load_experiment(folder / "mine.toml", SHORT))
    by_name = gs.run("circle", {**SHORT, "platform.parameters": {"platform_mass": 13}})
    for other in (as_text, loaded, whole, by_name):
        assert other.table.equals(from_file.table)
    assert from_file.metadata["platform"]["platform_mass"] == 13
    assert len(from_file["time"]) == 61


def test_a_file_of_a_shipped_name_goes_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    (folder / "circle").write_text((folder / "mine.toml").read_text("utf-8"), encoding="utf-8")
    assert gs.load_experiment("circle").platform.file == "heavy.toml"
    assert gs.load_experiment("pitch_sine") == shipped_experiment("pitch_sine")


def test_what_is_no_experiment_is_refused() -> None:
    with pytest.raises(ExperimentError, match=r"is 3; expected an Experiment, a file, or a shipped name"):
        experiment_of(3)  # type: ignore[arg-type]
    with pytest.raises(ExperimentError, match=r"cannot read this experiment.*'heave_step'"):
        gs.run("heave_stp")


def test_margins_are_those_of_the_experiments_loop() -> None:
    """Expected: `loop_margins` of the loop put together by hand, with what the file says of it."""
    settings = {"loop.delay": 2, "actuators.lag": 0.004, "controller.bandwidth": 1.7, "controller.damping_ratio": 0.9}
    found = gs.margins("heave_step", settings)
    platform = gs.load_preset("motion_base")
    gains = gs.gains_from_bandwidth(platform, 1.7, 0.9)
    controller = gs.LinearController(gs.sampled(gs.pid(gains, "measurement"), 1e-3))
    by_hand = loop_margins(loop_transfer(platform, controller, 1e-3, delay=2, lag=0.004))
    assert found.disk == by_hand.disk
    assert found.legs == by_hand.legs
    assert found.gains is not None
    assert np.asarray(found.gains.derivative) == pytest.approx(np.asarray(gains.derivative))
    assert (found.title, found.sample_time, found.delay, found.lag) == ("heave step", 1e-3, 2, 0.004)


def test_margins_take_a_controller_in_the_place_of_the_experiments() -> None:
    """Expected: half the gains make half the loop transfer; the experiment's own controller makes its own margins."""
    platform = gs.load_preset("motion_base")
    full = gs.sampled(gs.pid(gs.gains_from_bandwidth(platform, 2.0, 0.8), "measurement"), 1e-3)
    half = control.ss(full.A, full.B, full.C / 2, full.D / 2, full.dt)
    of_full, of_half = (gs.margins("heave_step", controller=each) for each in (full, half))
    assert of_full.gains is None
    assert np.allclose(of_half.loop.C, of_full.loop.C / 2, rtol=1e-12)
    assert gs.margins("heave_step").disk.alpha == pytest.approx(of_full.disk.alpha)
    with pytest.raises(ControllerError, match="a function has no transfer function"):
        gs.margins("heave_step", controller=lambda _sample: np.zeros(6))
    with pytest.raises(ControllerError, match="an open loop has no margins"):
        gs.margins("paper_open_loop")


def test_margins_in_plain_types_are_json() -> None:
    """Expected: strict JSON, with the numbers of the object; nothing infinite."""
    found = gs.margins("payload_change")
    plain = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert plain["margins"]["disk"]["alpha"] == found.disk.alpha
    assert len(plain["modes"]) == len(found.modes)
    assert [mode["frequency"] for mode in plain["modes"]] == sorted(mode["frequency"] for mode in plain["modes"])
    assert plain["gains"]["proportional"] == np.asarray(found.gains.proportional).tolist()  # type: ignore[union-attr]


def test_the_files_of_a_run_read_back(tmp_path: Path) -> None:
    """Expected: the same table from the folder, all files that are named, and the page of the folder."""
    record = gs.run("circle", SHORT)
    files = gs.save_record(record, tmp_path / "new" / "circle", report=True, figures=True)
    assert {path.name for path in files} == {path.name for path in (tmp_path / "new" / "circle").iterdir()}
    assert {"record.parquet", "metrics.json", "pose.svg", "report.html"} <= {path.name for path in files}
    assert gs.read_record(tmp_path / "new" / "circle").table.equals(record.table)
    with pytest.raises(OutputError, match="is a file"):
        gs.save_record(record, files[0])


def test_a_page_shows_records_and_folders_under_their_names(tmp_path: Path) -> None:
    """Expected: titles, numbered where they are the same; folders by name; names as they are given."""
    record = gs.run("circle", SHORT)
    gs.save_record(record, tmp_path / "kept")
    title = record.metadata["title"]
    page = gs.view([record, tmp_path / "kept", record], tmp_path / "deep" / "page.html")
    text = page.read_text("utf-8")
    assert all(f'"name":"{name}"' in text for name in (f"{title} (1)", "kept", f"{title} (3)"))
    assert f'"name":"{title}"' in gs.view(record, tmp_path / "one.html").read_text("utf-8")
    assert '"name":"mine"' in gs.view(record, str(tmp_path / "named.html"), names=["mine"]).read_text("utf-8")
    with pytest.raises(RecordError, match="2 names for 1 records"):
        gs.view(record, tmp_path / "x.html", names=["a", "b"])
    with pytest.raises(OutputError, match=r"expected the name of a page, such as .*kept\.html"):
        gs.view(record, tmp_path / "kept")


def test_feedforward_beyond_the_force_limit_is_said_with_leg_and_time() -> None:
    """Expected: the largest force of computed torque over the run, by hand; silence within the limit."""
    settings = {"loop.duration": 0.05, "loop.sample_time": 0.002, "loop.plant_step": 0.001}
    free = gs.run("circle_computed_torque", settings, plant="model")
    assert warnings_of(free) == []
    forces = np.abs(free["controller.feedforward"])
    row, leg = divmod(int(forces.argmax()), 6)
    weak = {"actuators.force_limit": 0.75 * forces.max(), "limits.reference": "warn"}
    limited = gs.run("circle_computed_torque", {**settings, **weak}, plant="model")
    (warning,) = warnings_of(limited)
    assert f"{forces.max():.4g} N of leg {leg + 1} at {free['time'][row]:.6g} s; its force limit is" in warning


@pytest.mark.parametrize("more", [False, True])
def test_files_that_could_not_be_written_are_named(more: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: those of the set that was asked for, with or without page and figures, less the three of the record."""
    record = gs.run("circle", SHORT)

    def fails(_: object) -> bytes:
        raise RuntimeError("no numbers today")

    monkeypatch.setattr("gough_stewart.harness.experiment.files.metrics_json", fails)
    with pytest.raises(RuntimeError, match="no numbers today") as caught:
        gs.save_record(record, tmp_path, report=more, figures=more)
    names = ("errors", "pose", "actuators", "legs")
    pictures = [f"{name}.{kind}" for name in names for kind in ("pdf", "png", "svg")]
    missing = ["metrics.json", *([*pictures, "report.html"] if more else [])]
    (note,) = caught.value.__notes__
    there, _, rest = note.removeprefix(f"{tmp_path} has ").partition("; missing: ")
    assert rest == ", ".join(missing)
    assert set(there.split(", ")) == {"record.parquet", "record.csv", "metadata.json"}
    assert {path.name for path in tmp_path.iterdir()} == set(there.split(", "))
