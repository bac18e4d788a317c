"""Hyperparameters that change over a run, by Optax's schedules."""

import jax
import jax.numpy as jnp
import optax

# name -> the share of the initial value, 1 to 0, after a fraction 0 to 1 of the run
SCHEDULES: dict[str, optax.Schedule] = {
    "constant": optax.constant_schedule(1.0),
    "linear": optax.linear_schedule(1.0, 0.0, transition_steps=1),
    "cosine": optax.cosine_decay_schedule(1.0, decay_steps=1),
}


def anneal(
    schedule: str, initial: jax.Array | float, final: jax.Array | float, progress: jax.Array
) -> jax.Array:
    """Return a value between `initial` and `final` after a fraction `progress` of the run.

    Both ends may be traced, so that schedules can be swept; "constant" stays at `initial`.
    """
    share = jnp.asarray(SCHEDULES[schedule](progress))
    return final + share * (initial - final)
