"""A small rollout with both kinds of ends, and networks whose options differ."""

import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.learning.options import OptionMemory
from hitmdp_jax.learning.rollout import Batch

T, B, O, A, K = 5, 3, 4, 2, 4  # noqa: E741


def random_params(agent, key):
    """Return parameters with which options differ by more than rounding."""
    return add_noise(agent.init(key, O, A).params, key)


@jax.jit
def add_noise(params, key):
    return jax.tree.map(lambda x: x + 0.3 * jax.random.normal(key, x.shape), params)


@jax.jit
def random_batch(key):
    """Return a rollout [T, B]: environment 0 terminates at 2, environment 1 is cut off at 1."""
    keys = jax.random.split(key, 5)
    option = jax.random.randint(keys[0], (T, B), 0, K)
    first = jax.random.randint(keys[1], (1, B), 0, K)
    obs = jax.random.normal(keys[2], (T + 1, B, O))
    terminated = jnp.zeros((T, B), bool).at[2, 0].set(True)
    truncated = jnp.zeros((T, B), bool).at[1, 1].set(True)
    started = jnp.roll(terminated | truncated, 1, axis=0)
    return Batch(
        obs=obs[:-1],
        next_obs=obs[1:],
        action=jax.random.normal(keys[3], (T, B, A)),
        memory=OptionMemory(jnp.concatenate([first, option[:-1]]), started),
        record=option,
        reward=jax.random.normal(keys[4], (T, B)),
        terminated=terminated,
        truncated=truncated,
        started=started,
    )


def flatten(data):
    """Return data [T, B, ...] as the samples [T * B, ...] of one minibatch."""
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data)


@jax.jit
def option_probabilities(heads, previous, initial):
    """Return P(o_t | s_t, o_{t-1}) [K] of one state's heads, summing over the stop b_t."""
    master, stop = jnp.exp(heads.log_master), jax.nn.sigmoid(heads.termination[previous])
    stop = jnp.where(initial, 1.0, stop)
    return (1 - stop) * jnp.eye(K)[previous] + stop * master


@jax.jit
def log_density(params, heads, option, action):
    """Return log pi_o(a | s) of one state's heads, straight from the normal density."""
    std = jnp.log1p(jnp.exp(params["rho"][option]))
    return jax.scipy.stats.norm.logpdf(action, heads.mean[option], std).sum()


def assert_ascends(loss, objective, params, data):
    """A minibatch's loss falls along the gradient of the mean of `objective(params, sample)`."""

    def mean_objective(params):
        return jax.vmap(lambda sample: objective(params, sample))(data).mean()

    descent = jax.jit(jax.grad(lambda params: -loss(params, data)[0]))(params)
    ascent = jax.jit(jax.grad(mean_objective))(params)
    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), descent, ascent
    )
