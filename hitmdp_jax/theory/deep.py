"""Deep wide value functions: values of the last n options (App. A), exactly.

The appendix expects them to have a smaller variance "the higher the order". In a HiT-MDP they are
V-bar again: given s_t and o_{t-1}, the return does not depend on older options, because the master
policy, the action policy and the reward do not. Order n > 1 is more than order 1 only where a
policy or a reward looks further back; `algo.value_order` trains it all the same.
"""

import jax
import jax.numpy as jnp

from hitmdp_jax.theory.hit_mdp import HiTMDP, augmented_reward


def remembered(num_options: int, order: int) -> jax.Array:
    """Return the memory after each option, [K^n, K] int, for each memory of n options.

    A memory is coded as o_{t-1} + K o_{t-2} + K^2 o_{t-3} + ..., as `agents.hit_policy.remember`
    does.
    """
    memory, option = jnp.arange(num_options**order)[:, None], jnp.arange(num_options)
    return (option + num_options * memory) % num_options**order


def deep_value(hit: HiTMDP, order: int) -> jax.Array:
    """Return V[s, (o_{t-1}, ..., o_{t-n})], [S, K^n], by a linear solve over (s, memory).

    Args:
      hit: the HiT-MDP.
      order: n, at least 1; the linear system has S K^n unknowns.
    """
    num_states, num_options = hit.master.shape[0], hit.master.shape[-1]
    num_memories = num_options**order
    newest = jnp.arange(num_memories) % num_options
    step = jnp.einsum(  # P(s', o | s, memory)
        "smo,osa,sat->smto", hit.master[:, newest], hit.action, hit.transition
    )
    after = jax.nn.one_hot(remembered(num_options, order), num_memories, dtype=step.dtype)
    size = num_states * num_memories
    chain = jnp.einsum("smto,mon->smtn", step, after).reshape(size, size)
    reward = augmented_reward(hit)[:, newest].reshape(size)
    identity = jnp.eye(size, dtype=chain.dtype)
    value = jnp.linalg.solve(identity - hit.gamma * chain, reward)
    return value.reshape(num_states, num_memories)
