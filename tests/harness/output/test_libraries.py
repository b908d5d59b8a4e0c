"""Versions and licences of the libraries that results and pages contain."""

import platform
from importlib.metadata import PackageNotFoundError, distribution, version

import pytest

from gough_stewart.harness.report import versions as module
from gough_stewart.harness.report.offline import three, three_licence
from gough_stewart.harness.report.versions import versions


def test_versions_are_those_of_the_installed_packages_and_the_machine() -> None:
    """Expected: by `importlib.metadata` and `platform`, Python first, the machine last; nobody's copy is shared."""
    names = ["gough-stewart", "numpy", "scipy", "casadi", "control", "fmpy", "ziglang", "polars", "matplotlib"]
    found = versions()
    assert list(found) == ["python", *names, "machine"]
    assert found["python"] == platform.python_version()
    assert found["machine"] == f"{platform.system()} {platform.machine()}"
    assert {name: found[name] for name in names} == {name: version(name) for name in names}
    found["numpy"] = "another"
    assert versions()["numpy"] == version("numpy")


def test_what_is_not_installed_has_no_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def without_compiler(name: str) -> str:
        if name == "ziglang":
            raise PackageNotFoundError(name)
        return version(name)

    monkeypatch.setattr(module, "version", without_compiler)
    found = module._versions.__wrapped__()
    assert found.keys() == versions().keys() - {"ziglang"}


def test_three_js_is_whole_and_its_licence_names_its_holders() -> None:
    """Expected: the library alone, from its notice to its last line, and the licence of the wheel it comes from."""
    script = three()
    assert script.startswith("/**")
    assert "@license" in script[:60]
    assert "<" + "/script>" not in script
    assert len(script) > 400_000
    assert "trimesh" not in script
    holders, licence = three_licence().split("\n\n", 1)
    assert not set("*/") & set(holders.replace("https://", "").replace("SPDX-License-Identifier: MIT", ""))
    assert "Three.js Authors" in holders
    files = distribution("trimesh").files or []
    (whole,) = {file.read_text() for file in files if file.name.startswith("LICENSE")}
    assert licence == whole[whole.index("Permission is hereby granted") :]
