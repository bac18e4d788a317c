"""Every figure of the catalogue, by what it says of policies and runs that are known."""

import copy
import io
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from hitmdp_jax.envs.spec import Box, Observation, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.figures.curves import learning_curve
from hitmdp_jax.figures.embeddings import limit_of_changes
from hitmdp_jax.figures.registry import Needs, RunMetrics, entries, find
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.figures.sweeps import ranking
from hitmdp_jax.interpret.perturbation import strongest
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.runs.config import RunConfig
from tests.interpret.analyses import analysis_of_embeddings, analysis_of_terminations

OF_EPISODES = [
    name
    for name, entry in entries().items()
    if entry.needs == Needs.EPISODES and name != "paths"  # of robots: test_paths.py
]
WITHOUT = {  # what MOPG, and DAC, have not
    "terminations": "MOPG has no termination functions to draw.",
    **dict.fromkeys(("figure5", "figure12", "figure13", "figure14"), "DAC has no option embed"),
    "attention": "DAC has no attention to draw.",
}


def texts(figure):
    """Draw a figure; return the texts in it."""
    figure.savefig(io.BytesIO(), format="svg")
    return [text.get_text() for text in figure.findobj(Text)]


@pytest.mark.parametrize("analysis", [analysis_of_embeddings, analysis_of_terminations])
@pytest.mark.parametrize("name", OF_EPISODES)
def test_a_figure_of_episodes_names_the_options_or_says_what_is_missing(name, analysis):
    known = analysis()
    lacking = WITHOUT.get(name, "")
    if lacking.startswith(type(known.policy.agent).__name__):
        with pytest.raises(UsageError, match=lacking):
            find(name).draw(known)
        return
    found = " ".join(texts(find(name).draw(known)))
    assert f"{known.by_usage[0]}" in found
    assert ("W" in found) == (name.startswith("figure1") or name == "figure5")


@pytest.mark.parametrize("name", ["causal", "transitions", "choices", "divergence"])
def test_one_option_has_nothing_to_tell_apart(name):
    with pytest.raises(UsageError, match=r"The policy has one option\."):
        find(name).draw(analysis_of_embeddings(1))


def limits(figure):
    return {image.get_clim() for axes in figure.axes for image in axes.images}


@pytest.mark.parametrize(("size", "limit"), [(0.0015, 1.0), (0.48, 1.0), (48.0, 48.0)])
def test_options_that_hardly_differ_look_it(size, limit):
    known = SimpleNamespace(divergence=size * (1.0 - np.eye(2)), check_several_options=list)
    figure = find("divergence").draw(known)
    assert limits(figure) == {(0.0, limit)}
    said = figure.get_suptitle()
    assert said.startswith("The options are practically identical") == (size < 0.01)


@pytest.mark.parametrize("name", ["figure5", "figure13", "figure14"])
def test_all_changes_of_actions_have_one_scale(name):
    """An untrained policy's embeddings move nothing: no colour may say that they do."""
    known = analysis_of_embeddings()
    found, most = known.perturbation, np.abs(known.embeddings).max()
    figure, limit = find(name).draw(known), limit_of_changes(found)
    assert limits(figure) - {(-most, most)} == {(-limit, limit)}
    assert limit == found.noise.max() > 100 * np.abs(found.moved).max()
    said = " ".join(part.get_supxlabel() for part in (figure, *figure.subfigs))
    assert "practically nothing" in said.replace("\n", " ")


@pytest.mark.parametrize(("size", "limit"), [(3e-5, 0.5), (10.0, 10.0)])
def test_nothing_tiny_fills_a_chart_of_changes(size, limit):
    found = SimpleNamespace(moved=size * np.array([0.2, -1.0]), noise=np.full(2, 0.5))
    assert limit_of_changes(found) == limit


def test_the_dimension_that_moves_most_is_shown_with_its_slope():
    known = analysis_of_embeddings()
    option, slopes = known.by_usage[0], known.perturbation.slopes
    e = strongest(slopes[option])[0]
    found = texts(find("figure13").draw(known))
    assert {f"dimension {e} of option {option}", f"{slopes[option, e, 0]:+z.3f}"} < set(found)


def test_sequences_show_every_activation():
    known = analysis_of_embeddings()
    figure = find("figure7").draw(known)
    for axes, episode in zip(figure.axes, known.activations, strict=True):
        bars = [path.get_extents() for lane in axes.collections for path in lane.get_paths()]
        assert sorted((round(b.x0), round(b.width)) for b in bars) == sorted(
            zip(episode.start.tolist(), episode.duration.tolist(), strict=True)
        )


def test_a_film_stands_over_the_steps_that_it_shows():
    """Seven steps, and a picture of the middle of each half of them."""
    known = analysis_of_embeddings()
    pictures = {1: np.zeros((4, 6, 3)), 5: np.ones((4, 6, 3))}
    figure = find("figure10").draw(known, pictures)
    figure.draw_without_rendering()
    above, lanes = figure.axes
    scale = figure.dpi_scale_trans.inverted()
    film, strip = (axes.get_window_extent().transformed(scale) for axes in (above, lanes))
    assert film.y0 >= strip.y1
    np.testing.assert_allclose((film.x0, film.x1), (strip.x0, strip.x1))
    assert above.get_xlim() == lanes.get_xlim() == (0, 7)
    extents = [image.get_extent()[:2] for image in above.images]
    np.testing.assert_allclose(np.mean(extents, axis=1), [1.75, 5.25])
    wide, high = np.ptp(above.transData.transform([(0, 0), (0.96 * 3.5, 1)]), axis=0)
    assert wide / high == pytest.approx(6 / 4, rel=0.08)
    colors = [to_hex(frame.get_edgecolor()) for frame in above.patches]
    assert colors == [option_color(k) for k in known.trajectories.option[[1, 5], 0]]
    assert [line.get_xdata()[0] for line in lanes.lines] == [1, 5]


def test_a_pose_has_the_colour_of_its_option_and_says_when_it_was():
    known = copy.copy(analysis_of_embeddings())
    states = known.states
    known.__dict__["typical"] = {4: 9, 1: 0}
    pictures = {4: np.zeros((3, 4, 3)), 1: np.ones((3, 4, 3))}
    figure = find("poses").draw(known, pictures)
    for axes, (k, i) in zip(figure.axes, known.typical.items(), strict=False):
        assert {to_hex(spine.get_edgecolor()) for spine in axes.spines.values()} == {
            option_color(k)
        }
        assert axes.get_title() == f"option {k}\n{known.usage[k]:.0%} of steps"
        assert axes.get_xlabel() == f"episode {states.episode[i] + 1}, step {states.step[i]}"
        np.testing.assert_array_equal(axes.images[0].get_array(), pictures[k])
    with pytest.raises(UsageError, match="typical states cannot be drawn"):
        find("poses").draw(known, {})


def run_of(num_options, title):
    steps = 2048 * np.arange(1, 31)[None]
    metrics = {"env_steps": steps, "episode_return": steps}
    for k in range(num_options):
        metrics |= {f"option_steps_{k}": steps, f"option_activations_{k}": steps / (k + 2)}
    return RunMetrics(title, metrics, "mopg")


def test_durations_of_several_runs_stand_side_by_side():
    figure = find("figure8").draw([run_of(4, "mopg"), run_of(2, "dac")])
    assert {"mopg", "dac"} <= set(texts(figure))
    last = [line.get_ydata()[-1] for line in figure.axes[1].lines if len(line.get_ydata())]
    assert last == [2.0, 3.0]


@pytest.mark.parametrize(
    ("run", "sentence"),
    [
        (RunMetrics("a", {}, "mopg"), "The run a has no iteration yet"),
        (run_of(0, "a"), "The run a has no options"),
    ],
)
def test_runs_without_durations_say_so(run, sentence):
    for name, needed in {"figure6": run, "figure8": [run]}.items():
        with pytest.raises(UsageError, match=sentence):
            find(name).draw(needed)


def transfer(first, second, switch_at=5 * 2048):
    """A run of two seeds that returns `first` [2] on one task, then `second` [n, 2] on another."""
    returns = np.concatenate([np.tile(first, (5, 1)), second]).T
    steps = 2048 * np.tile(np.arange(1, 1 + returns.shape[1]), (2, 1))
    metrics = {"env_steps": steps, "episode_return": returns, "episodes": np.ones(steps.shape)}
    return RunMetrics("a", metrics | {"seed": steps * 0 + [[3], [4]]}, "mopg", switch_at)


def test_what_is_regained_is_a_share_of_each_trainings_own_return():
    """The means so far of 20, 100, 120 are 20, 60, 80; those of 10, 10, 160 are 10, 10, 60."""
    run = transfer([100.0, 400.0], [[20.0, 10.0], [100.0, 10.0], [120.0, 160.0]])
    above, below = find("regained").draw(run).axes
    curves = [line.get_xydata() for line in above.lines if len(line.get_xdata()) == 3]
    np.testing.assert_allclose(curves[0], [[2048, 0.2], [4096, 0.6], [6144, 0.8]])
    np.testing.assert_allclose(curves[1][:, 1], [0.025, 0.025, 0.15])
    assert [label.get_text() for label in below.get_yticklabels()] == ["seed 3", "seed 4"]
    told = [(text.get_text(), text.xy[1]) for text in below.texts]  # type: ignore
    assert told == [("4,096 steps", 0), ("not in 6,144 steps", 1)]


@pytest.mark.parametrize(
    ("run", "sentence"),
    [
        (transfer([1.0, 1.0], [[1.0, 1.0]], None), "a has not switched to a second task"),
        (transfer([1.0, 1.0], np.ones((0, 2))), "a has not switched to a second task"),
        (transfer([1.0, -1.0], [[1.0, 1.0]]), "A return before the switch is not positive"),
    ],
)
def test_without_a_return_before_a_switch_nothing_is_regained(run, sentence):
    with pytest.raises(UsageError, match=sentence):
        find("regained").draw(run)


def sweep_of(axes, returns, **more):
    """A sweep's settings by name, the last one first, and its settings return what is said."""
    config = RunConfig(algo={"name": "mopg"}, env={"name": "hopper"}, sweep=axes, **more)
    settings = {}
    for number in reversed(range(len(config.settings))):
        own = np.full(2, returns[number])
        columns = {"env_steps": np.full(2, 2048), "last_100k_steps": own}
        settings[f"setting {number}"] = Summary(config, columns | {"setting": np.full(2, number)})
    return settings


def test_a_sweep_of_two_axes_is_a_heat_map():
    axes = {"algo.gamma": [0.99, 0.9], "env.friction": [1.0, 2.0, 3.0]}
    figure = find("sweep").draw(sweep_of(axes, [1.0, 2.0, 3.0, 4.0, 5.0, np.nan]))
    shown, bar = figure.axes
    wanted = [[4.0, 5.0, np.nan], [1.0, 2.0, 3.0]]  # the lower gamma in the first row
    np.testing.assert_array_equal(np.ma.filled(shown.images[0].get_array(), np.nan), wanted)
    assert [label.get_text() for label in shown.get_yticklabels()] == ["0.9", "0.99"]
    assert [label.get_text() for label in shown.get_xticklabels()] == ["1", "2", "3"]
    assert (shown.get_ylabel(), shown.get_xlabel()) == ("gamma", "env.friction")
    assert [text.get_text() for text in shown.texts] == [
        "4.00",
        "5.00",
        "-",
        "1.00",
        "2.00",
        "3.00",
    ]
    assert bar.get_ylabel() == "return of all 2,048 steps,\nIQM of 2 seeds"


def test_a_sweep_of_one_axis_is_a_line_in_the_order_of_its_values():
    (axes,) = find("sweep").draw(sweep_of({"algo.gamma": [0.99, 0.9, 1.0]}, [7.0, 5.0, 6.0])).axes
    np.testing.assert_array_equal(axes.lines[0].get_xydata(), [[0, 5], [1, 7], [2, 6]])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.9", "0.99", "1"]
    assert "interval" not in axes.get_ylabel()  # of two seeds none is known


def test_settings_drawn_at_random_are_ranked():
    axes = {"algo.gamma": {"uniform": [0.9, 0.99]}, "algo.clip_eps": {"uniform": [0.1, 0.3]}}
    (axes,) = find("sweep").draw(sweep_of(axes, [1.0, 2.0], samples=2)).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["setting 1", "setting 0"]


FORMULA = r"$\frac$ and $x$"  # Matplotlib would read it, and fail


def in_formulas():
    """The answers about a task whose every entry is called a formula."""
    known = copy.copy(analysis_of_embeddings())
    known.__dict__["spec"] = Spec(
        Observation((2,), names=(FORMULA,) * 2), Box((0.0,), (1.0,), (FORMULA,))
    )
    return known


def one_setting():
    columns = {"env_steps": np.ones(2), "last_100k_steps": np.ones(2)}
    return Summary(RunConfig(algo={"name": "mopg"}), columns)


NAMED = {
    "figure5": lambda: find("figure5").draw(in_formulas()),
    "projection": lambda: find("projection").draw(in_formulas()),
    "learning_curve": lambda: learning_curve(run_of(2, "").metrics, FORMULA, "mopg"),
    "figure6": lambda: find("figure6").draw(run_of(2, FORMULA)),
    "figure8": lambda: find("figure8").draw([run_of(2, FORMULA)]),
    "sweep": lambda: ranking({FORMULA: one_setting()}, FORMULA, "mopg"),
}


@pytest.mark.parametrize("name", NAMED)
def test_names_are_drawn_as_they_stand(name):
    assert any(FORMULA in text.replace(r"\$", "$") for text in texts(NAMED[name]()))
