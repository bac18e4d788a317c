"""Every answer about policies of each kind, and every figure of them."""

import copy
import functools
import io
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from hitmdp_jax.agents import DAC, MOPG, PPO
from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments.sweeps import SettingResult, sweep_figure
from hitmdp_jax.figures import choices, embeddings, options_in_time
from hitmdp_jax.figures.curves import learning_curve
from hitmdp_jax.figures.style import option_color
from hitmdp_jax.interpret.names import Names
from hitmdp_jax.interpret.option_analysis import OptionAnalysis
from hitmdp_jax.learning.normalization import initial_statistics
from hitmdp_jax.runs.policy import Policy
from tests.interpret.known_returns import Payment

EMBEDDINGS = ("figure5", "figure12", "figure13", "figure14")
EPISODES = {
    "figure7": options_in_time.figure7,
    "figure10": options_in_time.figure10,
    "causal": choices.causal_figure,
    "transitions": choices.transitions_figure,
    "choices": choices.choices_figure,
    "divergence": choices.divergence_figure,
    "projection": choices.projection_figure,
}


def analysis_of(agent):
    params = jax.jit(lambda key: agent.init(key, 2, 1).params)(jax.random.key(0))
    return OptionAnalysis(
        Policy(agent, params, initial_statistics(2)), Payment(), jax.random.key(1), 3
    )


def drawn(figure):
    """Draw a figure; return the letters in it."""
    figure.savefig(io.BytesIO(), format="svg")
    texts = [text for axes in figure.axes for text in axes.texts]
    ticks = [t for axes in figure.axes for t in axes.get_xticklabels() + axes.get_yticklabels()]
    titles = [axes.get_title(where) for axes in figure.axes for where in ("left", "center")]
    return [*titles, *(text.get_text() for text in texts + ticks)]


@functools.cache
def analysis_of_embeddings(num_options):
    """Of MOPG: what was found once is known to every test, and to those of reports."""
    return analysis_of(MOPG(num_options=num_options, embedding_size=5, hidden_sizes=(8,)))


@pytest.fixture(params=[1, 9])
def embedded(request):
    return analysis_of_embeddings(request.param)


@pytest.fixture(scope="module")
def terminating():
    return analysis_of(DAC(num_options=3, hidden_sizes=(8,)))


def test_every_answer_is_an_array_of_its_shape(embedded):
    k, states = embedded.num_options, 3 * Payment.episode_length
    assert embedded.usage.sum() == pytest.approx(1.0)
    assert embedded.usage[embedded.by_usage[0]] == embedded.usage.max()
    assert embedded.durations.shape == (3, k)
    assert embedded.transitions.shape == embedded.divergence.shape == (k, k)
    assert embedded.interventions.returns.shape == (4 + k, 3)
    assert embedded.embeddings.shape == (k, 5)
    assert embedded.perturbation.actions.shape == (k, 5, 21, 1)
    assert embedded.attention.shape == (states, k)
    np.testing.assert_allclose(embedded.attention.sum(axis=1), 1.0, rtol=1e-5)
    assert embedded.projection.points.shape == (states, 2)
    assert embedded.terminations is None
    assert embedded.names.actuators == ("action[0]",)


def test_choices_are_what_the_transitions_were_drawn_with(embedded):
    """The mean of P(o_t | s_t, o_{t-1}) over the steps after each option, by a plain loop."""
    recorded, k = embedded.trajectories, embedded.num_options
    after = {i: [] for i in range(k)}
    for n in range(3):
        for t in range(1, Payment.episode_length):
            after[int(recorded.option[t - 1, n])].append(recorded.option_probs[t, n])
    expected = [np.mean(after[i], axis=0) if after[i] else np.full(k, np.nan) for i in range(k)]
    np.testing.assert_allclose(embedded.choices, expected, rtol=1e-5)
    np.testing.assert_array_equal(np.isnan(embedded.choices), np.isnan(embedded.transitions))


def limits(figure):
    return {image.get_clim() for axes in figure.axes for image in axes.images}


@pytest.mark.parametrize(("size", "limit"), [(0.0015, 1.0), (0.48, 1.0), (48.0, 48.0)])
def test_options_that_hardly_differ_look_it(size, limit):
    known = SimpleNamespace(divergence=size * (1.0 - np.eye(2)), num_options=2)
    figure = choices.divergence_figure(known)
    assert limits(figure) == {(0.0, limit)}
    said = figure.get_suptitle()
    assert said.startswith("The options are practically identical") == (size < 0.01)


@pytest.mark.parametrize("name", ["figure5", "figure13", "figure14"])
def test_all_changes_of_actions_have_one_scale(name, embedded):
    """An untrained policy's embeddings move nothing: no colour may say that they do."""
    found = embedded.perturbation
    assert found.negligible
    figure = getattr(embeddings, name)(embedded)
    most = np.abs(embedded.embeddings).max()
    changes = limits(figure) - {(-most, most)}
    assert changes == {(-found.limit, found.limit)}
    assert found.limit == found.noise.max() > 100 * np.abs(found.moved).max()
    assert "practically nothing" in " ".join(
        part.get_supxlabel() for part in (figure, *figure.subfigs)
    ).replace("\n", " ")


def test_an_answer_is_computed_once(embedded):
    assert embedded.trajectories is embedded.trajectories
    assert embedded.interventions is embedded.interventions


def test_options_without_embeddings_have_the_rest(terminating):
    assert terminating.embeddings is terminating.perturbation is terminating.attention is None
    assert terminating.terminations.shape == (3 * Payment.episode_length, 3)
    assert terminating.interventions.returns.shape == (7, 3)


@pytest.mark.parametrize("name", EMBEDDINGS)
def test_figures_of_embeddings(name, embedded):
    text = drawn(getattr(embeddings, name)(embedded))
    assert any("embeddings W" in x for x in text) == (name == "figure12")  # figure5's is above all
    assert ("action[0]" in text) == (name != "figure12")


@pytest.mark.parametrize("name", EPISODES)
def test_figures_of_episodes(name, embedded):
    text = drawn(EPISODES[name](embedded))
    labels = "option 0" if name == "causal" else str(embedded.by_usage[0])
    assert labels in text


def test_attention_and_terminations_are_drawn_where_there_are_any(embedded, terminating):
    assert "0" in drawn(choices.attention_figure(embedded))
    assert "2" in drawn(choices.terminations_figure(terminating))
    with pytest.raises(UsageError, match="DAC has no attention"):
        choices.attention_figure(terminating)
    with pytest.raises(UsageError, match="MOPG has no termination functions"):
        choices.terminations_figure(embedded)


@pytest.mark.parametrize("name", EMBEDDINGS)
def test_what_has_no_embeddings_says_so(name, terminating):
    with pytest.raises(UsageError, match=f"{name} shows option embeddings, and DAC has none"):
        getattr(embeddings, name)(terminating)


def test_one_dimension_is_chosen_or_the_strongest(embedded):
    slopes, option = embedded.perturbation.slopes, embedded.by_usage[0]
    strongest = np.abs(slopes[option]).max(axis=1).argmax()
    text = drawn(embeddings.figure13(embedded))
    assert f"dimension {strongest} of option {option}" in text
    text = drawn(embeddings.figure13(embedded, 0, 2))
    assert "dimension 2 of option 0" in text
    assert f"{slopes[0, 2, 0]:+z.3f}" in text
    with pytest.raises(UsageError, match="dimension = 5 must be a whole number from 0 to 4"):
        embeddings.figure13(embedded, 0, 5)


def test_sequences_show_every_activation(embedded):
    figure = options_in_time.figure7(embedded)
    for axes, episode in zip(figure.axes, embedded.activations, strict=True):
        bars = [path.get_extents() for lane in axes.collections for path in lane.get_paths()]
        assert sorted((round(b.x0), round(b.width)) for b in bars) == sorted(
            zip(episode.start.tolist(), episode.duration.tolist(), strict=True)
        )


def test_a_film_stands_over_the_steps_that_it_shows(embedded):
    """Seven steps, and a picture of the middle of each half of them."""
    pictures = {1: np.zeros((4, 6, 3)), 5: np.ones((4, 6, 3))}
    figure = options_in_time.figure10(embedded, 1, pictures)
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
    assert colors == [option_color(k) for k in embedded.trajectories.option[[1, 5], 1]]
    assert [line.get_xdata()[0] for line in lanes.lines] == [1, 5]


def test_an_episode_that_was_not_recorded_is_refused(embedded):
    with pytest.raises(UsageError, match="episode = 3 must be a whole number from 0 to 2"):
        options_in_time.figure10(embedded, 3)


def test_a_policy_without_options_is_refused():
    with pytest.raises(UsageError, match=r"PPO has no options to look into\."):
        analysis_of(PPO(hidden_sizes=(8,)))


def metrics_of(num_options):
    steps = 2048 * np.arange(1, 31)[None]
    metrics = {"env_steps": steps, "episode_return": steps}
    for k in range(num_options):
        metrics |= {f"option_steps_{k}": steps, f"option_activations_{k}": steps / (k + 2)}
    return metrics


FORMULA = r"$\frac$ and $x$"  # Matplotlib would read it, and fail


def named(known, name):
    """The same answers about a task whose every entry has a name."""
    other = copy.copy(known)
    other.__dict__["names"] = Names((name,) * len(known.names.observations), (name,))
    return other


NAMED = {
    "figure5": lambda known: embeddings.figure5(named(known, FORMULA)),
    "projection": lambda known: choices.projection_figure(named(known, FORMULA)),
    "learning_curve": lambda _: learning_curve(metrics_of(2), FORMULA, "mopg"),
    "figure6": lambda _: options_in_time.figure6(metrics_of(2), FORMULA),
    "figure8": lambda _: options_in_time.figure8({FORMULA: metrics_of(2)}, {FORMULA: None}),
    "sweep": lambda _: sweep_figure(
        [SettingResult(0, {FORMULA: 0.9}, np.ones(2), "all steps")], FORMULA, "mopg"
    ),
}


@pytest.mark.parametrize("name", NAMED)
def test_names_are_drawn_as_they_stand(name):
    figure = NAMED[name](analysis_of_embeddings(1))
    drawn(figure)
    texts = [text.get_text() for text in figure.findobj(Text)]
    assert any(FORMULA in text.replace(r"\$", "$") for text in texts)


def test_durations_of_several_runs_stand_side_by_side():
    figure = options_in_time.figure8(
        {"mopg": metrics_of(4), "dac": metrics_of(2)}, {"mopg": None, "dac": None}
    )
    assert {"mopg", "dac"} <= set(drawn(figure))
    last = [line.get_ydata()[-1] for line in figure.axes[1].lines if len(line.get_ydata())]
    assert last == [2.0, 3.0]


@pytest.mark.parametrize(
    ("metrics", "sentence"),
    [({}, "The run a has no iteration yet"), (metrics_of(0), "The run a has no options")],
)
def test_runs_without_durations_say_so(metrics, sentence):
    with pytest.raises(UsageError, match=sentence):
        options_in_time.figure6(metrics, "a")
    with pytest.raises(UsageError, match=sentence):
        options_in_time.figure8({"a": metrics}, {"a": None})
