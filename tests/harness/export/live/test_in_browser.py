"""The page of a live loop in Chromium: it runs, offline, with the bits of native code, and does what a hand asks."""

import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

import gough_stewart as gs
from gough_stewart.harness.export.live.page import live_machine
from gough_stewart.harness.export.live.page import live_page
from gough_stewart.model.platform import save_platform
from tests.harness.export.test_machine import Machine
from tests.support.axe import violations
from tests.support.browser import Watched, until, watched

LOAD = """share => {
    const slider = document.getElementById("payload");
    slider.value = share * slider.max;
    slider.dispatchEvent(new Event("input"));
}"""
HIDE = """hidden => {
    Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
}"""
CONTROLS = "button, input, select, summary, a[href], [tabindex='0']"
NAME = "(each) => each.id || each.getAttribute('aria-label') || each.textContent.trim()"
NOISE = {"sensors.noise": {"leg_length": "3 um"}, "sensors.seed": 4}


# Twice as many rows as samples, and loads and a fault of its own. In it the platform's own file.
MINE = """title = "mine"
platform = { file = "own/machine.toml" }
reference = { type = "hold" }
controller = { type = "pd", bandwidth = 2, feedforward = "gravity" }
loop = { duration = 1, sample_time = "2 ms", plant_step = "1 ms" }
change = [{ at = 0.2, parameters = { platform_mass = 1500 } }]
disturbance = [{ at = 0.2, duration = 5, force = [300, 0, 0] }]
fault = [{ at = 0.3, duration = 0.05, cut = [2] }]
"""


def opened(browser: Browser, folder: Path, name: str | Path, settings: dict[str, object] | None = None) -> Watched:
    """The page of an experiment, once it moves; small, since all is drawn in software."""
    page = folder / f"{Path(name).stem}.html"
    page.write_bytes(live_page(gs.load_experiment(name, settings or {})))
    found = watched(browser, 900, 600)
    found.page.goto(page.as_uri())
    moves = "GoughStewart.page.live.isOpen ? GoughStewart.ready.picture : GoughStewart.live.last !== null"
    until(found.page, f"GoughStewart.live && ({moves})")
    return found


@pytest.fixture(scope="module")
def heave(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    """A loop with noise, quantisation and a delay; whatever a module's tests do to it must cause no error."""
    found = opened(browser, tmp_path_factory.mktemp("live"), "heave_step", NOISE)
    yield found
    assert found.errors == []
    found.page.close()


def pause(page: Page) -> None:
    """Pictures of a page that plays take the processor of the other tests."""
    if page.evaluate("GoughStewart.live.playing"):
        page.click("#play")


def put(page: Page, label: str, value: object) -> None:
    """A number in the field with this label."""
    field = f"[aria-label='{label}, as a number']"
    page.fill(field, str(value))
    page.press(field, "Tab")


def later(page: Page, seconds: float) -> list[float]:
    """The newest row after some time, by no clock; it pauses."""
    pause(page)
    step = page.evaluate("GoughStewart.page.live.plantStep")
    found = page.evaluate(
        "rows => GoughStewart.live.some(rows).then(() => GoughStewart.live.last)", round(seconds / step)
    )
    return list(map(float, found))


def drag(page: Page, pad: str, shares: Iterable[tuple[float, float]], seconds: float = 0.0) -> None:
    """Move the knob of a pad from its middle to some places, for some time at each."""
    page.locator(pad).scroll_into_view_if_needed()
    box = page.locator(pad).bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    for x, y in shares:
        page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"])
        if seconds:
            later(page, seconds)
    page.mouse.up()


def clock(page: Page) -> float:
    """Time of the newest row [s]."""
    return float(page.evaluate("GoughStewart.live.last[0]"))


def test_it_opens_offline_and_moves_by_itself(heave: Watched) -> None:
    """Expected: no request but for itself and its worker, and time that goes on by the clock."""
    page = heave.page
    assert [url for url in heave.requests if not url.startswith(("file:", "blob:"))] == []
    assert "worker-src blob:" in page.content()
    assert "'wasm-unsafe-eval'" in page.content()
    before = page.evaluate("[GoughStewart.live.last[0], performance.now()]")
    page.wait_for_timeout(500)
    after = page.evaluate("[GoughStewart.live.last[0], performance.now()]")
    assert 0.1 < after[0] - before[0] <= (after[1] - before[1]) / 1000 + 0.1
    page.click("#play")
    assert page.inner_text("#play") == "▶ play"
    page.wait_for_timeout(100)
    stopped = clock(page)
    page.wait_for_timeout(200)
    assert clock(page) == stopped
    page.keyboard.press("Escape")
    page.click("#play")


def test_its_rows_are_those_of_native_code(heave: Watched) -> None:
    """Expected: all signals and forces of 5 s, noise included, bit for bit."""
    block = live_machine(gs.load_experiment("heave_step", NOISE)).block
    native = Machine(block).run(5001)
    expected = np.concatenate([native["row_signals"], native["row_forces"]], axis=1)
    found = heave.page.evaluate(
        "GoughStewart.engine.ask('rows', 'allRows', { rows: 5001 }).then((answer) => [...answer.values])"
    )
    assert np.array_equal(np.reshape(found, (-1, 30)), expected)
    assert np.ptp(expected[4000:, 26]) > 0.1  # noise
    heave.page.click("#again")


def test_a_hand_moves_the_platform(heave: Watched) -> None:
    """Expected: by mouse, keys and numbers, the platform comes to where the reference is wanted, within 2 mm."""
    page = heave.page
    page.click("#again")
    drag(page, "#pad-1", [(0.5, 0.4), (0.5, 0.25)])
    assert page.inner_text("#follows") == "your hand"
    put(page, "y [mm]", "120")
    page.locator("#view canvas").focus()
    page.keyboard.press("d")
    reach, home = page.evaluate("[GoughStewart.page.live.reach, GoughStewart.page.live.home]")
    wanted = [reach[0] / 20, 0.12, reach[2] / 2]
    last = later(page, 6)
    page.click("#play")
    assert np.subtract(last[1:4], home[:3]) == pytest.approx(wanted, abs=0.01)
    assert np.subtract(last[19:22], home[:3]) == pytest.approx(wanted, abs=0.01)


def test_what_is_not_a_number_is_told_and_changes_nothing(heave: Watched) -> None:
    page = heave.page
    put(page, "x [mm]", "NaN")
    assert page.inner_text("#said").startswith("x is 'NaN'; expected a number from")
    page.wait_for_timeout(200)
    assert all(np.isfinite(page.evaluate("GoughStewart.live.last")))
    put(page, "x [mm]", "1e9")
    assert page.inner_text("#said") == ""


def test_gains_turn_and_margins_follow(heave: Watched) -> None:
    """Expected: `gs.margins` with these settings, to 1e-4, and what is not possible is told and undone."""
    page = heave.page
    for label, value in (("bandwidth", 3), ("delay", 2)):
        put(page, label, value)
    theirs = gs.margins("heave_step", {**NOISE, "controller.bandwidth": 3, "loop.delay": 2})
    until(page, f"GoughStewart.live.turning.margins?.[1] === {12 + 12 + 6}")
    legs = np.reshape(page.evaluate("GoughStewart.live.turning.margins")[4:34], (6, 5))
    assert legs[:, 2] == pytest.approx([leg.phase for leg in theirs.legs], rel=1e-4)
    assert legs[:, 3] == pytest.approx([leg.delay for leg in theirs.legs], rel=1e-4)
    assert page.inner_text("#modes").startswith("stable: slowest mode")
    put(page, "filter", "0.1")
    until(page, "document.getElementById('turn-said').textContent !== ''")
    assert "faster than half a sample" in page.inner_text("#turn-said")
    assert page.input_value("[aria-label='filter, as a number']") == "auto"
    page.click("#turn-back")
    until(page, f"GoughStewart.live.turning.margins?.[1] === {12 + 6 + 6}")


def test_whatever_is_turned_the_page_stays_alive(heave: Watched) -> None:
    """Expected: after 20 settings at random it runs, or says why it ended; begun again as in the file it runs."""
    page = heave.page
    page.evaluate(
        """seed => {
        const random = () => { seed = (seed * 16807) % 2147483647; return seed / 2147483647; };
        const sliders = [...document.querySelectorAll(".turned input[type=range], #axes input[type=range]")];
        for (let k = 0; k < 20; k++) {
            const slider = sliders[Math.floor(random() * sliders.length)];
            slider.value = Number(slider.min) + random() * (slider.max - slider.min);
            slider.dispatchEvent(new Event("input"));
        }
    }""",
        7,
    )
    page.wait_for_timeout(600)
    assert page.evaluate("GoughStewart.live.over !== null || GoughStewart.live.last.every(Number.isFinite)")
    page.click("#turn-back")
    page.click("#again")
    until(page, "GoughStewart.live.over === null && GoughStewart.live.last && GoughStewart.live.last[0] > 0.1")


def test_a_payload_is_felt(heave: Watched) -> None:
    """Expected: at rest the sum of the legs' forces grows with the payload, legs' own weight aside."""
    page = heave.page
    page.click("#again")
    empty = sum(later(page, 4)[13:19])
    page.evaluate(LOAD, 1)
    loaded = sum(later(page, 4)[13:19])
    mass = page.evaluate("[GoughStewart.page.live.platformMass, Number(document.getElementById('payload').value)]")
    assert 1.3 < loaded / empty < 1 + 1.2 * mass[1] / mass[0]
    page.evaluate(LOAD, 0)
    page.click("#again")


def test_what_a_hand_has_put_on_and_cut_stays_when_the_loop_begins_again(heave: Watched) -> None:
    """Expected: the cut leg has no force before and after; the others carry the payload; later both are gone."""
    page = heave.page
    page.evaluate("GoughStewart.live.restart(false)")
    alone = np.array(later(page, 0.05)[13:19])
    page.evaluate(LOAD, 0.5)
    page.click("[aria-label='no force in leg 3']")
    for _ in range(2):
        page.evaluate("GoughStewart.live.restart(false)")
        forces = np.array(later(page, 0.05)[13:19])
        assert forces[2] == 0
        assert np.delete(forces, 2).sum() > 1.2 * np.delete(alone, 2).sum()
    page.click("[aria-label='no force in leg 3']")
    page.evaluate(LOAD, 0)
    page.evaluate("GoughStewart.live.restart(false)")
    assert later(page, 0.05)[13:19] == pytest.approx(alone.tolist(), abs=1.0)
    page.click("#again")


def test_a_machine_that_sticks_bears_a_small_payload_and_slides_under_a_large_one(
    browser: Browser, tmp_path: Path
) -> None:
    """Expected: 24 kg are 62 N in each leg, less than its friction: it bends by F (1/sigma0 + 1/k) and stands.

    1.2 t slide.
    """
    machine = {"friction_model": "elasto_plastic", "coulomb_friction": 100, "stiffness": 1e8}
    settings: dict[str, object] = {f"plant.parameters.leg_{name}": value for name, value in machine.items()}
    quiet = {"loop.delay": 0, "sensors.quantisation": {}, "controller.feedforward": "gravity"}
    found = opened(browser, tmp_path, "heave_step", {**settings, **quiet, "reference.position_change": [0, 0, 0]})
    found.page.click("#again")
    home = later(found.page, 0.1)[3]
    found.page.evaluate(LOAD, 0.02)
    heights = [later(found.page, seconds)[3] for seconds in (0.5, 0.5)]
    mass = found.page.evaluate("Number(document.getElementById('payload').value)")
    platform = gs.load_preset("motion_base")
    slope = 2.0 / float(np.linalg.norm(gs.leg_geometry(platform, platform.home_position, np.zeros(3)).vector[0]))
    assert home - heights[0] == pytest.approx(mass * 9.81 / (6 * slope**2) * (1e-7 + 1e-8), rel=0.05)
    assert abs(heights[1] - heights[0]) < 1e-8
    found.page.evaluate(LOAD, 1)
    assert home - later(found.page, 0.5)[3] > 1e-4
    assert found.errors == []
    found.page.close()


def test_tab_comes_to_every_control(heave: Watched) -> None:
    """Expected: those that a reader sees, but for the pads, whose axes have sliders and keys."""
    page = heave.page
    found = f'[...document.querySelectorAll("{CONTROLS}")].filter((each) => each.checkVisibility())'
    seen = set(page.evaluate(f"{found}.map({NAME})"))
    assert len(seen) > 40
    page.evaluate("() => { document.activeElement.blur(); scrollTo(0, 0); }")
    reached = set()
    for _ in range(2 * len(seen)):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(f"({NAME})(document.activeElement)"))
    assert seen <= reached


def test_keys_do_what_a_mouse_does(heave: Watched) -> None:
    """Expected: play, begin again, move, load, break, push while a key is held, turn and take home."""
    page = heave.page
    page.evaluate("() => document.activeElement.blur()")
    was = page.evaluate("GoughStewart.live.playing")
    page.keyboard.press("Space")
    assert page.evaluate("GoughStewart.live.playing") != was
    later(page, 3)
    page.focus("#again")
    page.keyboard.press("Enter")
    pause(page)
    assert clock(page) < 3
    page.evaluate("() => document.activeElement.blur()")
    height = later(page, 0.5)[3]
    for _ in range(3):
        page.keyboard.press("r")
    assert later(page, 2)[3] > height + 0.005
    page.focus("#payload")
    page.keyboard.press("End")
    page.focus("[aria-label='no force in leg 3']")
    page.keyboard.press("Enter")
    assert later(page, 0.05)[15] == 0
    page.keyboard.press("Enter")
    assert later(page, 0.05)[15] != 0
    inputs = "GoughStewart.engine.ask('state', 'state').then((state) => state.inputs[6])"
    page.focus("#push-x")
    page.keyboard.down("Enter")
    assert page.evaluate(inputs) > 0
    page.keyboard.up("Enter")
    assert page.evaluate(inputs) == 0
    page.focus("#payload")
    page.keyboard.press("Home")
    field = "[aria-label='bandwidth, as a number']"
    page.focus(field)
    page.keyboard.press("Control+a")
    page.keyboard.type("2.5")
    page.keyboard.press("Tab")
    assert page.input_value(field) == "2.5"
    page.focus("#turn-back")
    page.keyboard.press("Enter")
    page.focus("#home")
    with page.expect_download() as download:
        page.keyboard.press("Enter")
    assert download.value.suggested_filename.endswith(".zip")
    page.click("#again")


def test_it_waits_while_its_tab_is_hidden(heave: Watched) -> None:
    """Expected: no time passes there, and none is made up for afterwards."""
    page = heave.page
    until(page, "GoughStewart.live.last !== null")
    page.evaluate(HIDE, True)
    try:
        page.wait_for_timeout(150)
        before, lost = clock(page), page.inner_text("#lost")
        page.wait_for_timeout(250)
        assert clock(page) == before
        begun = page.evaluate("performance.now()")
    finally:
        page.evaluate(HIDE, False)
    until(page, f"GoughStewart.live.last[0] > {before}")
    page.wait_for_timeout(200)
    after = clock(page)
    assert before < after <= before + (page.evaluate("performance.now()") - begun) / 1000
    assert lost or not page.inner_text("#lost") or float(page.inner_text("#lost").split()[0]) < 0.5


def test_it_has_no_faults_by_axe(heave: Watched) -> None:
    assert violations(heave.page) == []


def test_a_loop_that_diverges_says_so_and_begins_again(heave: Watched) -> None:
    """Expected: of legs too weak for the platform the cause, an offer, and a loop that runs again."""
    page = heave.page
    put(page, "force limit", 500)
    page.click("#again")
    page.select_option("#speed", "fast")
    until(page, "GoughStewart.live.over !== null")
    assert "at 100 % of its force for" in page.inner_text("#limits")
    said = page.inner_text("#over-text")
    assert said.startswith("At ")
    assert any(each in said for each in page.evaluate("Object.values(GoughStewart.page.live.failures)")), said
    assert page.inner_text("#play") == "▶ play"
    page.select_option("#speed", "1")
    page.click("#turn-back")
    page.click("#over-again")
    until(page, "GoughStewart.live.over === null && GoughStewart.live.last && GoughStewart.live.last[0] > 0.1")
    assert not page.is_visible("#over")
    pause(page)


def test_an_open_loop_has_its_forces_by_hand(browser: Browser, tmp_path: Path) -> None:
    """Expected: the published forces at first, then what a slider says."""
    found = opened(browser, tmp_path, "paper_open_loop")
    page = found.page
    assert page.inner_text("#play") == "▶ play"
    assert "They are ours, not the paper's" in page.inner_text("#behind")
    assert later(page, 0.1)[13:19] == [55, 49.5, 55, 49.5, 55, 49.5]
    put(page, "leg 2 [N]", "51")
    assert later(page, 0.1)[14] == 51
    assert found.errors == []
    page.close()


def test_what_a_hand_does_is_taken_home_and_run_again(browser: Browser, tmp_path: Path) -> None:
    """Expected: `run` of the files from the page, in another folder, repeats its rows to 1e-9 m, rad and s.

    Gains, a payload and faults by hand act beside the experiment's own, whose change and fault come later; calls begin
    inside of samples.
    """
    (tmp_path / "own").mkdir()
    save_platform(gs.load_preset("motion_base"), tmp_path / "own" / "machine.toml")
    (tmp_path / "mine.toml").write_text(MINE)
    found = opened(browser, tmp_path, tmp_path / "mine.toml")
    page = found.page
    later(page, 0.01)
    page.evaluate("GoughStewart.live.restart(false)")
    put(page, "bandwidth", 2.5)
    page.evaluate(LOAD, 0.2)
    drag(page, "#pad-0", [(0.6, 0.7), (0.7, 0.65), (0.3, 0.85)], 0.051)
    page.click("[aria-label='no force in leg 3']")
    assert later(page, 0.1)[15] == 0
    assert "leg 3 has no force" in page.inner_text("#limits")
    page.click("[aria-label='no force in leg 3']")
    page.click("[aria-label='the encoder stays, leg 5']")
    assert later(page, 0.061)[14] == 0
    assert "leg 2 has no force" in page.inner_text("#limits")
    assert later(page, 0.05)[14] != 0
    with page.expect_download() as download:
        page.click("#home")
    with zipfile.ZipFile(download.value.path()) as archive:
        assert archive.testzip() is None
        assert "machine.toml" in archive.namelist()
        archive.extractall(tmp_path / "elsewhere")
    theirs = gs.read_record(tmp_path / "elsewhere")
    again = gs.run(tmp_path / "elsewhere" / "experiment.toml")
    rows = slice(0, theirs.table.height)
    assert theirs.table.height > 360
    assert (theirs["actuator_force"][154:252, 2] == 0).all()
    assert np.ptp(again["measured.leg_length"][-20:, 4]) == 0
    for name in ("position", "orientation", "velocity", "reference.position", "reference.orientation"):
        assert np.abs(again[name][rows] - theirs[name]).max() < 1e-9, name
    assert np.ptp(theirs["position"], axis=0)[:2].min() > 0.001
    assert again.metadata.get("warnings", []) == []
    # a push adds to the experiment's own, which stays when it ends
    push = "document.getElementById('push-x').dispatchEvent(new PointerEvent('{}'))"
    inputs = "GoughStewart.engine.ask('state', 'state').then((state) => state.inputs[6])"
    page.evaluate(push.format("pointerdown"))
    assert page.evaluate(inputs) == pytest.approx(
        300 + 0.5 * 9.81 * page.evaluate("GoughStewart.page.live.platformMass")
    )
    page.evaluate(push.format("pointerup"))
    assert page.evaluate(inputs) == 300
    assert found.errors == []
    page.close()


def test_a_step_is_told_in_words(heave: Watched) -> None:
    """Expected: rise time and overshoot of `gs.metrics` for a run with this step, to the digits that are shown."""
    page = heave.page
    page.evaluate("GoughStewart.live.restart(false)")
    page.evaluate("document.getElementById('axis-2').dispatchEvent(new Event('input'))")  # z is the axis that steps
    page.click("#step")
    assert "along z" in page.inner_text("#said")
    later(page, 3.1)
    until(page, "document.getElementById('said').textContent.includes('rise time')")
    by = 0.1 * page.evaluate("GoughStewart.page.live.reach[2]")
    record = gs.run(
        "heave_step",
        {**NOISE, "reference.position_change": [0, 0, by], "reference.at": 0.1, "loop.duration": 3.2},
    )
    (theirs,) = gs.metrics(record)["step_response"]
    rise, overshoot = page.inner_text("#said").split("rise time ")[1].split(" ms")[0], theirs["overshoot_percent"]
    assert float(rise) == pytest.approx(1000 * theirs["rise_time"], abs=1.01)
    assert float(page.inner_text("#said").split("overshoot ")[1].split(" %")[0]) == pytest.approx(overshoot, rel=0.06)
    page.click("#again")


def test_a_link_holds_the_settings_and_reduced_motion_waits(heave: Watched, browser: Browser) -> None:
    """Expected: the page opened by its link has what was set, and stands until it is told; a broken link is told."""
    page = heave.page
    page.click("#again")
    pause(page)
    put(page, "bandwidth", 2.6)
    page.evaluate(LOAD, 0.5)
    put(page, "yaw [°]", 3)
    address = page.evaluate("GoughStewart.live.home.link()")
    payload = page.input_value("#payload")
    other = browser.new_page(viewport={"width": 900, "height": 600}, reduced_motion="reduce")
    other.goto(address)
    until(other, "GoughStewart.live && GoughStewart.ready.picture")
    other.wait_for_timeout(200)
    assert other.evaluate("GoughStewart.live.last") is None
    other.keyboard.press("Space")
    until(other, "GoughStewart.live.last !== null")
    assert other.input_value("[aria-label='bandwidth, as a number']") == "2.6"
    assert other.input_value("[aria-label='yaw [°], as a number']") == "3"
    assert other.input_value("#payload") == payload
    other.evaluate("history.replaceState(null, '', '#%7Bnot'); GoughStewart.live.home.restore()")
    assert "cannot be read" in other.inner_text("#home-said")
    other.close()
