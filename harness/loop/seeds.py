"""Streams of random numbers: one for each purpose, and of each member of many its own, whoever else is there."""

from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence

# Of one run; member k of an ensemble has `SeedSequence(seed, spawn_key=(k,))`.
Seed = int | SeedSequence
# Of one run or of all members alike, or of each.
Seeds = Seed | tuple[Seed, ...]


def stream(seed: Seed, purpose: int) -> Generator:
    """The numbers of one purpose; of a seed sequence those of its child of that number."""
    if isinstance(seed, SeedSequence):
        return np.random.default_rng(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, purpose)))
    return np.random.default_rng([seed, purpose])


def as_numbers(seed: Seeds) -> Any:
    """A seed in plain types: itself, or a sequence's entropy and the numbers of its children that lead there."""
    if isinstance(seed, tuple):
        return [as_numbers(each) for each in seed]
    return {"entropy": seed.entropy, "spawn_key": list(seed.spawn_key)} if isinstance(seed, SeedSequence) else seed
