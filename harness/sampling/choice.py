"""`[ensemble]`: the number of members, the sampling, the results to keep, and the varied inputs."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationError, model_validator

from gough_stewart.harness.quantities import Number
from gough_stewart.harness.sampling.design import CorrelatedInputs, Sampling
from gough_stewart.harness.sampling.variation import Variation
from gough_stewart.harness.section import TableSection, complaints
from gough_stewart.model.interface import TOLERANCES

MEMBERS = 1000
MOST_MEMBERS = 10_000_000
# Finer than that of single runs: a hundredth costs a few internal steps more in a few rows.
TOLERANCE = 1e-10


class EnsembleChoice(TableSection):
    """`[ensemble]`: keys other than these fields name what varies.

    A bare name is a parameter of the machine (`platform_mass`); other keys go by table: `controller.bandwidth`,
    `loop.delay`, `platform.platform_mass` (of the nominal model), `disturbance.1.force`.
    """

    model_config = ConfigDict(extra="allow")

    # None: 1000, or the number of combinations of the grids
    members: Annotated[int, Field(ge=1, le=MOST_MEMBERS)] | None = None
    # of draws, noise and jitter; the sensors' seed by default
    seed: Annotated[int, Field(ge=0)] | None = None
    sampling: Sampling = "random"
    # of the members' internal steps; `[plant]` tolerance is that of the other plants
    tolerance: Annotated[Number, Field(ge=TOLERANCES[0], le=TOLERANCES[1])] = TOLERANCE
    # the signals kept as bands over time
    signals: list[str] | None = None
    # whether to compute the margins of each member's loop
    margins: bool = False
    # how many of the worst members get a full record, and the metric that ranks them
    worst: Annotated[int, Field(ge=0, le=1000)] = 5
    worst_by: str | None = None
    correlation: list[CorrelatedInputs] = Field(default_factory=list)
    covariance: list[CorrelatedInputs] = Field(default_factory=list)
    _varied: dict[str, Variation]

    @model_validator(mode="after")
    def _parse(self) -> "EnsembleChoice":
        self._varied = dict(_variations("", self.model_extra or {}))
        return self

    @property
    def varied(self) -> Mapping[str, Variation]:
        """What varies, by key as written."""
        return self._varied


def _variations(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Variation]]:
    """The distributions in a table and its subtables, by dotted key."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        if isinstance(value, Variation):
            yield key, value
        elif not isinstance(value, Mapping):
            raise ValueError(  # noqa: TRY004 - pydantic wants this one
                f"{key}: is {value!r}; expected a setting of the ensemble ({', '.join(EnsembleChoice.model_fields)}), "
                "or the distribution of a varied value: {normal = [mean, deviation]}"
            )
        elif value.keys() & Variation.model_fields.keys():
            try:
                yield key, Variation.built().model_validate(value)
            except ValidationError as error:
                raise ValueError(f"{key}: {complaints(error, Variation, value)}") from None
        else:
            yield from _variations(f"{key}.", value)
