"""Assembles chunks to the files of an ensemble, one at a time to save memory."""

import json
from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import polars

from gough_stewart.harness.ensemble.chunk_files import ChunkFiles
from gough_stewart.harness.ensemble.columns import CAUSE, IMPOSSIBLE, INTEGRATION_ERROR, MEMBER, OSCILLATION, OUTCOME
from gough_stewart.harness.ensemble.exact_versions import exact_versions
from gough_stewart.harness.ensemble.local import Range
from gough_stewart.harness.ensemble.result import Ensemble
from gough_stewart.harness.errors import RecordError
from gough_stewart.harness.experiment.plan import EnsemblePlan
from gough_stewart.harness.output.versions import versions
from gough_stewart.harness.polars_paths import read_parquet, scan_parquet, write_to
from gough_stewart.harness.report.small_machine import fineness_of
from gough_stewart.harness.results.bands import MOST_KEPT, bands_frame, joined_samples, samples_frame
from gough_stewart.model.process.files import write_whole

MEMBERS, BANDS, SAMPLES, METADATA = "members.parquet", "bands.parquet", "samples.parquet", "ensemble.json"
_ROWS_A_GROUP = 65_536
_MOST_CAUSES = 50


def assemble(
    plan: EnsemblePlan, files: ChunkFiles, ranges: Sequence[Range], features: Sequence[str], folder: Path
) -> Ensemble:
    """Write the tables and ensemble.json from the chunks; the last one marks completion."""
    rows = polars.concat([scan_parquet(files.rows(first)) for first, _ in ranges], how="diagonal")

    def write(path: Path | BytesIO) -> None:
        rows.sink_parquet(path, row_group_size=_ROWS_A_GROUP, maintain_order=True, statistics=False)

    write_whole(folder / MEMBERS, lambda path: write_to(path, write))
    joined = joined_samples(files.bands(first) for first, _ in ranges)
    bands = bands_frame(joined)
    write_whole(folder / BANDS, lambda path: write_to(path, partial(bands.write_parquet, statistics=False)))
    members = scan_parquet(folder / MEMBERS)
    ran = members.filter(polars.col(OUTCOME) != IMPOSSIBLE).select(MEMBER).head(MOST_KEPT).collect()[MEMBER].to_list()
    samples = samples_frame(joined, ran)
    write_whole(folder / SAMPLES, lambda path: write_to(path, partial(samples.write_parquet, statistics=False)))
    write_whole(folder / METADATA, json.dumps(_metadata(plan, members, features), indent=1).encode())
    return read_ensemble(folder)


def read_ensemble(folder: Path | str) -> Ensemble:
    """An ensemble from its folder.

    Returns
    -------
    Ensemble
        As `ensemble` returned it.

    Raises
    ------
    RecordError
        The folder has no ensemble.
    """
    folder = Path(folder)
    try:
        metadata: dict[str, Any] = json.loads((folder / METADATA).read_bytes())
        return Ensemble(
            read_parquet(folder / MEMBERS),
            read_parquet(folder / BANDS),
            metadata,
            # results of older versions have none
            read_parquet(folder / SAMPLES) if (folder / SAMPLES).is_file() else None,
        )
    except (OSError, ValueError, polars.exceptions.PolarsError) as error:
        raise RecordError(f"{folder} has no ensemble: {error}") from error


def _metadata(plan: EnsemblePlan, members: polars.LazyFrame, features: Sequence[str]) -> dict[str, Any]:
    """Metadata that depend only on the results: no times, and no names of workers."""
    prepared = plan.prepared
    counts = members.group_by(OUTCOME).len().sort(OUTCOME).collect()
    own = members.group_by(OSCILLATION).len().drop_nulls().sort(OSCILLATION).collect()
    causes = members.group_by(CAUSE).len().drop_nulls().sort(["len", CAUSE], descending=[True, False])
    largest = members.select(polars.col(INTEGRATION_ERROR).max()).collect().item()
    first = causes.head(_MOST_CAUSES).collect()
    return {
        "title": prepared.nominal.title,
        "experiment": prepared.nominal.model_dump(mode="json"),
        "settings": plan.settings,
        "fineness": fineness_of(prepared.platforms[1]),
        "members": plan.members,
        "seed": plan.seed,
        "sampling": prepared.choice.sampling,
        "combinations": prepared.combinations,
        "groups": [[name for k in group for name in prepared.inputs[k].columns] for group in prepared.groups],
        "outcomes": dict(zip(counts[OUTCOME], counts["len"], strict=True)),
        "oscillations": dict(zip(own[OSCILLATION], own["len"], strict=True)),
        "causes": dict(zip(first[CAUSE], first["len"], strict=True)),
        **prepared.stepping._asdict(),
        "integration_error": largest,
        # one text means the same bits from all workers; several mean agreement to 1e-9
        "features": list(features),
        "hash": plan.hash,
        "plan": plan.text,
        "made_with": exact_versions(),
        "versions": versions(),
    }
