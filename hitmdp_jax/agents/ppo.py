"""PPO: Proximal Policy Optimization (Schulman et al. 2017), the control without options."""

from typing import Any

import flax.linen as nn
import jax

from hitmdp_jax.agents.base import traced
from hitmdp_jax.agents.gradient_agent import ClippedAgent, ClippedState
from hitmdp_jax.envs.spec import Action
from hitmdp_jax.learning.advantages import in_deviations, standardize
from hitmdp_jax.learning.optimization import adapted_share
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import ActionDecoder, Critic, Reads, read
from hitmdp_jax.precision import in_32_bits


class PPONetwork(nn.Module):
    """A policy P(a | s) and a critic V[s], nothing shared."""

    actions: Action
    hidden_sizes: tuple[int, ...]
    activation: str
    initial_log_std: jax.Array | float
    reads: Reads = Reads()

    def setup(self):
        """Declare the parts."""
        self.decoder = ActionDecoder(
            self.actions, self.hidden_sizes, self.activation, self.initial_log_std
        )
        self.critic = Critic(self.hidden_sizes, self.activation)

    def __call__(self, obs: jax.Array) -> tuple[Any, jax.Array]:
        """Return the policy, a distribution, and the value [...] of obs [..., O]."""
        return self.decoder(read(obs, self.reads.action)), self.critic(read(obs, self.reads.critic))


class PPO(ClippedAgent):
    """Learns one policy by the clipped surrogate. It has no memory.

    Sizes and hyperparameters equal MOPG's, so that the two differ in the options alone.
    """

    entropy_weight: float = traced(0.0)  # a_H
    initial_log_std: float = traced(-0.5, low=-10.0, high=10.0)

    def network(self) -> PPONetwork:
        """Return the network for the task's actions."""
        return PPONetwork(
            self.actions, self.hidden_sizes, self.activation, self.initial_log_std, self.reads
        )

    def heads(self, params: Any, obs: jax.Array, memory: Any = ()) -> tuple[Any, jax.Array, Any]:
        """Return the policy, a distribution, the value [...] and the new memory in obs [..., O]."""
        network: Any = self.network()
        policy, value = network.apply({"params": params}, obs)
        return policy, value, ()

    def value_of(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array:
        """Return V[s], of shape [...]."""
        return self.heads(params, obs, memory)[1]

    def policy(self, params: Any, obs: jax.Array, option: Any = None) -> Any:
        """Return P(a | s), a distribution, for obs [..., O]; there are no options."""
        return self.heads(params, obs)[0]

    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, tuple[()]]:
        """Draw a_t; the deterministic policy takes the likeliest."""
        policy, _, memory = self.heads(params, obs, memory)
        return (policy.mode() if deterministic else policy.sample(seed=key)), memory, ()

    def update(
        self, state: ClippedState, batch: Batch, key: jax.Array
    ) -> tuple[ClippedState, Metrics]:
        """Learn from one rollout, in this order."""
        # What the rollout says of the policy and the critic, as they were when it was made.
        data, metrics = self.targets(state.params, batch.normalized())
        data, metrics = in_32_bits((data, metrics))  # Distrax's entropy is not
        # The critic's units become those of its targets; no value changes by that.
        state = self.rescaled(state, data["value_target"])
        # Epochs of minibatches on one loss, the surrogate and the critic's.
        rate = state.rate_share * self.learning_rate
        state, learned = self.replace(learning_rate=rate).optimize(self.loss, state, data, key)
        # The next update's rate follows how far the policy went.
        share = adapted_share(state.rate_share, learned["action_kl"], self.target_kl)
        return state.replace(rate_share=share), metrics | learned | {"learning_rate": rate}

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout into what the loss reads, [T, B, ...], and metrics."""
        policy, value, memory = self.heads(params, batch.obs, batch.memory)
        _, value_next, _ = self.heads(params, batch.next_obs, memory)
        entropy = policy.entropy()
        reward = batch.reward + self.entropy_weight * entropy
        advantage = self.advantages(batch, reward, value, value_next)
        data = {
            "obs": batch.obs,
            "action": batch.action,
            "log_prob": policy.log_prob(batch.action),
            "advantage": standardize(advantage),
            "entropy_weight": in_deviations(self.entropy_weight, advantage),
            "value_target": advantage + value,
        }
        return data, {"action_entropy": entropy.mean(), "value": value.mean()}

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: the surrogate and the critic's squared error."""
        policy, value = self.evaluate(params, data)
        surrogate, metrics = self.surrogate(
            "action", policy.log_prob(data["action"]), data["log_prob"], data["advantage"]
        )
        value_loss, of_values = self.value_loss(params, value, data)
        bonus = (data["entropy_weight"] * policy.entropy()).mean()
        return value_loss - surrogate - bonus, metrics | of_values

    def evaluate(self, params: Any, data: dict[str, Any]) -> tuple[Any, jax.Array]:
        """Return the policy, a distribution, and the value of each step of a minibatch."""
        policy, value, _ = self.heads(params, data["obs"])
        return policy, value
