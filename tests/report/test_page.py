import base64
import copy
import dataclasses
import html
import io
import json
import re
from html.parser import HTMLParser
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from plotly.offline import get_plotlyjs

from hitmdp_jax.cli.settings import Settings
from hitmdp_jax.envs.spec import Box, Observation, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import published
from hitmdp_jax.experiments.pages import comparison_page, published_page
from hitmdp_jax.figures.embeddings import limit_of_changes
from hitmdp_jax.figures.style import styles
from hitmdp_jax.interpret.interventions import alike
from hitmdp_jax.interpret.verdict import episodes_needed, verdict
from hitmdp_jax.report.interactive import chart, differences, explorer, learning_curves, unit_of
from hitmdp_jax.report.page import DPI, PLAIN, drawing, packed, page
from hitmdp_jax.report.run_report import RunReport
from hitmdp_jax.runs.sinks import CsvSink
from tests.cli.conftest import CHECKOUT
from tests.interpret.analyses import analysis_of_embeddings
from tests.report.shown import charts, drawings, shown


def page_of(folder, num_options, seeds):
    """The page of a run of one iteration, which cannot be filmed, without its programs."""
    settings = ["env=hopper", f"algo.num_options={num_options}", f"seeds={seeds}"]
    config = Settings(settings).config()
    sink = CsvSink(folder, config.trainings)
    metrics = {
        name: np.full(seeds, 7.0) for name in ("episode_return", "episodes", "steps_per_second")
    } | {name: np.ones((seeds, num_options)) for name in ("option_steps", "option_activations")}
    sink.write(1, 2048, metrics)
    sink.close()

    known = shown(analysis_of_embeddings(num_options))
    content = RunReport(folder, config, "python train.py", 0, known).html()
    return re.sub(r"<script.*?</script>", "", content, flags=re.DOTALL)


def headings(page):
    return re.findall("<h[23][^>]*>(.*?)</h[23]>", page)


@pytest.mark.whole
def test_of_a_single_option_is_shown_what_it_has_to_show(tmp_path):
    page = page_of(tmp_path, 1, seeds=1)
    assert headings(page) == [
        "In short", "What was run", "What it learned",
        "Options while it learned", "How long options last, and how they share the steps",
        "When each option acts", "Which options are active",
        "What an embedding means", "Embeddings W and their cosine similarities",
        "What a dimension does to the actions",
        "Where each option acts", "A typical pose of each option",
        "Visited states in two dimensions", "Settings", "Left out",
    ]  # fmt: skip
    without = "Each option alone; Do the options differ, and do they matter?"
    assert f"<li>{without}: The policy has one option.</li>" in page
    assert "<li>Video: no luck.</li>" in page
    assert "<p>Return of all 2,048 steps: 7.00.</p>" in page
    assert "Everything about options" not in page
    assert "95% interval" not in page
    assert '<th scope="row">return of all 2,048 steps</th>' in page


def test_several_options_and_seeds_have_the_rest(tmp_path):
    page = page_of(tmp_path, 9, seeds=2)
    assert {
        "Which option follows",
        "How probable the master policy's choice of each option is",
        "How far the options' actions are apart",
    } < {html.unescape(heading) for heading in headings(page)}
    assert "attention" not in page
    described = "seed 0 after 2,048 environment steps"
    assert f"Everything about options on this page describes {described}." in page
    in_short = re.search('<section id="in-short"[^>]*>(.*?)</section>', page, re.DOTALL).group(1)
    known = analysis_of_embeddings(9)
    for sentence in (*verdict(known.interventions), alike(known.divergence)):
        assert f"<p>{html.escape(sentence)}</p>" in in_short
    assert episodes_needed(known.interventions) is None
    assert f'<pre tabindex="0">hitmdp evaluate {tmp_path} --choices</pre>' in in_short
    assert "practically nothing" in page
    assert "each of 2 trainings" in page
    assert "7.00 (interquartile mean of 2 seeds)" in page


def test_each_option_alone_has_a_clip_the_eight_used_most(tmp_path):
    """What a clip shows, its colour and its caption are of one option, in the options' order."""
    known = analysis_of_embeddings(9)
    clips, explained = RunReport(tmp_path, None, "", 0, shown(known)).alone()
    least = known.by_usage[-1]
    options = [k for k in range(9) if k != least]
    films = re.findall('base64,([^"]*)', clips)
    assert [base64.b64decode(film).decode() for film in films] == [f"clip {k}" for k in options]
    captions = re.findall("<figcaption>(.*?)</figcaption>", clips)
    assert captions == re.findall('aria-label="(.*?)"', clips)
    for k, caption in zip(options, captions, strict=True):
        said, value = caption.rsplit(" ", 1)
        assert said == f"Option {k} alone, from the same state: return"
        alone = dict(zip(known.interventions.names, known.interventions.returns[:, 0], strict=True))
        assert float(value) == pytest.approx(alone[f"option {k}"], rel=0.01)
    assert "all clips begin in one state" in explained


def test_of_a_task_with_a_goal_the_page_says_how_many_episodes_reached_it(tmp_path):
    config = Settings(["env=maze/point_umaze", "seeds=2"]).config()
    sink = CsvSink(tmp_path, config.trainings)
    ended = {"episode_return": np.ones(2), "episodes": np.ones(2), "steps_per_second": np.ones(2)}
    for iteration, success in ((1, [1.0, 0.0]), (2, [1.0, 1.0])):
        sink.write(iteration, 2048 * iteration, ended | {"success": np.array(success)})
    sink.close()
    _, reached, *_ = RunReport(tmp_path, config, "", 0, shown(analysis_of_embeddings())).verdict()
    assert reached == "<p>Of the episodes in those steps, 75% reached the goal.</p>"


def test_the_verdict_leaves_the_letters_of_a_settings_name_as_they_are(tmp_path):
    config = Settings(["env=hopper", "sweep={algo.gamma:[0.9,0.99]}"]).config()
    config = dataclasses.replace(config, sweep={"algo.ownRate": [0.9, 0.99]})
    sink = CsvSink(tmp_path, config.trainings)
    names = ("episode_return", "episodes", "steps_per_second")
    sink.write(1, 2048, {name: np.array([1.0, 2.0]) for name in names})
    sink.close()
    first, *_ = RunReport(tmp_path, config, "", 0, shown(analysis_of_embeddings())).verdict()
    assert first.startswith("<p>Return of all 2,048 steps, of the best setting, ownRate=0.99: ")


LEARNED = {
    "swept": (["env=hopper", "sweep={algo.gamma:[0.9,0.99]}"], "What the settings return"),
    "switched": (["experiment=transfer", "pair=cartpole"], "What is regained after the switch"),
    "neither": (["env=hopper"], None),
}


@pytest.mark.parametrize("name", LEARNED)
def test_below_its_curves_a_run_has_the_figure_that_fits_it(tmp_path, name):
    settings, title = LEARNED[name]
    config = Settings([*settings, "seeds=2"]).config()
    sink = CsvSink(tmp_path, config.trainings)
    one = np.ones(len(config.trainings))
    names = ("episode_return", "episodes", "steps_per_second")
    last = config.schedule.iterations
    for iteration in (1, last + 1) if name == "switched" else (1,):
        sink.write(iteration, 2048 * iteration, dict.fromkeys(names, one))
    sink.close()
    parts = [*RunReport(tmp_path, config, "", 0, shown()).learning()]
    assert [part for part in parts if "<h3>" in part] == [f"<h3>{title}</h3>"] * bool(title)
    assert ("drawing" in parts[-1]) == bool(title)


def test_of_a_transfer_the_page_names_the_task_on_which_options_are_shown(tmp_path):
    config = Settings(["experiment=transfer", "pair=cartpole"]).config()
    names = ("episode_return", "episodes", "steps_per_second")
    last = config.schedule.iterations  # of the first task
    for iteration, task in ((last, "cartpole_balance"), (last + 1, "cartpole_balance_sparse")):
        (folder := tmp_path / task).mkdir()
        sink = CsvSink(folder, config.trainings)
        sink.write(iteration, iteration * 2048, dict.fromkeys(names, np.ones(1)))
        sink.close()
        told = RunReport(folder, config, "", 0, shown()).subtitle
        steps = f"{iteration * 2048:,} environment steps"
        assert told.endswith(f"describes seed 0 after {steps} on dmc/{task}.")


def test_the_explorers_chart_ends_where_the_noise_of_the_actions_does():
    known = analysis_of_embeddings(9)
    part = explorer(known)
    assert f'"limit": {limit_of_changes(known.perturbation)}' in part
    assert "range: [-1.05 * found.limit, 1.05 * found.limit]" in part


def test_a_drawing_is_a_picture_of_its_own_and_the_same_every_time():
    figure = Figure()
    figure.suptitle("<script>alert(1)</script>")
    parts = {drawing(figure, '"><script>') for _ in range(2)}
    assert len(parts) == 1
    safe = re.escape(PLAIN)
    found = re.fullmatch(
        r'<div class="scroll" tabindex="0" role="group" aria-label="&#34;&gt;&lt;script&gt;">'
        r'<img class="drawing" alt="&#34;&gt;&lt;script&gt;" '
        rf'src="data:image/svg\+xml,((?:[\w{safe}]|%[0-9A-F]{{2}})+)"></div>',
        parts.pop(),
    )
    assert found
    ElementTree.fromstring(unquote(found[1]))  # which is whole


def test_what_a_drawing_holds_as_pixels_is_lighter_and_the_same():
    figure = Figure(figsize=(3, 2), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    points = np.random.default_rng(0).random((2, 400))
    axes.scatter(*points, c=points[0], rasterized=True)
    axes.set_axis_off()
    file = io.BytesIO()
    figure.savefig(file, format="svg", dpi=DPI)
    (png,) = re.findall('image/png;base64,([^"]*)', file.getvalue().decode())
    part = unquote(drawing(figure, ""))
    assert "image/png" not in part
    (webp,) = re.findall('image/webp;base64,([^"]*)', part)
    assert len(webp) < 0.9 * len(png)
    before, after = (Image.open(io.BytesIO(base64.b64decode(x))) for x in (png, webp))
    seen = np.asarray(before)[..., 3] > 0
    assert after.size == before.size
    np.testing.assert_array_equal(np.asarray(before)[seen], np.asarray(after.convert("RGBA"))[seen])


CURVES = {
    "long": [-3.0, 1.5, 1e4, 9999.0],
    "with gaps": [np.nan, 5.0, np.nan, np.nan, -7.0, 2.0],
    "tiny": [1e-7, 3e-7, 2e-7],
    "level": [250.0, 250.0],
    "nothing": [np.nan, np.nan],
    "zero": [0.0],
}


@pytest.mark.parametrize("name", CURVES)
def test_a_curve_is_told_as_finely_as_it_is_seen(name):
    curve = np.array(CURVES[name])
    unit = unit_of([curve])
    told = differences(curve, unit)
    assert [there is None for there in told] == np.isnan(curve).tolist()
    known = curve[np.isfinite(curve)]
    found = unit * np.cumsum([there for there in told if there is not None])
    reach = np.ptp(known) if known.size and np.ptp(known) else np.abs(known).max(initial=0.0)
    np.testing.assert_allclose(found, known, atol=reach / 2000)
    assert f"{unit:.0e}"[0] in "125"


def test_a_chart_holds_its_curves_packed():
    metrics = {
        "env_steps": np.array([[2048, 4096, 6144]]), "seed": np.array([[7.0] * 3]),
        "episode_return": np.array([[np.nan, 10.0, 30.0]]),
    }  # fmt: skip
    drawn = learning_curves({"a": metrics}, styles({"a": "ppo"}), {"a": None}, window=1)
    (found,) = map(json.loads, charts(chart(drawn, "")))
    (curve,) = found["data"]
    assert (curve["name"], curve["x"]) == ("a, seed 7", [2048, 2048, 2048])
    assert curve["y"] == [None, 10 / found["unit"], 20 / found["unit"]]


def test_a_light_page_has_all_its_drawings_in_one_packed_text():
    figures = [Figure(figsize=(1 + i, 1)) for i in range(3)]

    def section(figures):
        return lambda: iter([drawing(figure, "a") for figure in figures])

    sections = {"first": section(figures[:2]), "second": section(figures[2:])}
    plain, light = page("", "", sections), page("", "", sections, light=True)
    whole = [unquote(x) for x in re.findall(r'src="data:image/svg\+xml,([^"]*)"', plain)]
    assert json.loads(drawings(light)) == whole
    assert [re.search('width="(.*?)pt"', svg)[1] for svg in whole] == ["72", "144", "216"]
    assert light.count('<img class="drawing" alt="a">') == 3
    assert "The pictures of this page need JavaScript" in light
    assert 'id="drawings"' not in plain


@pytest.mark.whole
def test_the_page_of_everything_published_is_light():
    cells = {x.name: published.read(x) for x in (CHECKOUT / "results").iterdir() if x.is_dir()}
    assert len(published_page(cells)) < 3 * 2**20


class Tags(HTMLParser):
    """Every start and end of an element, as a browser finds them, and what scripts hold."""

    def __init__(self, page):
        super().__init__()
        self.found, self.scripts = [], charts(page)
        self.feed(page.replace(packed(get_plotlyjs()), ""))

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, sorted(name for name, _ in attrs)))

    def handle_endtag(self, tag):
        self.found.append(tag)

    def handle_data(self, data):
        if self.lasttag == "script":
            self.scripts.append(data)


HOSTILE = "</script></title><img src=x onerror=alert(1)>&lt;\u2028\"'"


def pages_of_a_stranger(folder, name):
    """The pages about a run in which everything that has a name has this one."""
    settings = ["env=hopper", "sweep={algo.gamma:[0.9,0.99]}"]
    config = Settings(settings).config()
    sink = CsvSink(folder, config.trainings)
    names = ("episode_return", "episodes", "steps_per_second", "option_steps", name)
    sink.write(1, 2048, {column: np.ones(2) for column in names})
    sink.close()
    (folder / "made_with.txt").write_text(name)
    config = dataclasses.replace(
        config,
        algo=config.algo | {"name": name, name: name},
        env=config.env | {"name": name},
        sweep={name: [0.9, 0.99]},
    )
    known = copy.copy(analysis_of_embeddings(1))
    known.__dict__["spec"] = Spec(
        Observation((2,), names=(name, name)), Box((0.0,), (1.0,), (name,))
    )

    def video(_):
        raise UsageError(name)

    yield RunReport(folder, config, name, 0, shown(known, video)).html()
    yield comparison_page({name: (folder, config)}, {name: name}, {name: video})


def test_a_strangers_names_are_text_wherever_they_stand(tmp_path):
    """Hostile ones lead to the elements that harmless ones do, and to no text that is HTML."""
    pages = {}
    for i, name in enumerate(("plain", HOSTILE)):
        (folder := tmp_path / str(i)).mkdir()
        pages[name] = [*map(Tags, pages_of_a_stranger(folder, name))]
    for plain, hostile in zip(pages["plain"], pages[HOSTILE], strict=True):
        assert hostile.found == plain.found
        mine = "".join(hostile.scripts)
        assert "alert(1)" in mine
        # Plotly's charts read HTML themselves, so the name is escaped in what they are told, too.
        assert not re.search(r"(<|\\u003c)(img|/script)", mine)
        assert "\u2028" not in mine
