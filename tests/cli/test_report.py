"""`python -m hitmdp_jax report` as a user runs it, and its page as a browser shows it."""

import re
import shutil
import time
from importlib.resources import files

import pytest

from tests.cli.conftest import QUICK

SECTIONS = (
    "In short",
    "Video",
    "Each option alone",
    "What was run",
    "What it learned",
    "Options while it learned",
    "When each option acts",
    "Do the options differ, and do they matter?",
    "What an embedding means",
    "Where each option acts",
    "Settings",
)


def sections_of(page):
    return tuple(re.sub(r"<.*?>", "", title) for title in re.findall(r"<h2[^>]*>(.*?)</h2>", page))


@pytest.fixture(scope="module")
def page(command, finished, tmp_path_factory):
    """The page of a MOPG run of two seeds."""
    path = tmp_path_factory.mktemp("report") / "page.html"
    result = command("report", finished[0], "--episodes=2", f"--out={path}")
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith(f"Saved {path}: ")
    return path


def test_the_page_has_every_section_and_needs_no_network(page):
    content = page.read_text()
    assert sections_of(content) == SECTIONS
    own = re.sub(r"<script.*?</script>", "", content, flags=re.DOTALL)
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", own)
    assert "python train.py env=invertedpendulum algo=mopg algo.num_epochs=1" in content


@pytest.mark.whole
def test_a_page_may_show_options_and_video_in_another_task(command, finished, halved, tmp_path):
    run_dir = shutil.copytree(finished[0], tmp_path / "run")
    result = command("report", run_dir, "--episodes=2", "--seed=4", "--env", halved)
    assert result.returncode == 0, result.stderr
    content = (run_dir / "report_own.Halved.html").read_text()
    assert sections_of(content) == SECTIONS
    subtitle = "Options and video show seed 4 in own.Halved, on which it was not trained."
    assert subtitle in content
    assert "mopg on invertedpendulum" in content
    assert f"{run_dir} --env {halved} --" in content  # the next command


def test_a_run_ends_with_its_page_which_is_without_options_where_it_has_none(command, tmp_path):
    run_dir = tmp_path / "ppo"
    quick = [setting for setting in QUICK if setting != "report=false"]
    settings = (*quick, "total_steps=2048", f"run_dir={run_dir}")
    result = command("train", *settings)
    assert result.returncode == 0, result.stderr
    content = (run_dir / "report.html").read_text()
    titles = ("In short", "Video", "What was run", "What it learned", "Settings")
    assert sections_of(content) == titles


def test_a_run_that_was_cut_short_still_has_a_page(command, finished, tmp_path):
    run_dir = tmp_path / "run"
    shutil.copytree(finished[0], run_dir)
    (run_dir / "metrics.csv").write_text("")
    shutil.rmtree(run_dir / "checkpoints")
    result = command("report", run_dir)
    assert result.returncode == 0, result.stderr
    content = (run_dir / "report.html").read_text()
    assert sections_of(content) == ("Settings", "Left out")
    assert re.search("What it learned.*: The run has no finished iteration.</li>", content)


@pytest.fixture(scope="module")
def comparison(command, finished, tmp_path_factory):
    """The page of a run and its copy in a folder "other"."""
    folder = tmp_path_factory.mktemp("comparison")
    shutil.copytree(finished[0], folder / "other")
    path = folder / "both.html"
    result = command("report", finished[0], folder / "other", f"--out={path}")
    assert result.returncode == 0, result.stderr
    return path


def test_several_runs_are_compared(comparison):
    content = comparison.read_text()
    assert sections_of(content)[:2] == ("Returns", "Videos")
    assert content.count("<video ") == 2
    # Two runs of one algorithm are told apart by their folders.
    assert str(comparison.parent / "other") in content


def test_no_run_is_one_sentence(command, tmp_path):
    result = command("report", tmp_path / "none")
    assert (result.returncode, result.stderr.count("\n")) == (2, 1)


@pytest.fixture
def chrome():
    webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium is not installed")
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not browser or not driver:
        pytest.skip("Chromium and its driver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in ("--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chrome = webdriver.Chrome(options, webdriver.ChromeService(driver))
    yield chrome
    chrome.quit()


@pytest.mark.parametrize("width", [1200, 390])
def test_a_browser_shows_every_figure(chrome, page, width):
    show(chrome, page, width)
    empty = """
        const plots = [...document.querySelectorAll('.js-plotly-plot')];
        const blank = (plot) => !plot.data.length || plot.clientHeight < 90;
        return plots.filter(blank).map((plot) => plot.id)"""
    assert chrome.execute_script(empty) == []
    loaded = "return document.querySelector('video').readyState"
    wait_until(lambda: chrome.execute_script(loaded) >= 2)
    # Below the picture there is room for the controls; a click on its strip of options seeks.
    sizes = """
        const video = document.querySelector('video'), box = video.getBoundingClientRect();
        const picture = box.width * video.videoHeight / video.videoWidth;"""
    room = sizes + "return box.height - picture"
    wait_until(lambda: chrome.execute_script(room) == pytest.approx(76, abs=1))
    clicked = """
        const clientX = box.left + box.width / 2, clientY = box.top + 0.95 * picture;
        video.dispatchEvent(new MouseEvent('click', {clientX, clientY, cancelable: true}));
        return video.currentTime / video.duration"""
    at = chrome.execute_script(sizes + clicked)
    assert at == pytest.approx(0.5, abs=0.02)
    in_step = """
        const clips = [...document.querySelectorAll('.clips video')];
        const times = clips.map((clip) => clip.currentTime);
        return [clips.length, Math.max(...times) - Math.min(...times) < 0.5,
                clips.every((clip) => !clip.paused), clips.some((clip) => clip.controls)]"""
    wait_until(lambda: chrome.execute_script(in_step)[2])
    assert chrome.execute_script(in_step) == [4, True, True, False]
    chrome.execute_script("document.querySelector('.clips + script + button').click()")
    stopped = "return [...document.querySelectorAll('.clips video')].every((x) => x.paused)"
    assert chrome.execute_script(stopped)
    moved = """
        const shown = () => JSON.stringify(
          document.getElementById('explorer-chart').data.map((line) => line.y));
        const before = shown(), choice = document.getElementById('explorer-dimension');
        choice.selectedIndex = choice.length - 1;
        choice.dispatchEvent(new Event('change'));
        return before !== shown()"""
    assert chrome.execute_script(moved)
    assert chrome.get_log("browser") == []
    assert_readable_by_everyone(chrome)
    asked = "return performance.getEntriesByType('resource').map((entry) => entry.name)"
    assert all(name.startswith("data:") for name in chrome.execute_script(asked))


@pytest.mark.parametrize("width", [1200, 390])
def test_a_browser_shows_a_comparison(chrome, comparison, width):
    show(chrome, comparison, width)
    assert_readable_by_everyone(chrome)


def show(chrome, page, width):
    """Open a page whose charts are drawn, and which is no wider than the screen."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600}
    chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    chrome.get(page.as_uri())
    drawn = "return document.querySelectorAll('.js-plotly-plot .main-svg').length"
    wait_until(lambda: chrome.execute_script(drawn))
    assert chrome.get_log("browser") == []
    assert chrome.execute_script("return document.documentElement.scrollWidth") <= width


def assert_readable_by_everyone(chrome):
    """By axe-core, in light and dark."""
    assert faults(chrome) == {}
    dark = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", dark)
    assert faults(chrome) == {}


def faults(chrome):
    """Return what axe-core finds that keeps people from reading a page: rule -> elements."""
    chrome.execute_script(files("axe_core_python").joinpath("axe.min.js").read_text())
    found = chrome.execute_async_script("axe.run().then(arguments[0])")["violations"]
    return {rule["id"]: [node["html"] for node in rule["nodes"]] for rule in found}


def wait_until(condition):
    while not condition():
        time.sleep(0.1)
