"""The files of chunks, written atomically, with checksums that show whether they are complete."""

import json
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from gough_stewart.harness.ensemble.chunk import Chunk
from gough_stewart.harness.results.bands import BandSamples
from gough_stewart.model.process.files import write_whole

FOLDER = "chunks"


@dataclass(frozen=True)
class ChunkBytes:
    """A chunk as bytes, on its way from a worker to its files."""

    rows: bytes  # Parquet
    bands: bytes
    features: str

    @classmethod
    def of(cls, chunk: Chunk) -> "ChunkBytes":
        """The same chunk always gives the same bytes."""
        rows, bands = BytesIO(), BytesIO()
        chunk.rows.write_parquet(rows, statistics=False)
        part = chunk.bands
        arrays: dict[str, Any] = {name: getattr(part, name) for name in part._fields}
        arrays["columns"] = np.array(part.columns, dtype=str)
        np.savez(bands, **arrays)
        return cls(rows.getvalue(), bands.getvalue(), chunk.features)


class ChunkFiles:
    """Chunks in a folder; a chunk that starts at member k has k.parquet, k.npz, and, written last, k.json."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / FOLDER

    def write(self, first: int, chunk: ChunkBytes) -> None:
        """Write a chunk completely or not at all.

        Raises
        ------
        OSError
            It cannot be written; partial files are ignored.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        write_whole(self.rows(first), chunk.rows)
        write_whole(self._bands(first), chunk.bands)
        says = {"features": chunk.features, "rows": _digest(chunk.rows), "bands": _digest(chunk.bands)}
        write_whole(self._says(first), json.dumps(says, indent=1).encode())

    def features(self, first: int) -> str | None:
        """The processor features of the chunk's machine code; None if the chunk is missing or incomplete."""
        try:
            says = json.loads(self._says(first).read_bytes())
            whole = all(
                _digest(path.read_bytes()) == says[name]
                for name, path in (("rows", self.rows(first)), ("bands", self._bands(first)))
            )
            return str(says["features"]) if whole else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def rows(self, first: int) -> Path:
        """The table of its members."""
        return self.folder / f"{first:08d}.parquet"

    def bands(self, first: int) -> BandSamples:
        """Its samples over time."""
        with np.load(self._bands(first)) as arrays:
            found: dict[str, Any] = {name: arrays[name] for name in BandSamples._fields}
        return BandSamples(**{**found, "columns": tuple(found["columns"].tolist())})

    def count(self) -> int:
        """The number of chunks."""
        return len(list(self.folder.glob("*.json")))

    def remove(self) -> None:
        """Remove all chunks."""
        for path in sorted(self.folder.glob("*")):
            path.unlink()
        if self.folder.is_dir():
            self.folder.rmdir()

    def _bands(self, first: int) -> Path:
        return self.folder / f"{first:08d}.npz"

    def _says(self, first: int) -> Path:
        return self.folder / f"{first:08d}.json"


def _digest(content: bytes) -> str:
    """A checksum against torn files and failing disks, at a tenth of the time of SHA-256."""
    return f"{crc32(content):08x}"
