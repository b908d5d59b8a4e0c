"""A table of an experiment file."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """A table of the file: unknown keys are errors, nothing changes once it is made."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
