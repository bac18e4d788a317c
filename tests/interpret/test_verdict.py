import numpy as np
import pytest

from hitmdp_jax.interpret.interventions import Interventions
from hitmdp_jax.interpret.verdict import MOST_EPISODES, episodes_needed, verdict

NAMES = (
    "own choices",
    "own, shuffled",
    "uniform choices",
    "uniform, held",
    "first choice",
    "option 0",
    "option 1",
)
OWN = np.array([90.0, 110.0, 100.0, 100.0, 95.0, 105.0])  # of six states
NOISE = np.array([1.0, -1.0, 2.0, -2.0, 0.5, -0.5])


def episodes(uniform, first, second, noise=NOISE):
    """Episodes in which random choices and each option alone change the return by so much."""
    changes = [0.0, 0.0, uniform, 0.0, 0.0, first, second]
    rows = [OWN + change + noise * (i > 0) for i, change in enumerate(changes)]
    return Interventions(NAMES, np.array(rows), np.full((7, 6), 50))


# The noise's standard deviation is 1.45 and t of five degrees of freedom 2.571: +-1.5 of 100.
@pytest.mark.parametrize(
    ("uniform", "said"),
    [
        (-20.0, "Choosing between the options matters."),
        (20.0, "The master policy chooses worse than chance."),
        (-2.0, "makes no difference here"),
        (0.0, "makes no difference here"),
        (-6.0, "Choosing between the options matters."),
    ],
)
def test_what_random_choices_cost_is_said(uniform, said):
    sentence = verdict(episodes(uniform, -50.0, -50.0))[0]
    assert said in sentence
    assert f"{uniform:+,.1f}, {abs(uniform) / 100:.0%} of the return" in sentence
    assert f"(95% interval {uniform - 1.5:+,.1f} to {uniform + 1.5:+,.1f})" in sentence


@pytest.mark.parametrize(
    ("alone", "said"),
    [
        ((-20.0, -30.0), "No single option does as well. The best of them, option 0, falls short"),
        ((-20.0, 1.0), "A single option does as well. It is option 1"),
        ((25.0, 1.0), "A single option does better. It is option 0"),
    ],
)
def test_the_best_single_option_is_said(alone, said):
    assert said in verdict(episodes(-20.0, *alone))[1]


def test_wide_intervals_are_no_proof_that_there_is_no_difference():
    """An absence of evidence says how many episodes would be evidence."""
    unclear = episodes(-4.0, -4.0, -4.0, noise=10 * NOISE)
    choosing, alone = verdict(unclear)
    assert choosing.startswith("6 episodes cannot tell")
    assert alone.startswith("It is not known")
    # Half the width is 15.2, and 5 is wanted: 6 * (15.2 / 5)^2 = 55 episodes, told as 64.
    assert episodes_needed(unclear) == 64
    assert episodes_needed(episodes(-4.0, 0.0, 0.0, noise=1000 * NOISE)) == MOST_EPISODES


@pytest.mark.parametrize("uniform", [-20.0, 0.0, 20.0])
def test_what_is_clear_needs_no_more_episodes(uniform):
    assert episodes_needed(episodes(uniform, 0.0, 0.0)) is None


def test_a_single_episode_tells_nothing():
    found = episodes(-20.0, -20.0, -20.0)
    one = Interventions(NAMES, found.returns[:, :1], found.lengths[:, :1])
    assert verdict(one)[0].startswith("One episode cannot tell")
    assert "in a single episode" in verdict(one)[0]
    assert episodes_needed(one) == 2
