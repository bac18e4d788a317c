"""Colours: what contrast they have, who tells them apart, and that each name keeps its own."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_hex, to_rgb

from hitmdp_jax.agents import AGENTS
from hitmdp_jax.cli.published import read_cells
from hitmdp_jax.experiments import experiment
from hitmdp_jax.experiments.results_figure import figure
from hitmdp_jax.experiments.results_page import shown as shown_of
from hitmdp_jax.figures import scores
from hitmdp_jax.figures.curves import learning_curve
from hitmdp_jax.figures.style import ALGORITHMS, OWN, PALETTE, option_color, shades, styles
from hitmdp_jax.figures.sweeps import ranking
from hitmdp_jax.interpret.summary import Summary
from hitmdp_jax.report.interactive import learning_curves
from hitmdp_jax.runs.config import RunConfig
from tests.cli.conftest import CHECKOUT

# What is seen without the green, or the red, cones: Machado et al. (2009), of linear RGB.
VISIONS = {
    "normal": np.eye(3),
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
WHITE = np.array([0.95047, 1.0, 1.08883])


def linear(color):
    """sRGB's components as amounts of light."""
    x = np.array(to_rgb(color))
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def contrast_on_white(color):
    """The contrast of WCAG 2, from 1 to 21."""
    return 1.05 / (linear(color) @ TO_XYZ[1] + 0.05)


def lab(color, vision):
    """CIELAB, in which a distance of 2 is just seen, of a colour as it is seen."""
    x = TO_XYZ @ np.clip(np.asarray(vision) @ linear(color), 0, 1) / WHITE
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_everything_has_a_contrast_of_three_on_white():
    colors = [*map(option_color, range(100)), *shades(21), *ALGORITHMS.values(), OWN]
    assert [color for color in colors if contrast_on_white(color) < 3] == []


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize(("number", "distance"), [(4, 22), (len(PALETTE), 17)])
def test_the_palette_is_told_apart_by_every_eye(vision, number, distance):
    seen = [lab(color, VISIONS[vision]) for color in PALETTE[:number]]
    apart = [np.linalg.norm(a - b) for a, b in itertools.combinations(seen, 2)]
    assert min(apart) > distance


def test_no_two_options_have_one_colour():
    assert len({option_color(k) for k in range(100)}) == 100
    assert tuple(map(option_color, range(len(PALETTE)))) == PALETTE


def test_every_algorithm_has_a_colour_of_its_own():
    assert set(ALGORITHMS) == set(AGENTS)
    assert len({*ALGORITHMS.values(), OWN}) == len(AGENTS) + 1


ARMS = [
    {"ppo": "ppo", "mopg": "mopg"},
    {"mopg-one": "mopg", "ppo-held": "ppo", "mopg-printed": "mopg"},
    {"neither": "ppo", "target KL": "ppo", "both": "ppo", "mopg, both": "mopg", "x": "mopg"},
    {f"runs/{i}": "mopg" for i in range(30)},
    {"a.py:A": "a.py:A", "b.py:B": "b.py:B", "oc": "oc"},
    {f"gamma = {i}": "dac" for i in range(7)} | {"dac": "dac", "dac-one": "dac"},
]


@pytest.mark.parametrize("arms", ARMS, ids=lambda arms: next(iter(arms)))
def test_no_two_arms_of_a_picture_look_alike(arms):
    found = styles(arms)
    assert list(found) == list(arms)
    assert len({str(style.line) for style in found.values()}) == len(arms)
    assert len({str(style.plotly) for style in found.values()}) == len(arms)
    for arm, algorithm in arms.items():
        assert found[arm].color == ALGORITHMS.get(algorithm, OWN)


def test_an_arm_looks_the_same_whatever_stands_beside_it():
    arms = {"mopg": "mopg", "mopg-one": "mopg", "mopg-printed": "mopg", "ppo-held": "ppo"}
    together = styles(arms)
    for arm, algorithm in arms.items():
        assert styles({arm: algorithm}) == {arm: together[arm]}
        assert styles({"other": algorithm, arm: algorithm})[arm] == together[arm]


def test_ppo_has_its_colour_in_every_picture():
    """Alone, in a sweep, in published tables and on pages."""
    wanted = {ALGORITHMS["ppo"]}
    steps = np.tile(2048.0 * np.arange(1, 31), (2, 1))
    metrics = {"env_steps": steps, "episode_return": steps, "seed": np.array([[0.0], [1.0]])}
    (axes,) = learning_curve(metrics, "a run", "ppo").axes
    assert {line.get_color() for line in axes.lines} == wanted
    columns = {"env_steps": np.ones(2), "last_100k_steps": np.array([1.0, 2.0])}
    setting = Summary(RunConfig(algo={"name": "ppo"}), columns)
    (axes,) = ranking({"gamma=0.9": setting}, "a sweep", "ppo").axes
    assert {line.get_color() for line in axes.lines} == wanted
    for name in ("table1", "options"):
        read = experiment.read(name)
        drawn = figure(shown_of(read, read_cells(CHECKOUT / "results", read.tasks)))
        assert drawn is not None
        lines = [line for axes in drawn.axes for line in axes.lines]
        lines = [line for line in lines if line.get_label() in ("ppo", "ppo-held")]
        assert {to_hex(line.get_color()) for line in lines} == wanted
    looks = styles({"ppo": "ppo"})
    for drawn in (
        scores.intervals(looks, [np.arange(3.0)], [1.0], [[0.0, 2.0]]),
        scores.profiles(looks, [np.arange(3.0)]),
    ):
        assert {line.get_color() for line in drawn.axes[0].lines} == wanted
    shown = learning_curves({"ppo": metrics}, looks, {"ppo": None})
    assert {trace.line.color for trace in shown.data} == wanted
