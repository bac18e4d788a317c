"""PPO: Proximal Policy Optimization (Schulman et al. 2017), the control without options."""

from typing import Any

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.agents.base import LearnerState, Metrics, static, traced
from hitmdp_jax.learning.advantages import generalized_advantages, standardize
from hitmdp_jax.learning.optimization import adam, minibatch_epochs
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.learning.surrogate import clipped_surrogate
from hitmdp_jax.networks import ActionDecoder, Critic
from hitmdp_jax.networks.mlp import ACTIVATIONS


class PPONetwork(nn.Module):
    """A Gaussian policy P(a | s) and a critic V[s], nothing shared."""

    action_size: int
    hidden_sizes: tuple[int, ...]
    activation: str
    initial_log_std: jax.Array | float

    def setup(self):
        """Declare the parts."""
        self.decoder = ActionDecoder(
            self.action_size, self.hidden_sizes, self.activation, self.initial_log_std
        )
        self.critic = Critic(self.hidden_sizes, self.activation)

    def __call__(self, obs: jax.Array) -> tuple[distrax.MultivariateNormalDiag, jax.Array]:
        """Return the policy over [..., A] and the value [...] of obs [..., O]."""
        return self.decoder(obs), self.critic(obs)


class PPO(struct.PyTreeNode):
    """Learns one Gaussian policy by the clipped surrogate. It has no memory.

    Sizes and hyperparameters equal MOPG's, so that the two differ in the options alone.
    """

    learning_rate: float = traced(3e-4)
    adam_eps: float = traced(1e-5)
    max_grad_norm: float = traced(0.5)
    gamma: float = traced(0.99, high=1.0)
    gae_lambda: float = traced(0.95, high=1.0)
    clip_eps: float = traced(0.2)
    entropy_weight: float = traced(0.0)
    initial_log_std: float = traced(-0.5, low=-10.0, high=10.0)
    hidden_sizes: tuple[int, ...] = static((64, 64))
    activation: str = static("relu", tuple(ACTIVATIONS))
    bootstrap_on_truncation: bool = static(True)
    num_epochs: int = static(10)
    minibatch_size: int = static(64)

    def network(self, action_size: int) -> PPONetwork:
        """Return the network for actions of this size."""
        return PPONetwork(action_size, self.hidden_sizes, self.activation, self.initial_log_std)

    def apply(self, params: Any, obs: jax.Array) -> Any:
        """Return the policy, a distribution over [..., A], and the value [...] of obs [..., O]."""
        network = self.network(params["decoder"]["log_std"].size)
        return network.apply({"params": params}, obs)

    def init(self, key: jax.Array, observation_size: int, action_size: int) -> LearnerState:
        """Return new parameters and optimiser state."""
        params = self.network(action_size).init(key, jnp.zeros((1, observation_size)))["params"]
        return LearnerState(params, self._optimizer().init(params))

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> tuple[()]:
        """Return nothing: PPO remembers nothing."""
        return ()

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: tuple[()],
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, tuple[()], tuple[()]]:
        """Draw a_t; the deterministic policy takes the mean."""
        policy, _ = self.apply(params, obs)
        return (policy.mode() if deterministic else policy.sample(seed=key)), (), ()

    def option_of(self, record: tuple[()]) -> None:
        """Return None: PPO has no options."""

    def option_probs(self, params: Any, obs: jax.Array, memory: tuple[()]) -> None:
        """Return None: PPO has no options."""

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Estimate advantages, then run `num_epochs` of minibatches on the surrogate."""
        policy, value = self.apply(state.params, batch.obs)
        _, next_value = self.apply(state.params, batch.next_obs)
        entropy = policy.entropy()
        advantage = generalized_advantages(
            batch.reward + self.entropy_weight * entropy,
            value,
            next_value,
            batch.terminated,
            batch.truncated,
            self.gamma,
            self.gae_lambda,
            self.bootstrap_on_truncation,
        )
        data = {
            "obs": batch.obs,
            "action": batch.action,
            "log_prob": policy.log_prob(batch.action),
            "advantage": standardize(advantage),
            "value_target": advantage + value,
        }
        params, opt_state, diagnostics = minibatch_epochs(
            self.loss,
            self._optimizer(),
            state.params,
            state.opt_state,
            jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data),
            key,
            num_epochs=self.num_epochs,
            minibatch_size=self.minibatch_size,
        )
        metrics = {"action_entropy": entropy.mean(), "value": value.mean()}
        return LearnerState(params, opt_state), metrics | diagnostics

    def loss(self, params: Any, data: dict[str, jax.Array]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: the surrogate and the critic's squared error."""
        policy, value = self.apply(params, data["obs"])
        surrogate, diagnostics = clipped_surrogate(
            policy.log_prob(data["action"]), data["log_prob"], data["advantage"], self.clip_eps
        )
        value_loss = 0.5 * jnp.square(value - data["value_target"]).mean()
        metrics = {f"action_{name}": x for name, x in diagnostics.items()}
        return value_loss - surrogate, metrics | {"value_loss": value_loss}

    def _optimizer(self):
        return adam(self.learning_rate, self.max_grad_norm, self.adam_eps)
