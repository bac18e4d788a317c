"""Gradient descent over one rollout, whole or in minibatches."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax

from hitmdp_jax.mesh import over_data

Loss = Callable[[Any, Any], tuple[jax.Array, dict[str, jax.Array]]]


def adam(
    learning_rate: jax.Array | float, max_grad_norm: jax.Array | float, eps: jax.Array | float
) -> optax.GradientTransformation:
    """Return Adam behind a global gradient-norm clip, run on one flat vector.

    A network of 25 small arrays costs 25 times the dispatch of one; flattened, the optimiser's
    share of an update falls from half to a tenth. The hyperparameters may be traced.
    """
    clip = optax.clip_by_global_norm(max_grad_norm)
    return optax.flatten(optax.chain(clip, optax.adam(learning_rate, eps=eps)))


def adapted_share(share: jax.Array, kl: jax.Array, target_kl: jax.Array | float) -> jax.Array:
    """Return the share of the learning rate, at most 1, to go on with after an update.

    It follows (target_kl / kl)^(1/5): a KL that grows with the square of the rate comes to its
    target within ten updates, and the noise of one update moves the rate little. The KL of steps of
    one size grows as a Gaussian policy grows narrow, until updates undo what they have learned.

    Args:
      share: that of the update.
      kl: nats, how far the update moved the policy.
      target_kl: nats; infinity keeps the whole rate.
    """
    step = (target_kl / jnp.maximum(kl, jnp.finfo(kl.dtype).tiny)) ** 0.2
    return jnp.minimum(share * jnp.clip(step, 0.5, 2.0), 1.0)


def gradient_step(
    loss: Loss, optimizer: optax.GradientTransformation, params: Any, opt_state: Any, data: Any
) -> tuple[Any, Any, dict[str, jax.Array]]:
    """Take one step on all the data.

    Returns:
      The new params and optimiser state, and the loss's diagnostics with the `loss` itself.
    """
    (value, diagnostics), grads = jax.value_and_grad(loss, has_aux=True)(params, data)
    updates, opt_state = optimizer.update(grads, opt_state, params)
    return optax.apply_updates(params, updates), opt_state, diagnostics | {"loss": value}


def minibatch_epochs(
    loss: Loss,
    optimizer: optax.GradientTransformation,
    params: Any,
    opt_state: Any,
    data: Any,
    key: jax.Array,
    *,
    num_epochs: int,
    minibatch_size: int,
) -> tuple[Any, Any, dict[str, jax.Array]]:
    """Run several epochs of minibatch steps, each epoch over a new permutation of the samples.

    Args:
      loss: maps (params, minibatch) to a scalar and a dictionary of scalar diagnostics.
      optimizer: takes the gradients.
      params: the pytree that is trained.
      opt_state: the optimiser's state.
      data: pytree of arrays [N, ...]; N is a multiple of minibatch_size.
      key: PRNG key of the permutations.
      num_epochs: passes over the data.
      minibatch_size: samples a step.

    Returns:
      The new params and optimiser state, and the diagnostics, the `loss` among them, averaged over
      all steps.
    """
    num_samples = len(jax.tree.leaves(data)[0])

    def step(carry: tuple[Any, Any], minibatch: Any):
        params, opt_state, diagnostics = gradient_step(loss, optimizer, *carry, minibatch)
        return (params, opt_state), diagnostics

    def epoch(carry: tuple[Any, Any], key: jax.Array):
        order = jax.random.permutation(key, num_samples).reshape(-1, minibatch_size)
        # One gather an epoch: minibatches are slices of what it has laid out.
        minibatches = over_data(jax.tree.map(lambda x: x[order], data), axis=1)
        return jax.lax.scan(step, carry, minibatches)

    (params, opt_state), diagnostics = jax.lax.scan(
        epoch, (params, opt_state), jax.random.split(key, num_epochs)
    )
    return params, opt_state, jax.tree.map(jnp.mean, diagnostics)
