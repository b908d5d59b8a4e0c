"""Names and texts of the TOML files that ship with the package."""

from importlib import resources


def names(package: str, folder: str) -> tuple[str, ...]:
    """Names of the TOML files in a folder of a package, without .toml."""
    files = resources.files(package).joinpath(folder).iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def text(package: str, folder: str, name: str) -> str:
    """The text of such a file, with its comments."""
    return resources.files(package).joinpath(folder, f"{name}.toml").read_text(encoding="utf-8")
