"""What the options did in a rollout: usage and durations."""

import jax
import numpy as np


def option_statistics(
    option: jax.Array, previous: jax.Array, started: jax.Array, num_options: int
) -> dict[str, jax.Array]:
    """Count each option's steps and activations in a rollout.

    An activation is a step that starts an episode or takes another option than the step before.
    Steps over activations is an option's mean duration; both are sums, so that durations over any
    window of iterations follow by adding up.

    Args:
      option: [T, B] int, o_t.
      previous: [T, B] int, o_{t-1}.
      started: [T, B] bool, the first step of an episode.
      num_options: K.

    Returns:
      `option_steps` [K] and `option_activations` [K], float counts.
    """
    one_hot = jax.nn.one_hot(option, num_options)
    activated = started | (option != previous)
    return {
        "option_steps": one_hot.sum(axis=(0, 1)),
        "option_activations": (one_hot * activated[..., None]).sum(axis=(0, 1)),
    }


def mean_duration(steps: np.ndarray, activations: np.ndarray) -> np.ndarray:
    """Return mean option duration in steps, from summed counts.

    An option that ran on throughout counts as activated once; the duration of one that never ran is
    NaN.
    """
    return np.where(steps > 0, steps / np.maximum(activations, 1.0), np.nan)
