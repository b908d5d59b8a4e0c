"""The C of machines: c/machine with generated headers, for this computer and as WebAssembly."""

from functools import cache

from gough_stewart.fmu_build.cache import COMPILER, check_installed
from gough_stewart.fmu_build.component import Sources
from gough_stewart.fmu_build.libraries import loop_sources, machine_library
from gough_stewart.fmu_build.sources import GENERATED, c_folder, defines
from gough_stewart.fmu_build.toolchain import WEB_ASSEMBLY
from gough_stewart.harness.export.machine import HEAD, N_MOTION, ROOM, all_fields, fields, version
from gough_stewart.harness.loop.libraries import components_header
from gough_stewart.harness.motion.motion import ROUNDING
from gough_stewart.model.interface import IDEAL, Variant
from gough_stewart.model.process.installed import TRACER, prebuilt, state_of_texts

# In the manifest of prebuilt files.
MACHINE = "machine.wasm"
# Packages from which the C is made.
_TRACED = ("fmu_build", "model", *(f"harness.{name}" for name in ("control", "export", "loop", "motion", "plants")))


def shipped_wasm(variant: Variant = IDEAL) -> bytes:
    """The C as WebAssembly: what came with the package, that of ideal plants, else from the cache, else compiled."""
    carried = None if variant.parts else prebuilt(MACHINE, machine_texts())
    if carried is not None:
        return carried.content
    check_installed(TRACER, COMPILER)
    return machine_library(machine_c(variant), WEB_ASSEMBLY).kept(WEB_ASSEMBLY).read_bytes()


def machine_texts() -> str:
    """The state of all sources that the C depends on, for `prebuilt`."""
    return state_of_texts(*_TRACED)


@cache
def machine_c(variant: Variant = IDEAL) -> Sources:
    """Units and headers of c/machine for plants of a variant; `machine_fields.h` says how C reads the fields."""
    from gough_stewart.harness.export.machine_equations import design_header, plan_header  # imports CasADi

    sizes = {
        "MACHINE_HEAD": HEAD,
        "MACHINE_ROOM": ROOM,
        "MACHINE_FIELDS": HEAD + ROOM,
        "MACHINE_N_FIELDS": len(all_fields()),
        "MACHINE_VERSION": version(variant),
        "N_MOTION": N_MOTION,
        "MOTION_ROUNDING": ROUNDING,
    }
    numbers = {f"MACHINE_{name.upper().replace('.', '_')}": k for name, k in fields().items()}
    reads = " \\\n    ".join(f"m->{field.member} = {field.kind}({k});" for k, field in enumerate(all_fields()))
    texts = {
        "machine_fields.h": f"{defines(sizes)}\n\n{defines(numbers)}\n\n#define MACHINE_READ \\\n    {reads}\n",
        "plan.h": plan_header(),
        "design.h": design_header(),
    }
    headers = {name: f"{GENERATED}\n{text}" for name, text in texts.items()}
    return loop_sources(components_header(), variant, alone=True) | c_folder("machine") | Sources({}, headers)
