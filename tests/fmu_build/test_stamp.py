"""Start values that are written into a compiled library."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from gough_stewart.fmu_build.binaries import stamped, with_page_digests
from gough_stewart.fmu_build.build import libraries_of, unit_of
from gough_stewart.fmu_build.component import Role, UnitComponent
from gough_stewart.fmu_build.errors import BuildError
from gough_stewart.fmu_build.plant.component import plant_component
from gough_stewart.fmu_build.plant.layout import PLANT
from gough_stewart.fmu_build.sources import library_sources, start_block, start_source
from gough_stewart.fmu_build.targets import BY_NAME, native
from gough_stewart.fmu_build.toolchain import compile_library
from gough_stewart.model.platform_toml import load_preset

TOKENS = ("{1b2c}", "")


def drawn(seed: int) -> UnitComponent:
    """The plant's code with every start value drawn at random, among them numbers that are short and long in text."""
    rng, plant = np.random.default_rng(seed), plant_component(load_preset("motion_base"))
    starts = {
        name: rng.normal(size=np.shape(value)) * 10.0 ** rng.integers(-9, 9) for name, value in plant.starts.items()
    }
    return replace(
        plant, starts=starts, experiment={"tolerance": repr(rng.uniform())}, options={"ZEROS_ARE_UNSET_AT_START": 1}
    )


@pytest.mark.parametrize("seed", [1, 2, *(pytest.param(k, marks=pytest.mark.evidence) for k in range(3, 51))])
def test_a_stamped_library_has_the_bytes_of_one_that_was_compiled_with_the_values(seed: int) -> None:
    """Expected: the compiler's bytes, from the values as text."""
    component, own = drawn(seed), library_sources(drawn(seed))
    blank = compile_library(component.identifier, own.units, own.headers, native())
    with_values = own.units | {"start.c": start_source(component, TOKENS)}
    expected = compile_library(component.identifier, with_values, own.headers, native())
    assert stamped(blank, start_block(component, None), start_block(component, TOKENS)) == expected


def test_units_of_other_values_share_their_library_but_for_the_values() -> None:
    """Expected: by hand, the two libraries differ within the length of the block only."""
    platforms = [plant_component(load_preset(name)) for name in ("liu2000", "motion_base")]
    found = [libraries_of(each, unit_of(each, "3.0"), [native()], lambda _text: None)[native()] for each in platforms]
    at = [k for k, (one, other) in enumerate(zip(*found, strict=True)) if one != other]
    n_values = sum(each.variable.size for each in PLANT.of_role(Role.INPUT, Role.STATE)) + 110
    assert 0 < at[-1] - at[0] < 104 + 8 * n_values


def test_a_library_without_one_blank_block_is_refused() -> None:
    blank, block = b"mark" + bytes(8), b"mark" + struct.pack("<d", 1.5)
    assert stamped(b"xy" + blank + b"z", blank, block) == b"xy" + block + b"z"
    for library, given in ((b"xyz", block), (blank + b"-" + blank, block), (blank, block + b"-")):
        with pytest.raises(BuildError, match="delete the cache"):
            stamped(library, blank, given)


def _signed(value: float) -> bytes:
    """A library for Apple's arm64 with a table of several pages."""
    numbers = ", ".join([repr(value)] * 4096)
    source = f"""
#include <math.h>
const double TABLE[] = {{{numbers}}};
__attribute__((visibility("default"))) double cosine(int k)
{{
    return cos(TABLE[k]);
}}
"""
    return compile_library("table", {"table.c": source}, {}, BY_NAME["aarch64-darwin"])


def test_a_signature_has_the_digests_of_the_pages_as_they_are() -> None:
    """Expected: the linker's signature of a library with the values compiled in, but for its UUID, drawn from them."""
    blank, expected = _signed(0.5), _signed(2.25)
    assert with_page_digests(blank) == blank
    found = stamped(blank, *(struct.pack("<d", value) * 4096 for value in (0.5, 2.25)))
    differing = [k for k, (one, other) in enumerate(zip(found, expected, strict=True)) if one != other]
    uuid = slice(differing[0], differing[0] + 16)
    assert with_page_digests(found[: uuid.start] + expected[uuid] + found[uuid.stop :]) == expected
    # a byte that is changed in no matter which page changes the digest of this page alone
    for at in range(0, blank.index(struct.pack("<d", 0.5) * 4096), 4096):
        changed = bytes([*blank[: at + 2000], blank[at + 2000] ^ 1, *blank[at + 2001 :]])
        anew = with_page_digests(changed)
        assert sum(one != other for one, other in zip(anew[-32 * 64 :], changed[-32 * 64 :], strict=True)) > 20


def test_other_libraries_have_no_signature() -> None:
    for library in (b"", b"\x7fELF" + bytes(60), b"MZ" + bytes(60)):
        assert with_page_digests(library) == library
