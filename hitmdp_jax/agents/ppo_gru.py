"""PPO with a memory: the control for agents whose options may serve as one."""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static
from hitmdp_jax.agents.ppo import PPO, PPONetwork
from hitmdp_jax.checks import divisor_below
from hitmdp_jax.learning.optimization import Loss, minibatch_epochs
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks.mlp import orthogonal
from hitmdp_jax.networks.reads import read


class RecurrentNetwork(PPONetwork):
    """A gated recurrent unit (GRU, Cho et al. 2014), and PPO's networks on what it remembers."""

    memory_size: int = 64

    def setup(self):
        """Declare the parts."""
        super().setup()
        self.cell = nn.GRUCell(self.memory_size, recurrent_kernel_init=orthogonal(1.0))

    def __call__(self, obs: jax.Array, memory: jax.Array | None = None) -> Any:
        """Return the policy, the value [...] and the new memory [..., M] in obs [..., O]."""
        if memory is None:
            memory = jnp.zeros((*obs.shape[:-1], self.memory_size), jnp.float32)
        memory = self.remember(memory, obs)
        return *self.read(obs, memory), memory

    def remember(self, memory: jax.Array, obs: jax.Array) -> jax.Array:
        """Return the memory [..., M] after an observation [..., O]."""
        return self.cell(memory, read(obs, self.reads.action))[0]

    def read(self, obs: jax.Array, memory: jax.Array) -> tuple[Any, jax.Array]:
        """Return the policy and the value [...] of an observation and the memory after it.

        Both read the two beside each other: what PPO can learn without a memory is in their reach.
        """
        acting, judging = (
            jnp.concatenate([read(obs, entries), memory], axis=-1)
            for entries in (self.reads.action, self.reads.critic)
        )
        return self.decoder(acting), self.critic(judging)


class PPOGRU(PPO):
    """PPO whose policy and critic remember the episode in the hidden state of a GRU.

    What is remembered is what the action policy reads, so the critic reads that in any case.
    Memory: the hidden state [M], zeros at an episode's start. The gradient goes back through a
    rollout to the episode's start, or to the rollout's, where the state is the one that was
    remembered. A minibatch holds the whole rollouts of some environments: as many as come to
    `minibatch_size` steps at most, divide their number, and one at least.
    """

    memory_size: int = static(64)

    def network(self) -> RecurrentNetwork:
        """Return the network for the task's actions."""
        return RecurrentNetwork(
            self.actions,
            self.hidden_sizes,
            self.activation,
            self.initial_log_std,
            self.reads,
            memory_size=self.memory_size,
        )

    def check_batch(self, num_samples: int, spelled: str = "num_samples") -> None:
        """Accept any number of samples: minibatches are cut from environments."""

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> jax.Array:
        """Return the memory of an episode's start, zeros [..., M]."""
        return jnp.zeros((*batch_shape, self.memory_size), jnp.float32)

    def heads(self, params: Any, obs: jax.Array, memory: Any = None) -> tuple[Any, jax.Array, Any]:
        """Return the policy, the value [...] and the new memory in obs [..., O]."""
        network: Any = self.network()
        return network.apply({"params": params}, obs, memory)

    def policy(self, params: Any, obs: jax.Array, option: Any = None) -> None:
        """None: the observation alone does not say what the policy is."""

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, Any], Metrics]:
        """Evaluate a rollout as PPO does, and keep where its episodes start."""
        data, metrics = super().targets(params, batch)
        return data | {"memory": batch.memory[:1], "started": batch.started}, metrics

    def optimize(self, loss: Loss, state: Any, data: Any, key: jax.Array) -> tuple[Any, Metrics]:
        """Run `num_epochs` of minibatches of the rollouts [T, B, ...] of environments on a loss."""
        length, num_envs = data["started"].shape
        params, opt_state, diagnostics = minibatch_epochs(
            loss,
            self.optimizer(),
            state.params,
            state.opt_state,
            jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), data),
            key,
            num_epochs=self.num_epochs,
            minibatch_size=divisor_below(num_envs, max(1, self.minibatch_size // length)),
        )
        return state.replace(params=params, opt_state=opt_state), diagnostics

    def evaluate(self, params: Any, data: dict[str, Any]) -> tuple[Any, jax.Array]:
        """Return the policy and the value of each step of rollouts [N, T, ...]."""
        network: Any = self.network()

        def remember(memory: jax.Array, seen: tuple[jax.Array, jax.Array]) -> Any:
            obs, started = seen
            memory = jnp.where(started[..., None], 0.0, memory)
            memory = network.apply({"params": params}, memory, obs, method="remember")
            return memory, memory

        along = jnp.swapaxes(data["obs"], 0, 1), jnp.swapaxes(data["started"], 0, 1)
        _, memory = jax.lax.scan(remember, data["memory"][:, 0], along)
        memory = jnp.swapaxes(memory, 0, 1)
        return network.apply({"params": params}, data["obs"], memory, method="read")
