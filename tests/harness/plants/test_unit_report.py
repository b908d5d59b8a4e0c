"""The page of `build`, by what FMPy reads in the units and by what its commands do."""

import csv
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import cli, read_model_description
from lxml import html

import gough_stewart as gs
from tests.support.commands import invoke


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both units of a machine, with their page."""
    folder = tmp_path_factory.mktemp("units")
    done = invoke("build", "--preset", "motion_base", "--out", str(folder), "--report")
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> Any:
    return html.document_fromstring((folder / "report.html").read_bytes())


def test_the_page_lists_every_variable_as_the_model_description_has_it(folder: Path, page: Any) -> None:
    """Expected: by FMPy, of arrays in FMI 3.0 and of their elements in FMI 2.0: causality, unit, references, start."""
    rows = {row[0].text_content(): [cell.text_content() for cell in row[1:]] for row in page.xpath("//tbody/tr")}
    by_version: dict[str, dict[str, list[Any]]] = {"2": {}, "3": {}}
    for version, variables in by_version.items():
        for variable in read_model_description(str(folder / f"gough_stewart_fmi{version}.fmu")).modelVariables:
            name = variable.name.partition("[")[0]
            if name != "time" and not name.startswith("der("):
                variables.setdefault(name, []).append(variable)
    assert set(rows) == set(by_version["2"]) == set(by_version["3"])
    late = {row[0].text_content() for row in page.xpath("//tbody/tr[contains(@class, 'late')]")}
    assert late == {name for name, (causality, *_) in rows.items() if causality in ("parameter", "local")}
    for name, (causality, elements, unit, slots, reference, start) in rows.items():
        (whole,), parts = by_version["3"][name], by_version["2"][name]
        references = [int(part.valueReference) for part in parts]
        assert causality == whole.causality == parts[0].causality
        assert unit == written_unit(whole.unit)
        assert slots == (f"{references[0]} to {references[-1]}" if len(parts) > 1 else str(references[0]))
        assert reference == str(whole.valueReference)
        assert elements == (" × ".join(str(each.start) for each in whole.dimensions) or "1")
        shown = [float(number) for number in re.split("[,;] ", start)] if start else []
        given = [float(number) for number in (whole.start or "").split()]
        assert shown == pytest.approx(given, rel=1e-5)


def written_unit(unit: str | None) -> str:
    """As people write it."""
    text = (unit or "").replace(".", "·").replace("2", "²")
    return "" if text == "1" else text


def test_the_page_lists_the_files_and_its_commands_drive_the_units(
    folder: Path, page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: links to both units; leg 1 is longer after FMPy's push; a closed loop on it completes."""
    assert page.xpath("//ul[@class='files']//a/@href") == ["gough_stewart_fmi2.fmu", "gough_stewart_fmi3.fmu"]
    commands = [shlex.split(each.text_content()) for each in page.xpath("//code")]
    push, stand = (words for words in commands if words[:3] == ["python", "-m", "fmpy"])
    loops = [words for words in commands if words[0] == "gough-stewart"]
    monkeypatch.chdir(folder)
    for words in (push, stand):
        monkeypatch.setattr("sys.argv", ["fmpy", *words[3:]])
        cli.main()
    first, *_, last = csv.DictReader((folder / "fmi2.csv").read_text().splitlines())
    changes = [float(last[f"leg_length[{k}]"]) - float(first[f"leg_length[{k}]"]) for k in range(1, 7)]
    assert changes[0] == max(changes) > 1e-3
    first, *_, last = csv.DictReader((folder / "fmi3.csv").read_text().splitlines())
    for name in ("position", "leg_length"):  # arrays, with blanks between their elements
        assert np.array(last[name].split(), float) == pytest.approx(np.array(first[name].split(), float), abs=1e-6)
    assert [words[4] for words in loops] == ["fmu2", "fmu3"]
    done = invoke(*loops[1][1:], "--set", "loop.duration=0.02", "--out", str(folder / "loop"))
    assert done.exit_code == 0, done.output
    assert gs.read_record(folder / "loop").metadata["plant"] == "fmu3"
