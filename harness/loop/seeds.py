"""Streams of random numbers: one per purpose and member, independent of the other members."""

from typing import Any

import numpy as np
from numpy.random import Generator, SeedSequence

# Seed of one run; member k of an ensemble has `SeedSequence(seed, spawn_key=(k,))`.
Seed = int | SeedSequence
# Seed of one run or common to all members, or one per member.
Seeds = Seed | tuple[Seed, ...]


def stream(seed: Seed, purpose: int) -> Generator:
    """The random numbers for one purpose; for a seed sequence, those of its child with that number."""
    if isinstance(seed, SeedSequence):
        return np.random.default_rng(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, purpose)))
    return np.random.default_rng([seed, purpose])


def as_numbers(seed: Seeds) -> Any:
    """A seed as plain types: itself, or a sequence's entropy and its spawn key."""
    if isinstance(seed, tuple):
        return [as_numbers(each) for each in seed]
    return {"entropy": seed.entropy, "spawn_key": list(seed.spawn_key)} if isinstance(seed, SeedSequence) else seed
