"""A small rollout with both kinds of ends, and networks whose options differ."""

import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.learning.options import OptionMemory
from hitmdp_jax.learning.rollout import Batch
from tests.probes import spec_of_sizes
from tests.programs import compiled

T, B, O, A, K = 5, 3, 4, 2, 4  # noqa: E741


SMALL = {"hidden_sizes": (8,), "spec": spec_of_sizes(O, A)}  # compiles faster than the default


def random_params(agent):
    """Return parameters with which options differ by more than rounding."""
    random = np.random.default_rng(0)
    shapes = jax.eval_shape(lambda key: agent.init(key, agent.spec).params, jax.random.key(0))
    return jax.tree.map(lambda x: random.normal(scale=0.4, size=x.shape).astype(x.dtype), shapes)


def random_batch():
    """Return a rollout [T, B]: environment 0 terminates at 2, environment 1 is cut off at 1."""
    random = np.random.default_rng(0)
    option = random.integers(K, size=(T + 1, B), dtype=np.int32)
    obs = normal(random, T + 1, B, O)
    terminated, truncated = np.zeros((2, T, B), bool)
    terminated[2, 0] = truncated[1, 1] = True
    started = np.roll(terminated | truncated, 1, axis=0)
    return Batch(
        obs=obs[:-1],
        next_obs=obs[1:],
        action=normal(random, T, B, A),
        memory=OptionMemory(option[:-1], started),
        record=option[1:],
        reward=normal(random, T, B),
        terminated=terminated,
        truncated=truncated,
        started=started,
    )


def normal(random, *shape):
    """Draw standard normal numbers in the precision that agents compute in."""
    return random.normal(size=shape).astype(np.float32)


def flatten(data):
    """Return data [T, B, ...] as the samples [T * B, ...] of one minibatch."""
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data)


@compiled
def option_probabilities(heads, previous, initial):
    """Return P(o_t | s_t, o_{t-1}) [K] of one state's heads, summing over the stop b_t."""
    master, stop = jnp.exp(heads.log_master), jax.nn.sigmoid(heads.termination[previous])
    stop = jnp.where(initial, 1.0, stop)
    return (1 - stop) * jnp.eye(K)[previous] + stop * master


@compiled
def log_density(params, heads, option, action):
    """Return log pi_o(a | s) of one state's heads, straight from the normal density."""
    std = jnp.log1p(jnp.exp(params["rho"][option]))
    return jax.scipy.stats.norm.logpdf(action, heads.action[option], std).sum()


def assert_ascends(loss, objective, params, data):
    """A minibatch's loss falls along the gradient of the mean of `objective(params, sample)`."""

    def mean_objective(params):
        return jax.vmap(lambda sample: objective(params, sample))(data).mean()

    @jax.jit
    def gradients(params):
        descent = jax.grad(lambda params: -loss(params, data)[0])(params)
        return descent, jax.grad(mean_objective)(params)

    jax.tree.map(
        lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-3, atol=1e-4), *gradients(params)
    )
