"""Draws docs/figures/workspace.svg, the picture of docs/workspace.md: `make figures`."""

from dataclasses import replace

from saving import save_svg

from gough_stewart.harness.report.document import Section
from gough_stewart.harness.report.figures import figures
from gough_stewart.harness.workspace.workspace_report import workspace_report
from gough_stewart.model.platform import load_preset
from gough_stewart.model.workspace import sweep


def main() -> None:
    """Write the picture beside this file: the first four of seven maps."""
    report = workspace_report(sweep(load_preset("motion_base"), {"x": None, "z": None}, points=61))
    four = replace(report, sections=(Section("Maps", tuple(report.charts[:4])),))
    save_svg("workspace.svg", figures(four, ("svg",))["maps.svg"])


if __name__ == "__main__":
    main()
