"""PPO as PureJaxRL has it (Lu et al. 2022), to compare ours with on gymnax's Breakout.

`python benchmarks/minatar_ppo.py --seeds 8` trains and prints the mean return of the episodes that
ended in each 200,000 steps, a column per seed. PureJaxRL is no package that could be installed, so
this is written anew after its public code (purejaxrl/ppo.py) and its settings for MinAtar. From our
PPO it differs in that it clips values in the critic's loss, standardises advantages in each
minibatch, has the entropy in the loss alone, and restarts episodes as gymnax does.
"""

import argparse
import functools
from typing import Any, NamedTuple

import distrax
import flax.linen as nn
import gymnax
import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax.training.train_state import TrainState

ENVIRONMENTS, ROLLOUT, EPOCHS, MINIBATCHES = 64, 128, 4, 8
RATE, GAMMA, LAMBDA, CLIP = 5e-3, 0.99, 0.95, 0.2
ENTROPY, VALUE, LARGEST_NORM = 0.01, 0.5, 0.5
WINDOW = 200_000  # steps


class Perceptron(nn.Module):
    """Two hidden layers of 64 units, and `size` outputs, small at first for a policy."""

    size: int
    first: float

    @nn.compact
    def __call__(self, x: jax.Array) -> jax.Array:
        """Return the outputs [..., size]."""
        for _ in range(2):
            x = nn.relu(nn.Dense(64, kernel_init=nn.initializers.orthogonal(2**0.5))(x))
        return nn.Dense(self.size, kernel_init=nn.initializers.orthogonal(self.first))(x)


class ActorCritic(nn.Module):
    """A policy and a value of their own layers."""

    actions: int

    @nn.compact
    def __call__(self, obs: jax.Array) -> tuple[Any, jax.Array]:
        """Return the policy and the value [...] of observations [..., O]."""
        policy = distrax.Categorical(logits=Perceptron(self.actions, 0.01)(obs))
        return policy, Perceptron(1, 1.0)(obs)[..., 0]


class Seen(NamedTuple):
    """A step of all environments, as the update reads it [T, B, ...]."""

    obs: jax.Array
    action: jax.Array
    log_prob: jax.Array
    value: jax.Array
    reward: jax.Array
    done: jax.Array


def train(key: jax.Array, updates: int) -> tuple[jax.Array, jax.Array]:
    """Return the summed return and the number of episodes that ended in each update's rollout."""
    env, params = gymnax.make("Breakout-MinAtar")
    network = ActorCritic(env.num_actions)
    start, first, key = jax.random.split(key, 3)
    obs, state = jax.vmap(env.reset, (0, None))(jax.random.split(start, ENVIRONMENTS), params)

    def rate(step: Any) -> Any:
        return RATE * (1.0 - step // (EPOCHS * MINIBATCHES) / updates)

    adam = optax.adam(rate, eps=1e-5)
    learner = TrainState.create(
        apply_fn=network.apply,
        params=network.init(first, flat(obs)),
        tx=optax.chain(optax.clip_by_global_norm(LARGEST_NORM), adam),
    )

    def act(carry: tuple, key: jax.Array) -> tuple[tuple, tuple]:
        learner, obs, state, total = carry
        policy, value = outputs(network, learner.params, flat(obs))
        key_act, key_step = jax.random.split(key)
        action = policy.sample(seed=key_act)
        keys = jax.random.split(key_step, ENVIRONMENTS)
        step = jax.vmap(env.step, (0, 0, 0, None))
        after, state, reward, terminated, truncated, _ = step(keys, state, action, params)
        done = terminated | truncated
        seen = Seen(flat(obs), action, policy.log_prob(action), value, reward, done)
        total = total + reward
        ended = jnp.where(done, total, 0.0).sum(), done.sum()
        return (learner, after, state, jnp.where(done, 0.0, total)), (seen, ended)

    def update(carry: tuple, key: jax.Array) -> tuple[tuple, tuple]:
        key_roll, *keys = jax.random.split(key, 1 + EPOCHS)
        carry, (seen, ended) = jax.lax.scan(act, carry, jax.random.split(key_roll, ROLLOUT))
        learner, obs, state, total = carry
        advantage = advantages(seen, outputs(network, learner.params, flat(obs))[1])
        batch = (seen, advantage, advantage + seen.value)
        batch = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), batch)
        for key in keys:  # an epoch each
            order = jax.random.permutation(key, ROLLOUT * ENVIRONMENTS).reshape(MINIBATCHES, -1)
            learner, _ = jax.lax.scan(functools.partial(descend, batch), learner, order)
        return (learner, obs, state, total), jax.tree.map(jnp.sum, ended)

    def descend(batch: tuple, learner: TrainState, chosen: jax.Array) -> tuple[TrainState, None]:
        minibatch = jax.tree.map(lambda x: x[chosen], batch)
        gradient = jax.grad(loss)(learner.params, network, *minibatch)
        return learner.apply_gradients(grads=gradient), None

    carry = learner, obs, state, jnp.zeros(ENVIRONMENTS)
    return jax.lax.scan(update, carry, jax.random.split(key, updates))[1]


def outputs(network: ActorCritic, params: Any, obs: jax.Array) -> Any:
    """Return the policy and the value [...] of observations [..., O]."""
    return network.apply(params, obs)


def flat(obs: jax.Array) -> jax.Array:
    """Return observations [B, O] of [B, ...]."""
    return obs.reshape(len(obs), -1).astype(jnp.float32)


def advantages(seen: Seen, last: jax.Array) -> jax.Array:
    """Return GAE [T, B]; an episode's end ends what counts, also at the time limit."""

    def backward(carry: tuple, step: Seen) -> tuple[tuple, jax.Array]:
        advantage, value_next = carry
        goes_on = 1.0 - step.done
        error = step.reward + GAMMA * goes_on * value_next - step.value
        advantage = error + GAMMA * LAMBDA * goes_on * advantage
        return (advantage, step.value), advantage

    return jax.lax.scan(backward, (jnp.zeros_like(last), last), seen, reverse=True)[1]


def loss(
    params: Any, network: ActorCritic, seen: Seen, advantage: jax.Array, target: jax.Array
) -> jax.Array:
    """Return PPO's loss of a minibatch [N]."""
    policy, value = outputs(network, params, seen.obs)
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    ratio = jnp.exp(policy.log_prob(seen.action) - seen.log_prob)
    clipped = jnp.clip(ratio, 1.0 - CLIP, 1.0 + CLIP)
    surrogate = jnp.minimum(ratio * advantage, clipped * advantage).mean()
    near = seen.value + jnp.clip(value - seen.value, -CLIP, CLIP)
    error = jnp.maximum((value - target) ** 2, (near - target) ** 2).mean() / 2
    return VALUE * error - surrogate - ENTROPY * policy.entropy().mean()


def main() -> None:
    """Train, and print a line for each window of steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--steps", type=int, default=2_000_000)
    arguments = parser.parse_args()
    updates = arguments.steps // (ENVIRONMENTS * ROLLOUT)
    keys = jax.random.split(jax.random.key(0), arguments.seeds)
    run = jax.jit(jax.vmap(functools.partial(train, updates=updates)))
    total, ended = map(np.asarray, jax.block_until_ready(run(keys)))  # [R, updates]
    steps = (1 + np.arange(updates)) * ENVIRONMENTS * ROLLOUT
    for end in range(WINDOW, arguments.steps + 1, WINDOW):
        window = (steps > end - WINDOW) & (steps <= end)
        returns = total[:, window].sum(1) / ended[:, window].sum(1)
        print(f"{end:>10,}", *(f"{x:6.1f}" for x in returns), f"  mean {returns.mean():.1f}")


if __name__ == "__main__":
    main()
