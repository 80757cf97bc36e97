"""The workbench in real Chromium, as people use it: a server of its own, a window, the mouse and the keyboard."""

import http.client
import os
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from browser import BROWSER, needs_browser

from rodgen.calibration.simulate import simulate
from rodgen.data.measurements import Measurements
from rodgen.machines.machine import Machine
from rodgen.workbench.session import Session

playwright = pytest.importorskip("playwright.sync_api")
pytest.importorskip("nicegui")
pytestmark = [pytest.mark.slow, needs_browser, pytest.mark.xdist_group("workbench")]

MOUNT = Path(__file__).parents[1] / "examples/machines/mount"
PATIENCE = 60_000
"""Milliseconds: the computer may have much else to do."""

NO_OVERLAP = """() => {
  const found = [];
  for (const plot of document.querySelectorAll('.js-plotly-plot')) {
    const texts = [...plot.querySelectorAll('.main-svg text')].filter((t) => t.textContent.trim());
    const boxes = texts.map((t) => t.getBoundingClientRect());
    for (let i = 0; i < boxes.length; i++)
      for (let k = 0; k < i; k++) {
        const a = boxes[i], b = boxes[k], by = 1.5;
        if (a.left < b.right - by && b.left < a.right - by && a.top < b.bottom - by && b.top < a.bottom - by)
          found.push(texts[i].textContent + ' | ' + texts[k].textContent);
      }
  }
  return found;
}"""


class Server:
    """``rodgen open`` in a process of its own."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "rodgen", "open", *map(str, arguments), "--no-browser"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{32}/", self.address), self.address

    def end(self, how=signal.SIGTERM):
        self.process.send_signal(how)
        self.process.wait(timeout=60)
        self.process.stdout.close()


@pytest.fixture
def serve():
    servers = []

    def begin(*arguments):
        servers.append(Server(*arguments))
        return servers[-1]

    yield begin
    for server in servers:
        if server.process.poll() is None:
            server.end()


@pytest.fixture(scope="module")
def chromium():
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def opened(chromium):
    """Open an address in a window; at the end nothing may have been asked of any other, and nothing complained."""
    windows, complaints = [], []

    def window(address, width=1280, height=900, scheme="light"):
        page = chromium.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        page.set_default_timeout(PATIENCE)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda m: complaints.append(m.text) if m.type == "error" else None)
        page.on(
            "request",
            lambda r: None if r.url.startswith((address, "data:", "blob:")) else complaints.append(r.url),
        )
        page.goto(address)
        page.get_by_role("heading").first.wait_for()
        windows.append(page)
        return page

    yield window
    for page in windows:
        page.close()
    assert complaints == []


@pytest.fixture
def files(tmp_path):
    for name in ("machine.toml", "mmt_2021.csv"):
        shutil.copy(MOUNT / name, tmp_path)
    return tmp_path / "machine.toml", tmp_path / "mmt_2021.csv"


def picture(page, name):
    """Keep a picture of a page where RODGEN_PICTURES names a folder: for those who look, and for docs/start/page.md."""
    if folder := os.environ.get("RODGEN_PICTURES"):
        page.screenshot(path=f"{folder}/workbench_{name}.png")


def test_the_telescope_from_the_first_look_to_the_saved_session(files, serve, opened):
    server = serve(*files)
    page = opened(server.address)
    page.get_by_text("Error 2.71 arcsec").wait_for()
    flexure = page.get_by_label("Add tube_flexure")
    marks = page.locator(".js-plotly-plot").first.locator(".point")
    flexure.wait_for()
    before = marks.count()
    flexure.hover()
    page.wait_for_function(
        "n => document.querySelectorAll('.js-plotly-plot')[0].querySelectorAll('.point').length > n",
        arg=before,
    )
    picture(page, "hover")
    flexure.click()
    page.get_by_text("Error 0.969").wait_for()
    page.get_by_label("Add refraction").click()
    page.get_by_text("Error 0.659").wait_for()
    page.get_by_text("refraction (TX) shows in these data").wait_for()
    page.keyboard.press("Control+z")
    page.get_by_text("Error 0.969").wait_for()
    page.keyboard.press("Control+y")
    page.get_by_text("Error 0.659").wait_for()
    # brush away and back
    page.mouse.move(1000, 5)
    plot = page.locator(".js-plotly-plot").first.bounding_box()
    page.mouse.move(plot["x"] + 100, plot["y"] + 30)
    page.mouse.down()
    page.mouse.move(plot["x"] + 230, plot["y"] + 160, steps=5)
    page.mouse.up()
    page.get_by_text(re.compile(r"\d+ rows selected")).wait_for()
    picture(page, "brushed")
    page.get_by_label("Exclude").click()
    page.get_by_text(re.compile(r"\d+ rows excluded")).first.wait_for()
    page.get_by_label("Include again").click()
    page.get_by_text(re.compile("all rows included again")).first.wait_for()
    page.get_by_text("Error 0.659").wait_for()
    # a formula with an error, and its cure
    page.get_by_text("Formula of your own").first.click()
    page.get_by_label("At", exact=True).click()
    page.get_by_role("option", name="joint EL").click()
    page.get_by_label("Parameters and units").fill("k: arcsec")
    page.get_by_label("Formula", exact=True).fill("k*cos(2*q")
    page.get_by_text("never closed").wait_for()
    page.get_by_label("Formula", exact=True).fill("k*cos(2*q)")
    page.get_by_label("Add the formula").click()
    page.get_by_text("+ own at EL").first.wait_for()
    # keep, kill, open again
    page.get_by_label("Keep").click()
    page.get_by_label("Session", exact=True).fill("mount.rodgen")
    page.get_by_label("Write: Session").click()
    page.get_by_text("mount.rodgen is written").wait_for()
    page.keyboard.press("Escape")
    page.get_by_label("Undo").click()
    page.get_by_text("Error 0.659").wait_for()
    server.end(signal.SIGKILL)
    page.close()
    kept = files[0].with_name("mount.rodgen")
    session = Session.load(kept)
    assert [s.action.kind for s in session.states[1:]] == ["add", "add", "set aside", "bring back", "add"]
    assert session.at == 4
    again = opened(serve(kept).address)
    again.get_by_text("Error 0.659").wait_for()
    again.get_by_label("Redo").click()
    again.get_by_text("+ own at EL").first.wait_for()


def test_what_a_diagnosis_finds_is_taken_at_once_and_left_for_the_start(files, serve, opened):
    page = opened(serve(*files).address)
    page.get_by_label("Add tube_flexure").wait_for()
    page.get_by_role("button", name="Diagnose").click()
    page.get_by_text("These are missing: tube_flexure").first.wait_for(timeout=4 * PATIENCE)
    picture(page, "verdict")
    page.get_by_role("button", name="Take all").click()
    page.get_by_text("All that the diagnosis found is in the model.").wait_for()
    page.get_by_text("Error 0.659").wait_for()
    page.get_by_label("Back to the start").click()
    page.get_by_role("button", name="Back to Alt-azimuth mount").click()
    page.get_by_text("Error 0.659").wait_for()  # as it was left


@pytest.mark.parametrize(
    ("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")]
)
def test_nothing_overlaps_or_overflows(files, serve, opened, width, scheme):
    page = opened(serve(*files).address, width, 844, scheme)
    page.get_by_label("Add tube_flexure").click()
    page.get_by_text("Error 0.969").wait_for()
    page.get_by_label("Add refraction").wait_for()
    page.mouse.move(5, 5)
    for tab in ("Q-Q", "Autocorrelation", "Errors", "Map"):
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(700)
        assert page.evaluate(NO_OVERLAP) == [], tab
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    if width < 760:  # a thumb needs 40 px
        buttons = page.locator("button:visible, .desk summary:visible")
        assert min(buttons.evaluate_all("a => a.map((e) => e.getBoundingClientRect().height)")) >= 40
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(20, 23, 26)") == (scheme == "dark")
    page.evaluate("scrollTo(0, 0)")
    picture(page, f"{width}_{scheme}")


def test_a_hundred_thousand_rows(files, serve, opened, tmp_path):
    machine, n, random = Machine.load(files[0]), 100_000, np.random.default_rng(1)
    design = {"AZ [deg]": random.uniform(0, 360, n), "EL [deg]": random.uniform(15, 88, n)}
    hidden = ["tube_flexure:a=20arcsec"]
    made = simulate(machine, Measurements.from_frame(design), hidden, noise="0.6arcsec", seed=1).data
    columns = list(made.columns.values())
    header = ",".join(column.text for column in columns)
    np.savetxt(
        tmp_path / "many.csv",
        np.transpose([c.values for c in columns]),
        "%.11g",
        ",",
        header=header,
        comments="",
    )
    page = opened(serve(files[0], tmp_path / "many.csv").address)
    page.get_by_text(re.compile(r"\d+ of 100000 rows are drawn")).first.wait_for()
    page.get_by_label("Add tube_flexure").click()
    page.get_by_text(re.compile(r"Error 0\.(60|599)")).wait_for()
    page.get_by_label("Undo").click()
    page.get_by_text("It has no effects yet").wait_for()


NAMED = set(
    "button textbox combobox checkbox slider spinbutton tab tablist region dialog link heading columnheader".split()
)


def nameless(page):
    """Return what a screen reader would read without a name: controls, parts and plots."""
    session = page.context.new_cdp_session(page)
    session.send("Accessibility.enable")
    tree = session.send("Accessibility.getFullAXTree")["nodes"]
    roles = [(n["role"]["value"], n.get("name", {}).get("value", "")) for n in tree if not n.get("ignored")]
    assert sum(role == "main" for role, _ in roles) <= 1
    plots = page.locator(".js-plotly-plot:visible").evaluate_all("a => a.map((e) => e.ariaLabel)")
    return [role for role, name in roles if role in NAMED and not name] + [x for x in plots if not x]


def test_a_screen_reader_finds_a_name_on_every_control(files, serve, opened):
    page = opened(serve(*files).address)
    page.get_by_label("Add tube_flexure").click()
    page.get_by_label("Add refraction").wait_for()
    page.get_by_text("Formula of your own").first.click()
    for tab in ("In space", "Polar", "Q-Q", "Autocorrelation", "Errors"):
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(300)
        assert nameless(page) == [], tab
    for opens, title in (
        ("Keep", "Keep"),
        ("Plan", "What to measure next"),
        ("Change tube_flexure.a", "Change tube_flexure.a"),
    ):
        page.get_by_role("button", name=opens, exact=True).click()
        page.get_by_role("dialog", name=title).wait_for()
        assert nameless(page) == [], opens
        picture(page, f"dialog_{opens.split()[0].lower()}")
        page.keyboard.press("Escape")
        page.get_by_role("dialog", name=title).wait_for(state="hidden")
    page.close()
    start = opened(serve().address)
    start.get_by_label("Begin with the machine file").click()
    start.get_by_text("Options of 'rodgen import'").click()
    start.get_by_label("Options", exact=True).wait_for()
    picture(start, "template")
    assert nameless(start) == []


def test_everything_is_reached_and_done_by_keyboard(files, serve, opened):
    page = opened(serve(*files).address)
    page.get_by_label("Add tube_flexure").wait_for()
    focused = "document.activeElement.ariaLabel || document.activeElement.innerText"

    def go_to(name, key="Tab", most=80):
        for _ in range(most):
            page.keyboard.press(key)
            if page.evaluate(focused) == name:
                return
        raise AssertionError(f"{name} is not reached by {key}")

    marks = page.locator(".js-plotly-plot").first.locator(".point")
    before = marks.count()
    go_to("Add tube_flexure (TF)")
    page.wait_for_function(
        "n => document.querySelectorAll('.js-plotly-plot')[0].querySelectorAll('.point').length > n",
        arg=before,
    )  # what it would explain is drawn where the focus is, too
    page.keyboard.press("Enter")
    page.get_by_text("Error 0.969").wait_for()
    go_to("Map")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Enter")
    page.get_by_text("Residuals in space").wait_for()
    page.keyboard.press("Control+z")
    page.get_by_text("Error 2.71 arcsec").wait_for()
    go_to("Keep", "Shift+Tab")
    page.keyboard.press("Enter")
    go_to("Write: Session", most=20)
    page.keyboard.press("Enter")
    page.get_by_text("machine.rodgen is written").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("dialog").wait_for(state="hidden")
    assert Session.load(files[0].with_name("machine.rodgen")).at == 0


def test_names_with_markup_and_quotes_are_text(files, serve, opened):
    evil = """<img src=x onerror="document.title='owned'"> "q" 'r' </h1><script>document.title='owned'</script>"""
    text = files[0].read_text().replace('"Alt-azimuth mount of a telescope"', f"'''{evil}'''")
    files[0].write_text(text)
    folder = files[0].parent / "a 'quoted' <b> folder"
    folder.mkdir()
    machine, data = (Path(shutil.move(file, folder)) for file in files)
    page = opened(serve(machine, data).address)
    assert page.get_by_role("heading", level=1).inner_text() == evil
    page.locator(".js-plotly-plot .point").first.wait_for()
    page.get_by_label("Add tube_flexure").wait_for()  # nothing above the plot moves it any more
    plot = page.locator(".js-plotly-plot").first.bounding_box()
    page.mouse.move(plot["x"] + 100, plot["y"] + 30)
    page.mouse.down()
    page.mouse.move(plot["x"] + 230, plot["y"] + 160, steps=5)
    page.mouse.up()
    page.get_by_label("Note").fill(evil)
    page.get_by_label("Exclude").click()
    page.get_by_text(evil).first.wait_for()
    page.get_by_label("Add tube_flexure").click()
    page.get_by_text("+ tube_flexure").first.wait_for()
    assert page.title() == "rodgen"
    assert page.locator("img[src=x]").count() == 0


def test_only_the_window_that_knows_the_address_is_answered(files, serve):
    address = serve(*files).address
    port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/([\w-]+)/", address).groups()
    own = f"127.0.0.1:{port}"

    def asked(path, **headers):
        given = {"Host": own} | {key.replace("_", "-"): value for key, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=60)
        connection.request("GET", path, headers=given)
        answer = connection.getresponse()
        assert b"root:" not in answer.read()
        connection.close()
        return answer.status

    assert asked(f"/{token}/") == 200
    assert asked(f"/{token}/", Origin=f"http://{own}") == 200
    for path in ("/", f"/{token[:-1]}x/", f"/{token}", "/_nicegui/", f"/x/../{token}/"):
        assert asked(path) == 403, path
    assert asked(f"/{token}/", Host=f"rebound.example:{port}") == 403
    assert asked(f"/{token}/", Origin="https://elsewhere.example") == 403
    assert asked(f"/{token}/", Sec_Fetch_Site="cross-site") == 403
    for path in ("_nicegui/../../../../etc/passwd", "_nicegui/static/%2e%2e/%2e%2e/%2e%2e/etc/passwd"):
        asked(f"/{token}/{path}")
        asked(f"/{token}/{path.replace('/', '%2f')}")


def test_the_server_ends_as_other_commands_do(files, serve):
    for how, code in ((signal.SIGINT, 0), (signal.SIGTERM, 143)):
        server = serve(*files)
        server.end(how)
        assert server.process.returncode == code


def test_without_files_examples_and_dropped_files_are_opened(files, serve, opened):
    server = serve()
    page = opened(server.address)
    page.get_by_label("Open the example mount").wait_for()
    picture(page, "start")
    drop = page.locator("input[type=file]")
    drop.set_input_files([{"name": "x.toml", "mimeType": "", "buffer": b"<script>alert(1)</script>"}])
    drop.set_input_files([str(files[1])])
    page.get_by_text("expected TOML").wait_for()
    page.get_by_label("Measurements").fill("/etc/passwd")
    page.get_by_label("Machine file, or a session").fill(str(files[0]))
    page.get_by_label("Open the files").click()
    page.get_by_text("/etc/passwd: ").wait_for()
    page.reload()
    page.locator("input[type=file]").set_input_files([str(files[0]), str(files[1])])
    page.get_by_text("Error 2.71 arcsec").wait_for()
    page.close()
    again = opened(serve().address)
    again.get_by_label("Open the example trunnion").click()
    again.get_by_text("on poses held out").wait_for()


def test_what_is_kept_is_written_and_downloaded(files, serve, opened, tmp_path):
    page = opened(serve(*files).address)
    page.get_by_label("Add tube_flexure").click()
    page.get_by_text("Error 0.969").wait_for()
    page.get_by_label("Keep").click()
    for what, name in (
        ("Machine file", "machine_better.toml"),
        ("Report", "machine.html"),
        ("Code, a folder", "machine_c.zip"),
    ):
        with page.expect_download(timeout=4 * PATIENCE) as started:
            page.get_by_label(f"Download: {what}").click()
        assert started.value.suggested_filename == name
        started.value.save_as(tmp_path / name)
    assert "tube_flexure" in (tmp_path / "machine_better.toml").read_text()
    assert (tmp_path / "machine.html").read_text().count("refraction") > 3
    names = zipfile.ZipFile(tmp_path / "machine_c.zip").namelist()
    assert {Path(name).suffix for name in names} >= {".c", ".h"}
    page.get_by_label("As", exact=True).click()
    page.get_by_role("option", name="MATLAB and GNU Octave").click()
    page.get_by_label("Write: Code, a folder").click()
    page.get_by_text("machine_matlab is written").wait_for()
    assert [*(tmp_path / "machine_matlab").rglob("*.m")]
    page.get_by_label("Code, a folder", exact=True).fill("../elsewhere")
    page.get_by_label("Write: Code, a folder").click()
    page.get_by_text("a name without a folder").wait_for()
    picture(page, "keep")
    assert not (tmp_path.parent / "elsewhere").exists()
