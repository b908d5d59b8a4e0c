"""The frame of all pages: what may be in it, and libraries that are not where they are looked for."""

import platform
from importlib.metadata import version
from pathlib import Path
from zipfile import ZipFile

import pytest

from gough_stewart import GoughStewartError
from gough_stewart.harness.report import offline
from gough_stewart.harness.report.offline import bokeh, document, three
from gough_stewart.model.process.installed import versions


def test_data_must_be_finite_and_names_need_not_be_utf_8() -> None:
    """Expected: scripts as a browser reads them; JSON has no NaN; what is no text in a folder's name is a mark."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        document("t", "", "", [float("nan")], [])
    assert b"<script>let a = 1;\nlet b = 2;\nlet c;</script>" in document(
        "t", "", "", [], ["let a = 1;\r\nlet b = 2;\rlet c;"]
    )
    assert b"<title>caf?</title>" in document("caf\udce9", "", "", [], [])


def test_a_wheel_that_has_its_script_elsewhere_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Expected: the package, its version, and one that would do; also if the page in the archive has another script."""
    for name in ("no_such_package_here", "this"):  # the second is a module without a folder
        with pytest.raises(GoughStewartError, match=f"the package '{name}' is missing; install gough-stewart with"):
            offline._folder(name)
    monkeypatch.setattr(offline, "_folder", lambda _package: tmp_path)
    with pytest.raises(GoughStewartError, match=rf"bokeh {version('bokeh')} has no bokeh\.min\.js or .* in server"):
        bokeh.__wrapped__()
    (tmp_path / "resources/templates").mkdir(parents=True)
    for _ in range(2):
        with pytest.raises(GoughStewartError, match=rf"trimesh {version('trimesh')} has no three\.js.*5\.2\.0"):
            three.__wrapped__()
        with ZipFile(tmp_path / "resources/templates/viewer.zip", "w") as archive:
            archive.writestr("viewer.html.template", "<script>\nlet x = 0;\n</script>")


def test_versions_are_those_of_the_installed_packages_and_the_machine() -> None:
    """Expected: by `importlib.metadata` and `platform`, Python first, the machine last."""
    names = ["gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib"]
    expected = {"python": platform.python_version(), **{name: version(name) for name in names}}
    assert list(versions().items()) == [*expected.items(), ("machine", f"{platform.system()} {platform.machine()}")]
