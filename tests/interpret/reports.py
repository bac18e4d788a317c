"""Reports of runs that nobody trained."""

import numpy as np


def made_up(random, reports=150, seeds=3, options=2):
    """Return metrics as `read_metrics` gives them, of reports of 2048 steps."""
    shape = (seeds, reports)
    episodes = random.integers(0, 4, shape).astype(float)
    returns = np.where(episodes > 0, random.normal(100, 30, shape), np.nan)
    metrics = {
        "env_steps": np.tile(2048.0 * np.arange(1, reports + 1), (seeds, 1)),
        "episodes": episodes,
        "episode_return": returns,
        "steps_per_second": np.full(shape, 1000.0),
    }
    for k in range(options):
        metrics[f"option_steps_{k}"] = random.integers(1, 2000, shape).astype(float)
        metrics[f"option_activations_{k}"] = random.integers(1, 50, shape).astype(float)
    return metrics
