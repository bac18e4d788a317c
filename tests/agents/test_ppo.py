import jax
import jax.numpy as jnp
import numpy as np

from hitmdp_jax.agents import PPO
from tests.agents.option_batches import normal
from tests.probes import spec_of_sizes


def test_loss_at_the_old_policy_is_by_hand(key):
    agent, random = PPO(spec=spec_of_sizes(3, 2)), np.random.default_rng(0)
    obs, action = normal(random, 4, 3), normal(random, 4, 2)

    @jax.jit
    def evaluate(key):
        params = agent.init(key, agent.spec).params
        policy, value, _ = agent.heads(params, obs)
        data = {
            "obs": obs,
            "action": action,
            "log_prob": policy.log_prob(action),
            "advantage": jnp.array([1.0, 2.0, -1.0, 4.0]),
            "value_target": value + 2.0,
            "entropy_weight": jnp.full(4, 0.1),
        }
        return agent.loss(params, data)

    loss, metrics = evaluate(key)
    # ratio 1: the surrogate is the mean advantage 1.5; half the squared error is 2.
    entropy = 2 * (-0.5 + 0.5 * np.log(2 * np.pi * np.e))
    np.testing.assert_allclose(loss, 2.0 - 1.5 - 0.1 * entropy, rtol=1e-5)
    np.testing.assert_allclose(metrics["action_clip_fraction"], 0.0)


def test_remembers_nothing(key):
    assert jax.tree.leaves(PPO().initial_memory(key, (3,))) == []


def test_the_explained_variance_is_that_of_the_targets():
    """A perfect critic explains all of it, a constant one nothing, whatever the constant."""
    agent = PPO()
    target = jnp.array([1.0, 2.0, 5.0, -1.0])
    params, data = {"critic": {"scale": jnp.ones(())}}, {"value_target": target}
    for value, explained in ((target, 1.0), (jnp.full(4, 9.0), 0.0), (target / 2, 0.75)):
        _, metrics = agent.value_loss(params, value, data)
        np.testing.assert_allclose(metrics["explained_variance"], explained, atol=1e-6)
