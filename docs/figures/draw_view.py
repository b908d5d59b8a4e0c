"""Captures docs/figures/view.png, a screenshot of a page of `gough-stewart view`: `make figures`; needs Chromium."""

import io
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from gough_stewart.harness.experiment.file import load_experiment
from gough_stewart.harness.experiment.run import run
from gough_stewart.harness.view.view import view_page

# Low gains and a large motion, so that the reference can be seen beside the platform.
SETTINGS = [
    "title=roll, pitch and yaw at 0.5 Hz",
    "description=PD in task space of 1.2 Hz only, with gravity feedforward",
    'reference.orientation_amplitude=["5 deg", "10 deg", "9 deg"]',
    "controller.bandwidth=1.2",
    "loop.duration=4",
]
MOMENT = 2.62  # [s]


def main() -> None:
    """Write the picture beside this file."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        raise SystemExit("no Chromium here, so docs/figures/view.png stays as it is; install the package chromium")
    record = run(load_experiment("pitch_sine", SETTINGS))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder, "report.html")
        page_file.write_bytes(view_page([record], ["pitch"]))
        arguments = ["--no-sandbox", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page(viewport={"width": 1240, "height": 700}, bypass_csp=True)
        page.goto(f"{page_file.as_uri()}#t={MOMENT}")
        page.wait_for_function("GoughStewart.ready.picture && GoughStewart.ready.curves")
        page.wait_for_timeout(500)
        picture = Image.open(io.BytesIO(page.screenshot()))
        browser.close()
    # a palette is enough, at a third of the size
    picture.convert("RGB").quantize(224, dither=Image.Dither.NONE).save(
        Path(__file__).with_name("view.png"), optimize=True
    )


if __name__ == "__main__":
    main()
