"""The Thanksgiving turkey (App. A), solved three ways.

A camera sees a raw or a roasted turkey, never whether it is stuffed. Stuffing earns 0; roasting
ends the episode and earns 10 if the turkey is stuffed, else -10. The best policy stuffs, then
roasts: return 10.

| values of | what the values say of the raw turkey | policy learnt | return |
| --- | --- | --- | --- |
| `V[s]` | stuff 0, roast 0 | either, at random | 0 |
| `Q[s, a, a_prev]` | stuff 9 if not stuffed; roast 10 if stuffed | stuff, then roast | 10 |
| HiT-MDP, `V-bar[s, o_prev]` | 9 at the start, 10 after stuffing | stuff, then roast | 10 |

The first two are policy iteration from the uniform policy on values that bootstrap over what the
agent sees, given the states behind it in the frequencies that its own episodes have. The third is
gradient ascent (Theorems 4.2 and 4.3) on both policies of a HiT-MDP that sees only the camera.
"""

import dataclasses

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.theory.gradients import PolicyGradient, policy_gradient
from hitmdp_jax.theory.hit_mdp import (
    HiTMDP,
    hidden_values,
    objective,
    occupancy,
)
from hitmdp_jax.theory.improvement import improve
from hitmdp_jax.theory.model import as_float

PLAIN, STUFFED = 0, 1  # the raw turkey, two states in one image
STUFF, ROAST = 0, 1
GAMMA = 0.9  # makes roasting now better than stuffing again


@struct.dataclass
class TableSolution:
    """What policy iteration makes of a table of values over the agent's memory m."""

    q: jax.Array  # [M, A]
    policy: jax.Array  # [M, A]
    episode_return: jax.Array  # undiscounted, expected


@struct.dataclass
class HiddenSolution:
    """What gradient ascent makes of a HiT-MDP that sees the camera's image."""

    v_bar: jax.Array  # [K_prev] V-bar[raw, o_{t-1}]
    master: jax.Array  # [K_prev, K] P(o | raw, o_{t-1})
    action: jax.Array  # [K, A] P(a | raw, o)
    episode_return: jax.Array  # undiscounted, expected


@struct.dataclass
class Logits:
    """The parameters of softmax policies that see only the image of a raw turkey."""

    master: jax.Array  # [K_prev, K]
    action: jax.Array  # [K, A]


def dynamics() -> tuple[jax.Array, jax.Array]:
    """Return transition [2, A, 2] and reward [2, A] over plain and stuffed; roasting ends."""
    transition = jnp.zeros((2, 2, 2)).at[:, STUFF, STUFFED].set(1.0)
    reward = jnp.array([[0.0, -10.0], [0.0, 10.0]])
    return as_float(transition), as_float(reward)


def solve_with_state(num_iterations: int = 5) -> TableSolution:
    """Solve the turkey with values of what the camera sees, V[s]: it cannot be learnt."""
    return _policy_iteration(jnp.zeros(2, jnp.int32), 1, num_iterations)


def solve_with_previous_action(num_iterations: int = 5) -> TableSolution:
    """Solve the turkey with the deep wide value function Q[s, a, a_prev]: `q` is [a_prev, a].

    An episode starts with a_prev = ROAST, which is how the last turkey ended.
    """
    return _policy_iteration(jnp.array([STUFF, ROAST]), 2, num_iterations)


def camera_hit_mdp(logits: Logits, gamma: float = GAMMA) -> HiTMDP:
    """Return the HiT-MDP over plain and stuffed turkeys whose policies cannot tell them apart."""
    transition, reward = dynamics()
    master, action = jax.nn.softmax(logits.master), jax.nn.softmax(logits.action)
    return HiTMDP(
        transition=transition,
        reward=reward,
        master=jnp.broadcast_to(master, (2, *master.shape)),
        action=jnp.broadcast_to(action[:, None], (len(action), 2, 2)),
        gamma=gamma,
    )


def solve_with_options(
    key: jax.Array,
    num_options: int = 4,
    num_steps: int = 2000,
    learning_rate: float = 0.5,
    uniform_start: bool = False,
) -> HiddenSolution:
    """Learn both policies of a HiT-MDP by exact gradient ascent from small random logits.

    Args:
      key: PRNG key of the initial logits.
      num_options: K. Of the keys 0 to 99, 48 found the solution with K = 2, which it needs both
        of; all did with K = 3 and with K = 4, the paper's number.
      num_steps: ascent steps.
      learning_rate: step size.
      uniform_start: draw o_{-1} uniformly instead of starting every episode with the last option.
        The option that stands for "stuffed" then also begins episodes with a plain turkey, and the
        return stays near 8.2 with K = 4.
    """
    key_master, key_action = jax.random.split(key)
    logits = Logits(
        master=0.1 * jax.random.normal(key_master, (num_options, num_options)),
        action=0.1 * jax.random.normal(key_action, (num_options, 2)),
    )
    initial = jnp.eye(num_options)[-1]
    if uniform_start:
        initial = jnp.ones(num_options) / num_options
    start = jnp.zeros((2, num_options)).at[PLAIN].set(initial)

    def policies(logits: Logits) -> PolicyGradient:
        hit = camera_hit_mdp(logits)
        return PolicyGradient(hit.master, hit.action)

    def ascend(logits: Logits, _: None) -> tuple[Logits, None]:
        pull_back = jax.vjp(policies, logits)[1]
        (direction,) = pull_back(policy_gradient(camera_hit_mdp(logits), start))
        return jax.tree.map(lambda x, d: x + learning_rate * d, logits, direction), None

    logits, _ = jax.lax.scan(ascend, logits, None, length=num_steps)
    hit = camera_hit_mdp(logits)
    undiscounted = dataclasses.replace(hit, gamma=1.0)
    seen = occupancy(undiscounted, start)  # [2, K_prev]
    v_bar = (seen * hidden_values(hit).v_bar).sum(0) / seen.sum(0)
    return HiddenSolution(v_bar, hit.master[0], hit.action[:, 0], objective(undiscounted, start))


def _policy_iteration(memory_of: jax.Array, size: int, num_iterations: int) -> TableSolution:
    """Iterate on a policy over memories; `memory_of` [A] is the memory that an action leaves."""
    transition, reward = dynamics()
    remember = jax.nn.one_hot(memory_of, size, dtype=reward.dtype)  # [A, M]
    start = jnp.zeros((2, size), reward.dtype).at[PLAIN, memory_of[ROAST]].set(1.0)

    def visits(policy: jax.Array) -> jax.Array:
        """Return how often an episode visits each turkey and memory, [2, M]."""
        chain = jnp.einsum("ma,zay,an->zmyn", policy, transition, remember)
        chain = chain.reshape(2 * size, 2 * size)
        solution = jnp.linalg.solve(jnp.eye(2 * size, dtype=chain.dtype) - chain.T, start.ravel())
        return solution.reshape(2, size)

    def as_seen(policy: jax.Array) -> HiTMDP:
        """Return the MDP over memories that an agent with this policy experiences (K = 1)."""
        seen = visits(policy)
        turkey = jnp.where(seen.sum(0) > 0, seen / seen.sum(0), 0.5)  # P(z | m)
        return HiTMDP(
            transition=jnp.einsum("zm,zay,an->man", turkey, transition, remember),
            reward=jnp.einsum("zm,za->ma", turkey, reward),
            master=jnp.ones((size, 1, 1), reward.dtype),
            action=policy[None],
            gamma=GAMMA,
        )

    def step(policy: jax.Array, _: None) -> tuple[jax.Array, None]:
        return improve(as_seen(policy)).action[0], None

    policy, _ = jax.lax.scan(
        step, jnp.full((size, 2), 0.5, reward.dtype), None, length=num_iterations
    )
    q = hidden_values(as_seen(policy)).q_action[:, 0]
    episode_return = jnp.einsum("zm,ma,za->", visits(policy), policy, reward)
    return TableSolution(q, policy, episode_return)
