"""Two platforms with a controller each in one SSP, in FMPy: two exported loops become one system."""

import zipfile
from pathlib import Path

import numpy as np
from fmpy.ssp.simulation import simulate_ssp
from lxml import etree

import gough_stewart as gs

STEP, DURATION = 1e-3, 0.3
# sensors stay outside an SSP
SHARED = {"loop.duration": DURATION, "sensors.quantisation": {}}
LOOPS = {
    "left": {**SHARED, "reference.at": 0.05},
    "right": {**SHARED, "reference.at": 0.1, "platform.parameters.platform_mass": 1100.0},
}
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"
STRUCTURE = "SystemStructure.ssd"


def joined(archives: dict[str, Path], path: Path) -> None:
    """One archive with the components of several, `plant` and `controller`, as `left_plant` and so on."""
    files: dict[str, bytes] = {}
    whole = None
    for side, archive in archives.items():
        with zipfile.ZipFile(archive) as opened:
            structure = etree.fromstring(opened.read(STRUCTURE))
            for component in structure.iter(f"{SSD}Component"):
                source = component.get("source")
                files[f"resources/{side}_{component.get('name')}.fmu"] = opened.read(source)
                component.set("name", f"{side}_{component.get('name')}")
                component.set("source", f"resources/{component.get('name')}.fmu")
        for connection in structure.iter(f"{SSD}Connection"):
            for end in ("startElement", "endElement"):
                connection.set(end, f"{side}_{connection.get(end)}")
        if whole is None:
            whole = structure
            continue
        for part in ("Elements", "Connections"):
            whole.find(f"{SSD}System/{SSD}{part}").extend(structure.find(f"{SSD}System/{SSD}{part}"))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as written:
        written.writestr(STRUCTURE, etree.tostring(whole, xml_declaration=True, encoding="UTF-8"))
        for name, content in files.items():
            written.writestr(name, content)


archives = {
    side: gs.export("heave_step", settings, forms="ssp", out=f"exported/{side}")[0] for side, settings in LOOPS.items()
}
joined(archives, Path("two_platforms.ssp"))
found = simulate_ssp("two_platforms.ssp", stop_time=DURATION - STEP / 2, step_size=STEP)
for side, settings in LOOPS.items():
    lengths = np.transpose([found[f"{side}_plant.leg_length[{leg}]"] for leg in range(1, 7)])
    alone = gs.run("heave_step", settings)["leg_length"][1:]
    print(
        f"{side}: leg 1 moves by {1000 * np.ptp(lengths[:, 0]):.1f} mm, and differs from its loop alone by at most "
        f"{np.abs(lengths - alone).max():.0e} m"
    )
