"""What agents that learn by gradient steps share, and those of them that PPO's surrogate serves."""

import abc
from typing import Any, Self

import flax.linen as nn
import jax
import jax.numpy as jnp
import optax

from hitmdp_jax.agents.base import Agent, LearnerState, static, traced
from hitmdp_jax.checks import divisor_below
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.advantages import discounted_returns, generalized_advantages
from hitmdp_jax.learning.optimization import Loss, adam, minibatch_epochs
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.learning.schedules import SCHEDULES, anneal
from hitmdp_jax.learning.surrogate import clipped_surrogate
from hitmdp_jax.learning.value_scale import decay, rescale
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks.mlp import ACTIVATIONS
from hitmdp_jax.networks.reads import Entries, Reads


class GradientAgent(Agent):
    """An agent of networks that Adam trains together.

    `action_reads` and `critic_reads`, and of agents with options `master_reads`, are the parts of
    the observation that the networks of that name read; an empty tuple stands for all of it.
    """

    learning_rate: float = traced(3e-4)
    learning_rate_schedule: str = static("constant", tuple(SCHEDULES))  # to 0 at the run's end
    adam_eps: float = traced(1e-5, positive=True)
    max_grad_norm: float = traced(0.5, infinite=True, positive=True)
    gamma: float = traced(0.99, high=1.0)
    hidden_sizes: tuple[int, ...] = static((64, 64))
    activation: str = static("relu", tuple(ACTIVATIONS))
    action_reads: tuple[str, ...] = static((), of=str)
    critic_reads: tuple[str, ...] = static((), of=str)
    bootstrap_on_truncation: bool = static(True)

    def bind(self, spec: Spec) -> Self:
        """Return the agent of a task.

        Raises:
          UsageError: the task's observation lacks a part that a network is to read.
        """
        bound = super().bind(spec)
        _ = bound.reads
        return bound

    @property
    def reads(self) -> Reads:
        """What each network reads of the task's observation."""
        return Reads(*(self._entries(f"{network}_reads") for network in Reads._fields))

    def _entries(self, name: str) -> Entries:
        parts = getattr(self, name, ())
        return tuple(self.task.observation.entries_of(parts).tolist()) if parts else None

    def scheduled(self, progress: jax.Array) -> Self:
        """Return the agent with its learning rate after a fraction `progress` of the run."""
        if self.learning_rate_schedule == "constant":
            return self
        rate = anneal(self.learning_rate_schedule, self.learning_rate, 0.0, progress)
        return self.replace(learning_rate=rate)

    @abc.abstractmethod
    def network(self) -> nn.Module:
        """Return the network for the task's actions; called with observations, it runs whole."""

    def optimizer(self) -> optax.GradientTransformation:
        """Return Adam behind a gradient-norm clip."""
        return adam(self.learning_rate, self.max_grad_norm, self.adam_eps)

    def init(self, key: jax.Array, spec: Spec) -> LearnerState:
        """Return new parameters and optimiser state for a task."""
        obs = jnp.zeros((1, spec.observation.size), jnp.float32)
        params = self.bind(spec).network().init(key, obs)["params"]
        return LearnerState(params, self.optimizer().init(params))

    def returns(self, batch: Batch, next_value: jax.Array) -> jax.Array:
        """Return a rollout's discounted returns [T, B], given the values [T, B] it reached."""
        return discounted_returns(
            batch.reward,
            next_value,
            batch.terminated,
            batch.truncated,
            self.gamma,
            self.bootstrap_on_truncation,
        )


class ClippedState(LearnerState):
    """What an update of a clipped agent changes."""

    rate_share: jax.Array  # of the learning rate: moves no policy by more than `target_kl`


class ClippedAgent(GradientAgent):
    """An agent that climbs clipped surrogates of a rollout in epochs of minibatches, as PPO does.

    Another objective is another `surrogate`. Steps may fit the task: all in KL, by `target_kl`, and
    the critic's in units of returns, with `normalize_values`.
    """

    gae_lambda: float = traced(0.95, high=1.0)
    clip_eps: float = traced(0.2, infinite=True)
    num_epochs: int = static(10)
    minibatch_size: int = static(64)
    target_kl: float = traced(0.02, infinite=True)  # nats, of the mean over an update's minibatches
    normalize_values: bool = static(True)
    value_decay: float = traced(0.03, high=1.0)  # an update's, with normalize_values

    def init(self, key: jax.Array, spec: Spec) -> ClippedState:
        """Return new parameters and optimiser state for a task, and the whole learning rate."""
        new = super().init(key, spec)
        return ClippedState(new.params, new.opt_state, jnp.ones((), jnp.float32))

    def check_batch(self, num_samples: int, spelled: str = "num_samples") -> None:
        """Reject a number of samples that minibatches do not divide."""
        size = self.minibatch_size
        if num_samples % size:
            near = divisor_below(num_samples, size)
            raise UsageError(
                f"{spelled} = {num_samples} is not divisible by minibatch_size = {size}; "
                f"the nearest size below that divides it is {near}."
            )

    def advantages(
        self, batch: Batch, reward: jax.Array, value: jax.Array, next_value: jax.Array
    ) -> jax.Array:
        """Return GAE(lambda) [T, B] over a rollout's ends; not standardised."""
        return generalized_advantages(
            reward,
            value,
            next_value,
            batch.terminated,
            batch.truncated,
            self.gamma,
            self.gae_lambda,
            self.bootstrap_on_truncation,
        )

    def surrogate(
        self, name: str, log_prob: jax.Array, old_log_prob: jax.Array, advantage: jax.Array
    ) -> tuple[jax.Array, Metrics]:
        """Return the objective of one policy, to be maximised, and diagnostics.

        Of them `<name>_kl` is what the learning rate may follow.
        """
        return clipped_surrogate(log_prob, old_log_prob, advantage, self.clip_eps, name)

    def optimize(self, loss: Loss, state: Any, data: Any, key: jax.Array) -> tuple[Any, Metrics]:
        """Run `num_epochs` of minibatches of the data [T, B, ...] on a loss."""
        params, opt_state, diagnostics = minibatch_epochs(
            loss,
            self.optimizer(),
            state.params,
            state.opt_state,
            jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data),
            key,
            num_epochs=self.num_epochs,
            minibatch_size=self.minibatch_size,
        )
        return state.replace(params=params, opt_state=opt_state), diagnostics

    def rescaled(
        self, state: ClippedState, value_target: jax.Array, critic: str = "critic"
    ) -> ClippedState:
        """Return the state with a critic in the units of what it is about to be fitted to."""
        if not self.normalize_values:
            return state
        changed = decay(rescale(state.params[critic], value_target), self.value_decay)
        return state.replace(params=state.params | {critic: changed})

    def in_units(self, params: Any, squared_error: jax.Array, critic: str = "critic") -> jax.Array:
        """Return a squared error of a critic's values in the critic's own units."""
        if not self.normalize_values:
            return squared_error
        return squared_error / jnp.square(params[critic]["scale"])

    def value_loss(
        self,
        params: Any,
        value: jax.Array,
        data: dict[str, Any],
        target: str = "value_target",
        critic: str = "critic",
    ) -> tuple[jax.Array, Metrics]:
        """Return half the squared error of values [N], in a critic's units, and metrics of it."""
        error = value - data[target]
        loss = 0.5 * jnp.square(error).mean()
        explained = 1.0 - error.var() / data[target].var()
        metrics = {"value_loss": loss, "explained_variance": explained}
        return self.in_units(params, loss, critic), metrics
