"""Draws docs/figures/workspace.svg, the picture of docs/workspace.md: `make figures`."""

from saving import save_svg

from gough_stewart.harness.workspace.figures import workspace_figures
from gough_stewart.model.platform_toml import load_preset
from gough_stewart.model.workspace_grid import sweep


def main() -> None:
    """Write the picture beside this file."""
    workspace = sweep(load_preset("motion_base"), {"x": None, "z": None}, points=81)
    save_svg("workspace.svg", workspace_figures(workspace)["workspace.svg"])


if __name__ == "__main__":
    main()
