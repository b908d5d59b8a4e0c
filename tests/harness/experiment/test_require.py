"""The table `[require]` of an experiment file."""

from pathlib import Path

import pytest

from gough_stewart.harness.errors import ExperimentError
from gough_stewart.harness.experiment.file import load_experiment, shipped_text

_WRITTEN = """
[require]
tracking.position.norm_peak = "<= 1 mm"
"force.peak" = ["<= 800 N for 95 % of members", "> 0"]
"""


def _experiment(folder: Path, text: str) -> Path:
    file = folder / "mine.toml"
    file.write_text(shipped_text("heave_step") + text, encoding="utf-8")
    return file


def test_paths_may_have_dots_or_be_quoted(tmp_path: Path) -> None:
    found = load_experiment(_experiment(tmp_path, _WRITTEN))
    assert found.requirements == (
        "tracking.position.norm_peak <= 1 mm",
        "force.peak <= 800 N for 95 % of members",
        "force.peak > 0",
    )
    assert load_experiment("heave_step").requirements == ()
    # and from what a record keeps of it
    assert found.model_dump(mode="json")["require"]["tracking.position.norm_peak"] == ["<= 1 mm"]
    changed = load_experiment(_experiment(tmp_path, _WRITTEN), {"loop.delay": 3})
    assert changed.requirements == found.requirements


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('force.peak = "800 N"', "the requirement 'force.peak 800 N' cannot be read; expected PATH <= NUMBER UNIT"),
        ("force.peak = 800", "force.peak is 800; expected a condition, such as '<= 1 mm', or a list of them"),
        ('force.peak = ["<= 1 N", 3]', r"force.peak is \['<= 1 N', 3\]; expected a condition"),
    ],
)
def test_a_wrong_condition_is_refused_by_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ExperimentError, match=f"mine.toml: require: .*{message}"):
        load_experiment(_experiment(tmp_path, f"\n[require]\n{text}\n"))
