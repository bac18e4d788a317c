"""Do the options matter? The answer in sentences, from episodes with other choices of options.

Every sentence rests on pairs of episodes: two that start in the same state, in which only the
choice of options differs.
"""

import math

from hitmdp_jax.interpret.interventions import UNIFORM, Effects, Interventions, effects

NEGLIGIBLE = 0.05  # of the return: a difference is called none if all of its interval is less
MOST_EPISODES = 1024  # that a reader is asked to record


def verdict(interventions: Interventions) -> list[str]:
    """Return the answers about the options: whether choosing matters, then whether one is enough.

    Args:
      interventions: of a policy with several options.
    """
    found = effects(interventions)
    uniform = interventions.names.index(UNIFORM)
    first = len(interventions.names) - interventions.num_options
    best = first + int(found.mean[first:].argmax())
    return [
        _of_choosing(found, uniform, interventions.returns.shape[1]),
        _of_one_option(found, best, interventions.names[best]),
    ]


def episodes_needed(interventions: Interventions) -> int | None:
    """Return how many episodes should tell whether choosing matters; None where these do.

    The half-width of an interval falls with the square root of the number of episodes.
    """
    found = effects(interventions)
    i, episodes = interventions.names.index(UNIFORM), interventions.returns.shape[1]
    if _size(found, i) != "unclear":
        return None
    width = found.half_width[i] / (NEGLIGIBLE * abs(found.mean[0]))
    if not math.isfinite(width):
        return 2 * episodes
    needed = 2 ** math.ceil(math.log2(max(episodes * width**2, 2 * episodes)))
    return min(needed, MOST_EPISODES)


def _of_choosing(found: Effects, i: int, episodes: int) -> str:
    change = _told(found, i)
    count = "One episode" if episodes == 1 else f"{episodes} episodes"
    match _size(found, i):
        case "less":
            return (
                "Choosing between the options matters. When options are chosen at random, the "
                f"same policy returns less: {change}."
            )
        case "more":
            return (
                "The master policy chooses worse than chance. When options are chosen at random, "
                f"the same policy returns more: {change}."
            )
        case "none":
            return (
                "Choosing between the options makes no difference here. When options are chosen "
                f"at random, the same policy returns as much: {change}."
            )
    return (
        f"{count} cannot tell whether choosing between the options matters. When "
        f"options are chosen at random, the change of the return is {change}."
    )


def _of_one_option(found: Effects, i: int, name: str) -> str:
    change = _told(found, i)
    match _size(found, i):
        case "less":
            return (
                f"No single option does as well. The best of them, {name}, falls short: {change}."
            )
        case "more":
            return f"A single option does better. It is {name}, kept throughout: {change}."
        case "none":
            return f"A single option does as well. It is {name}, kept throughout: {change}."
    return f"It is not known whether a single option does as well. For the best, {name}: {change}."


def _size(found: Effects, i: int) -> str:
    """Return the kind of difference between row i and the policy's own choices.

    "none" where all of the difference's interval is negligible; else "less" or "more" where the
    interval excludes zero, and "unclear" where it holds zero.
    """
    difference, half, scale = found.difference[i], found.half_width[i], abs(found.mean[0])
    if math.isnan(half):
        return "unclear"
    if abs(difference) + half <= NEGLIGIBLE * scale:
        return "none"
    if abs(difference) <= half:
        return "unclear"
    return "less" if difference < 0 else "more"


def _told(found: Effects, i: int) -> str:
    """Return a difference, its interval, and its share of the return."""
    difference, half, scale = found.difference[i], found.half_width[i], abs(found.mean[0])
    if math.isnan(half):
        return f"{difference:+,.1f} in a single episode"
    share = f", {abs(difference) / scale:.0%} of the return" if scale else ""
    interval = f"{difference - half:+,.1f} to {difference + half:+,.1f}"
    return f"{difference:+,.1f}{share} (95% interval {interval})"
