"""What a folder without a record has instead: the results of another command, and how to look at them."""

from pathlib import Path

# The first of these files that is there tells the kind.
_KINDS: tuple[tuple[str, str, str], ...] = (
    ("compare.html", "two ensembles compared by `ensemble --compare`", "open compare.html in a browser"),
    ("plan.json", "an unfinished ensemble", "continue it with `gough-stewart ensemble … --resume`"),
    ("ensemble.json", "an ensemble", "open report.html in a browser, or view worst/member-…"),
    ("tuning.json", "a tuning", "run tuned.toml, then view that run"),
    ("workspace.csv", "a workspace", "open workspace.html in a browser"),
    ("estimate.json", "an identification", "open identify.html in a browser"),
    ("excitation.toml", "an excitation", "run excitation.toml, then view that run"),
    ("check.json", "a motion check", "look at shares.png"),
    ("margins.json", "margins", "look at bode.png"),
    ("frf.csv", "a frequency response", "look at frf.png"),
    ("open_loop.csv", "the paper's case", "open report.html, which `reproduce --report` writes, in a browser"),
    ("report.html", "a page", "open report.html in a browser"),
)
_ENDINGS = ((".fmu", "FMUs"), (".ssp", "an exported loop"), (".c", "an exported controller"), (".toml", "TOML files"))
_MOST = 5


def contents(folder: Path) -> str:
    """What a folder has, as far as it is known, and a remedy."""
    for name, what, remedy in _KINDS:
        if (folder / name).is_file():
            return f"it has {what}; {remedy}"
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    for ending, what in _ENDINGS:
        if any(name.endswith(ending) for name in names):
            return f"it has {what}: {_listed([name for name in names if name.endswith(ending)])}"
    inside = [path.parent.name for path in sorted(folder.glob("*/record.parquet"))]
    if inside:
        return f"it has folders of records: {_listed(inside)}; view one of them"
    return f"it has {_listed(names)}" if names else "it is empty"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
    return ", ".join(names[:_MOST]) + more
