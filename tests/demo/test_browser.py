"""A session of use of the demo in headless Chromium, from the command line to the file that is taken away."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gradio")
sync_api = pytest.importorskip("playwright.sync_api")
ROOT = Path(__file__).parents[2]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")]
#: Where the README's picture goes, if anywhere: TACTILE_APP_SCREENSHOT=examples/figures/app.png pytest tests/demo
SCREENSHOT = os.environ.get("TACTILE_APP_SCREENSHOT")
#: Seconds that the page may take to load and to answer (issue 9: 10 and 2 on two cores), with room for a busy machine.
LOADS_IN, ANSWERS_IN = 40, 15


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Address of a running `examples/demo/app.py`; when it ends, what it wrote must be gone."""
    folder = tmp_path_factory.mktemp("server")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, ROOT / "examples" / "demo" / "app.py", "--port", str(port)]
    log = folder / "log"
    with log.open("w") as file:
        environment = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": str(ROOT / "src")}
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, env=environment)
    try:
        begin = time.monotonic()
        while "ready at" not in log.read_text():
            assert process.poll() is None and time.monotonic() < begin + LOADS_IN, log.read_text()
            time.sleep(0.1)
        print(f"ready after {time.monotonic() - begin:.1f} s")
        yield f"http://127.0.0.1:{port}"
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)
    assert not list(folder.glob("tactile-app-*")), "temporary files were left behind"


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def visit(browser, server):
    """A function that opens the page as a new visitor; nothing may be asked of another host."""
    contexts, elsewhere = [], []

    def open_page():
        context = browser.new_context(viewport={"width": 1240, "height": 1290}, accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(1000 * ANSWERS_IN)
        page.on("request", lambda request: elsewhere.append(request.url) if not request.url.startswith(_OWN) else None)
        page.goto(server)
        page.wait_for_selector("#picture img", timeout=1000 * LOADS_IN)
        page.frame_locator("#strip iframe").locator("#readout").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not elsewhere


_OWN = ("http://127.0.0.1:", "data:", "blob:", "about:")


def _picture(page, place="#picture"):
    return page.get_attribute(f"{place} img", "src")


def _wait_for_another(page, before, place="#picture"):
    page.wait_for_function(
        "([image, before]) => (document.querySelector(image) || { src: before }).src !== before",
        arg=[f"{place} img", before],
    )
    return _picture(page, place)


def _download(page):
    """Takes the file away, by keyboard alone: for a moment after the strip's frame was exchanged, clicks may miss."""
    page.locator("#write").press("Enter")
    page.wait_for_selector("#files a")
    with page.expect_download() as download:
        page.locator("#files a").first.press("Enter")
    return download.value.path()


def test_slider_moves_picture_changes_file_is_valid(visit):
    page = visit()
    before = _picture(page)
    slider = page.locator("#roughness input[type=range]")
    value = float(slider.input_value())
    slider.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    assert float(slider.input_value()) == value - 2
    start = time.perf_counter()
    after = _wait_for_another(page, before)
    print(f"answered in {time.perf_counter() - start:.2f} s")
    page.locator("#roughness-open input").check()
    _wait_for_another(page, after)
    sync_api.expect(page.locator("#numbers tbody td").first).to_have_text("–")

    with np.load(_download(page)) as file:
        assert file["texture"].shape == (16000,) and np.isnan(file["ratings"][0])


def _status(page, words):
    """Waits until the lasting line says this, or, of "", nothing."""
    sync_api.expect(page.locator("#status")).to_have_text(re.compile(words) if words else "")


def _fill(page, control, value):
    page.locator(f"#{control} input[type=number]").fill(value)


def test_what_belongs_to_earlier_ratings_is_told_until_it_is_made(visit):
    page = visit()
    _status(page, "")
    page.get_by_text("How it is made").click()
    _fill(page, "takes", "3")
    _status(page, "have changed since")
    _fill(page, "duration", "10")
    _status(page, "Not made: All takes together may last 20 s.*is the earlier texture")
    before = _picture(page)
    page.click("#make")
    page.locator(".toast-body").wait_for()
    page.wait_for_timeout(1000)
    _status(page, "Not made")
    assert _picture(page) == before and page.locator("#status p").bounding_box()["y"] < page.viewport_size["height"]
    assert not page.locator("[data-testid=status-tracker] .error").locator("visible=true").count()
    _fill(page, "duration", "1")
    _status(page, "have changed since")
    page.click("#make")
    _wait_for_another(page, before)
    _status(page, "")
    page.locator("#scale").get_by_text("z-scores").click()
    page.wait_for_function("document.querySelector('#roughness input[type=range]').max < 3")
    page.wait_for_timeout(1000)
    _status(page, "")


def test_numbers_that_are_none_are_told_or_put_back(visit):
    page = visit()
    before = _picture(page)
    field = page.locator("#roughness input[type=number]")
    value = field.input_value()
    field.fill("")
    field.blur()
    assert field.input_value() == value
    assert page.locator("#preset input").input_value() == "denim" and _picture(page) == before
    field.fill("150")
    _status(page, "Not made: roughness must be between 0 and 100")
    field.blur()
    sync_api.expect(field).to_have_value("100")
    _status(page, "have changed since")
    sync_api.expect(page.locator("#preset input")).to_have_value("")  # it is denim no more


def test_finger_strip_follows_pointer_and_keys(visit):
    page = visit()
    frame = page.frame_locator("#strip iframe")
    frame.locator("#strip").focus()
    for _ in range(20):
        page.keyboard.press("Shift+ArrowRight")
    assert _speed(frame) > 0 or _place(frame) > 60
    button = frame.locator("#sound")
    assert button.get_attribute("aria-pressed") == "false" and button.inner_text() == "Sound: off"
    button.click()
    sync_api.expect(button).to_have_text("Sound: on")
    assert button.get_attribute("aria-pressed") == "true"  # from here on the same numbers are also estimated
    box = frame.locator("#strip").bounding_box()
    x, y = box["x"], box["y"] + box["height"] / 2
    page.mouse.move(x + 50, y)
    page.mouse.down()
    felt = []
    for step in range(40):
        page.mouse.move(x + 50 + 8 * step, y)
        page.wait_for_timeout(16)
        felt.append(float(re.search(r"texture ([\d.]+) mN", frame.locator("#readout").inner_text())[1]))
    if SCREENSHOT:
        page.evaluate("window.scrollTo(0, 0)")
        page.screenshot(path=SCREENSHOT)
    page.mouse.up()
    assert max(felt) > 0.5
    assert "mean friction -" in frame.locator("#readout").inner_text() or _speed(frame) == 0


def test_strip_gives_the_force_of_the_laws(visit):
    """A finger of steady speed feels the texture at its own level, and the mean friction of 0.5 N."""
    frame = visit().frames[-1]
    texture, mean, data = frame.evaluate("""() => {
        const finger = new Finger(DATA.deviceRate), texture = [];
        for (let n = 0; n < 16000; n++) {
            finger.target = (DATA.referenceSpeed * n) / DATA.deviceRate;
            finger.step();
            if (n > 3000) texture.push(finger.texture);
        }
        return [texture, finger.mean, DATA];
    }""")
    assert mean == pytest.approx(-0.5 * data["friction"])
    assert np.sqrt(np.mean(np.square(texture))) == pytest.approx(data["level"], rel=0.15)
    samples = frame.evaluate("[0, 1, 99].map((n) => [profileAt((n + profile.length) * DATA.pitch), profile[n]])")
    for found, stored in samples:
        assert found == pytest.approx(stored, abs=1e-6)


def _speed(frame):
    return float(re.search(r"speed (\d+)", frame.locator("#readout").inner_text())[1])


def _place(frame):
    return float(re.search(r"position ([\d.]+)", frame.locator("#readout").inner_text())[1])


def test_blend(visit):
    page = visit()
    page.get_by_role("button", name="Keep as A").click()
    page.get_by_role("tab", name="Two textures").click()
    page.get_by_text(re.compile(r"A \(kept\): roughness 0\.[89]")).wait_for()
    page.click("#make-blend")
    page.wait_for_selector("#blend-picture img")
    before = _picture(page, "#blend-picture")
    page.locator("#share input[type=range]").focus()
    page.keyboard.press("ArrowRight")
    _wait_for_another(page, before, "#blend-picture")
    told = page.locator("#blend-status")
    sync_api.expect(told).to_have_text("")
    page.get_by_role("tab", name="Texture", exact=True).click()
    _fill(page, "bumpiness", "20")
    page.get_by_role("button", name="Keep as B").click()
    page.get_by_role("tab", name="Two textures").click()
    sync_api.expect(told).to_have_text(re.compile("have changed since.*is the earlier"))
    before = _picture(page, "#blend-picture")
    page.click("#make-blend")
    _wait_for_another(page, before, "#blend-picture")
    sync_api.expect(told).to_have_text("")


def test_recording_is_reconstructed_and_uploads_are_bounded(visit, tmp_path, pink_noise):
    page = visit()
    page.get_by_role("tab", name="Your recording").click()
    good, other, large = tmp_path / "good.csv", tmp_path / "other.csv", tmp_path / "large.wav"
    np.savetxt(good, pink_noise(10_000, 10_000)[0])
    other.write_bytes(b"\x89PNG\r\n\x1a\n")
    large.write_bytes(b"RIFF" + bytes(9 * 2**20))
    chooser = page.locator("#upload input[type=file]")
    chooser.set_input_files(good)
    page.wait_for_selector("#upload .file-preview")
    page.click("#reconstruct")
    page.wait_for_selector("#recording-picture img")
    assert "Nine-band error" in page.inner_text("#recording-numbers")
    empty = tmp_path / "empty.csv"
    empty.touch()
    page.locator("#upload button[aria-label=Clear]").click()
    page.click("#reconstruct")
    page.locator("#recording-picture").get_by_text("Choose a file first").wait_for()
    assert not page.locator("#recording-picture img").count() and page.inner_text("#recording-numbers") == ""
    chooser.set_input_files(empty)
    page.wait_for_selector("#upload .file-preview")
    page.click("#reconstruct")
    page.locator("#recording-picture").get_by_text("The file is empty").wait_for()
    for path, message in ((other, "holds no number"), (large, "maximum allowed size|too large|exceeds")):
        page.reload()
        page.wait_for_selector("#picture img")
        page.get_by_role("tab", name="Your recording").click()
        chooser.set_input_files(path)
        if path == other:
            page.wait_for_selector("#upload .file-preview")
            page.click("#reconstruct")
        page.get_by_text(re.compile(message)).first.wait_for()


def test_every_control_is_reached_by_the_keyboard(visit):
    page = visit()
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("(document.activeElement.closest('[id]:not([id^=component])') || {}).id || ''"))
    assert {"preset", "roughness", "roughness-open", "make", "write", "format"} <= reached
