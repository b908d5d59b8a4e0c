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


def entropy_of(seed: Seed, purpose: int) -> list[int]:
    """The 32-bit words of entropy and spawn keys from which `stream` is seeded, as NumPy assembles them.

    The lowest word of a number first; entropy is filled up to four words if there are keys.
    """
    if not isinstance(seed, SeedSequence):
        return [*_parts(seed), *_parts(purpose)]
    entropy: Any = seed.entropy
    own = [part for each in np.ravel(np.asarray(entropy, dtype=object)).tolist() for part in _parts(each)]
    keys = [part for key in (*seed.spawn_key, purpose) for part in _parts(key)]
    return [*own, *[0] * (_POOL - len(own)), *keys]


# Words of a SeedSequence's pool.
_POOL = 4


def _parts(number: int) -> list[int]:
    """A number >= 0 in 32-bit words."""
    found = [int(number) % (1 << 32)]
    while number := int(number) >> 32:
        found.append(number % (1 << 32))
    return found


def as_numbers(seed: Seeds) -> Any:
    """A seed as plain types: itself, or a sequence's entropy and its spawn key."""
    if isinstance(seed, tuple):
        return [as_numbers(each) for each in seed]
    return {"entropy": seed.entropy, "spawn_key": list(seed.spawn_key)} if isinstance(seed, SeedSequence) else seed
