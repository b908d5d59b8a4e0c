"""The functions behind commands, replaced by notes of what they were called with."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from rich.progress import Progress
from typer.testing import Result

from gough_stewart.harness.cli import terminal
from gough_stewart.harness.report.document import Report, Section, Verdict
from gough_stewart.harness.report.table import Column, Table


class Notes:
    """What replaced functions were called with, and what commands showed while they ran."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch = monkeypatch
        self.calls: dict[str, list[tuple[tuple[Any, ...], dict[str, Any]]]] = {}
        self.bars: list[dict[str, Any]] = []
        self.places: dict[tuple[int, int], int] = {}
        notes = self

        class Told(Progress):
            def add_task(self, description: str, *args: Any, **options: Any) -> Any:
                assert isinstance(description, str)
                task = super().add_task(description, *args, **options)
                notes.places[id(self), task] = len(notes.bars)
                notes.bars.append({"description": description, **options, "done": 0})
                return task

            def update(self, task_id: Any, **options: Any) -> None:
                bar = notes.bars[notes.places[id(self), task_id]]
                bar |= {name: value for name, value in options.items() if name != "advance"}
                bar["done"] += options.get("advance", 0)
                super().update(task_id, **options)

        monkeypatch.setattr(terminal, "Progress", Told)

    def replace(self, place: str, result: Any = None, act: Callable[..., Any] | None = None) -> None:
        """Let the function at this place note its call, act, and give this result."""

        def noted(*args: Any, **options: Any) -> Any:
            given = {name: value for name, value in options.items() if not callable(value)}
            self.calls.setdefault(place.rpartition(".")[2], []).append((args, given))
            done = None if act is None else act(*args, **options)
            return done if result is None else result

        self._patch.setattr(f"gough_stewart.{place}", noted)

    def set(self, place: str, value: Any) -> None:
        self._patch.setattr(place, value)

    def opened(self) -> list[str]:
        """Addresses that are opened in the browser from now on."""
        addresses: list[str] = []

        def opens(address: str) -> bool:
            addresses.append(address)
            return True

        self.set("webbrowser.open", opens)
        return addresses

    def one(self, name: str) -> tuple[tuple[Any, ...], dict[str, Any]]:
        (call,) = self.calls.pop(name)
        return call


def made_report(title: str) -> Report:
    """A report whose verdict and only table have this title."""
    table = Table(title, (Column(""), Column("value")), (("row", title + "!"),))
    return Report("", Verdict(f"{title} found", "told"), (Section("all", (table,)),))


def said(done: Result, *lines: str) -> None:
    """The command is done, and its output has these lines, apart from tables, whatever the sizes of files."""
    assert done.exit_code == 0, done.output
    plain = [line for line in done.stdout.splitlines() if line[:1] not in "┏┃┡│└├ "]
    shown = [re.sub(r"\d+\.\d s", "T s", line) for line in plain]
    sizes = re.compile(r"\([\d.]+ [kM]B\)")
    assert [sizes.sub("(S)", line) for line in shown] == [sizes.sub("(S)", line) for line in lines]
