"""MOPG: Maximum-entropy Options Policy Gradient (HiT-MDP, ICLR 2023, sec. 4 and App. F-G)."""

from typing import Any

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.agents.base import LearnerState, Metrics, static, traced
from hitmdp_jax.learning import mutual_information as mi
from hitmdp_jax.learning.advantages import generalized_advantages, standardize
from hitmdp_jax.learning.optimization import adam, minibatch_epochs
from hitmdp_jax.learning.options import option_statistics
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.learning.schedules import SCHEDULES, anneal
from hitmdp_jax.learning.surrogate import clipped_surrogate
from hitmdp_jax.networks import MASTER_POLICIES, ActionDecoder, Critic, OptionEncoder
from hitmdp_jax.networks.mlp import ACTIVATIONS

INITIAL_OPTIONS = ("uniform", "first")


def remember(memory: jax.Array, option: jax.Array, num_options: int, order: int) -> jax.Array:
    """Return the memory of the last `order` options, as one number in base K, newest first.

    Of order 1 it is the option itself; in general o_{t-1} + K o_{t-2} + K^2 o_{t-3} + ...
    """
    return (option + num_options * memory) % num_options**order


class MOPGNetwork(nn.Module):
    """Option embeddings W [K, E], the master policy, the action policy and the critic Q_O."""

    action_size: int
    num_options: int
    embedding_size: int
    hidden_sizes: tuple[int, ...]
    activation: str
    master_policy: str
    initial_log_std: jax.Array | float
    value_order: int = 1

    def setup(self):
        """Declare the parts."""
        self.embeddings = self.param(
            "embeddings", nn.initializers.normal(1.0), (self.num_options, self.embedding_size)
        )
        self.encoder = OptionEncoder(self.master_policy, self.hidden_sizes, self.activation)
        self.decoder = ActionDecoder(
            self.action_size, self.hidden_sizes, self.activation, self.initial_log_std
        )
        self.critic = Critic(self.hidden_sizes, self.activation)

    def __call__(self, obs: jax.Array, option: jax.Array, similarity: jax.Array) -> Any:
        """Run every part once, which initialises it."""
        return self.master(obs, option, similarity), self.action(obs, option), self.q(obs, option)

    def master(self, obs: jax.Array, previous: jax.Array, similarity: jax.Array) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [B, K] for obs [B, O], previous [B]."""
        logits = self.encoder(obs, previous, self.embeddings, similarity)
        return jax.nn.log_softmax(logits)

    def action(self, obs: jax.Array, option: jax.Array) -> distrax.MultivariateNormalDiag:
        """Return P(a | s, o) over [B, A] for obs [B, O], option [B]."""
        return self.decoder(obs, self.embeddings[option])

    def q(self, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o_t] [B] for obs [B, O], memory [B] with o_t as its newest option."""
        return self.critic(obs, jax.nn.one_hot(memory, self.num_options**self.value_order))

    def every_action(self, obs: jax.Array) -> distrax.MultivariateNormalDiag:
        """Return P(a | s, o) of each option, over [B, K, A], for obs [B, O]."""
        return self.decoder(obs[:, None], self.embeddings)

    def every_q(self, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o] of each option, [B, K], for obs [B, O], memory [B] before the choice."""
        options = jnp.arange(self.num_options)
        return self.q(obs[:, None], remember(memory[:, None], options, *self.memory_size))

    @property
    def memory_size(self) -> tuple[int, int]:
        """K and n."""
        return self.num_options, self.value_order


class MOPG(struct.PyTreeNode):
    """Learns K options and the master policy that chooses among them at every step.

    Maximises the ELBO (Thm 4.1) by PPO's clipped surrogate for both policies. The option stream is
    rewarded r + a_I I_t + a_H H(pi_O), the action stream r + a_H H(pi_A). The advantages are GAE
    over V[s, o_{t-1}] = sum_o pi_O(o | s, o_{t-1}) Q_O[s, o] (Eq. 6) and over Q_O[s, o_t]; the
    printed Alg. 1 puts the reward-like terms inside gamma(...), see docs/errata.md.

    Memory: the previous option o_{t-1}, an int. At an episode's start it is drawn uniformly, or is
    option 0 ("first", Alg. 1 line 3), by which the master policy can tell an episode's start. With
    `value_order` n > 1 the memory holds the last n options (`remember`), and the values depend on
    all of them: the deep wide value functions of App. A. The policies see o_{t-1} alone.
    """

    learning_rate: float = traced(3e-4)
    adam_eps: float = traced(1e-5)
    max_grad_norm: float = traced(0.5)
    gamma: float = traced(0.99, high=1.0)
    gae_lambda: float = traced(0.95, high=1.0)
    clip_eps: float = traced(0.2)
    entropy_weight: float = traced(0.0)  # a_H, at the start of a run where it is annealed
    final_entropy_weight: float = traced(0.0)  # a_H at the end of an annealed run
    information_weight: float = traced(0.0)  # a_I
    similarity: float = traced(0.75)  # c, the weight of the similarity logits
    initial_log_std: float = traced(-0.5, low=-10.0, high=10.0)
    num_options: int = static(4)
    embedding_size: int = static(40)
    hidden_sizes: tuple[int, ...] = static((64, 64))
    activation: str = static("relu", tuple(ACTIVATIONS))
    master_policy: str = static("similarity", MASTER_POLICIES)
    mutual_information: str = static("none", mi.CHOICES)
    entropy_schedule: str = static("constant", tuple(SCHEDULES))
    initial_option: str = static("uniform", INITIAL_OPTIONS)
    bootstrap_on_truncation: bool = static(True)
    value_order: int = static(1)
    num_epochs: int = static(10)
    minibatch_size: int = static(64)

    def scheduled(self, progress: jax.Array) -> "MOPG":
        """Return the agent as it is after a fraction `progress` of the run (App. B.2)."""
        annealed = anneal(
            self.entropy_schedule, self.entropy_weight, self.final_entropy_weight, progress
        )
        return self.replace(entropy_weight=annealed)

    def network(self, action_size: int) -> MOPGNetwork:
        """Return the network for actions of this size."""
        return MOPGNetwork(
            action_size,
            self.num_options,
            self.embedding_size,
            self.hidden_sizes,
            self.activation,
            self.master_policy,
            self.initial_log_std,
            self.value_order,
        )

    def _apply(self, params: Any, method: str, *args: Any) -> Any:
        network = self.network(params["decoder"]["log_std"].size)
        return network.apply({"params": params}, *args, method=method)

    def master_log_probs(self, params: Any, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [B, K] for obs [B, O], previous [B]."""
        return self._apply(params, "master", obs, previous, self.similarity)

    def init(self, key: jax.Array, observation_size: int, action_size: int) -> LearnerState:
        """Return new parameters and optimiser state."""
        obs, option = jnp.zeros((1, observation_size)), jnp.zeros(1, jnp.int32)
        params = self.network(action_size).init(key, obs, option, self.similarity)["params"]
        return LearnerState(params, self._optimizer().init(params))

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> jax.Array:
        """Return the previous options of an episode's start."""
        if self.initial_option == "first":
            return jnp.zeros(batch_shape, jnp.int32)
        return jax.random.randint(key, batch_shape, 0, self.num_options**self.value_order)

    def remember(self, memory: jax.Array, option: jax.Array) -> jax.Array:
        """Return the memory after an option was taken."""
        return remember(memory, option, self.num_options, self.value_order)

    def previous_option(self, memory: jax.Array) -> jax.Array:
        """Return o_{t-1}."""
        return memory % self.num_options

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: jax.Array,
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Draw o_t and a_t; the deterministic policy takes the likeliest of each.

        Returns:
          The action, the new memory, and o_t as the record.
        """
        batch_shape = memory.shape
        obs, memory = obs.reshape(-1, obs.shape[-1]), memory.reshape(-1)
        key_option, key_action = jax.random.split(key)
        previous = self.previous_option(memory)
        master = distrax.Categorical(self.master_log_probs(params, obs, previous))
        option = jnp.asarray(master.mode() if deterministic else master.sample(seed=key_option))
        policy = self._apply(params, "action", obs, option)
        action = policy.mode() if deterministic else policy.sample(seed=key_action)
        memory, option = (
            jnp.reshape(x, batch_shape) for x in (self.remember(memory, option), option)
        )
        return action.reshape(*batch_shape, -1), memory, option

    def option_of(self, record: jax.Array) -> jax.Array:
        """Return o_t."""
        return record

    def option_probs(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return P(o_t | s_t, o_{t-1}) [..., K]."""
        flat = obs.reshape(-1, obs.shape[-1]), self.previous_option(memory.reshape(-1))
        return jnp.exp(self.master_log_probs(params, *flat)).reshape(*memory.shape, -1)

    def update(
        self, state: LearnerState, batch: Batch, key: jax.Array
    ) -> tuple[LearnerState, Metrics]:
        """Estimate both advantages, then run `num_epochs` of minibatches on both surrogates."""
        data, metrics = self.targets(state.params, batch)
        params, opt_state, diagnostics = minibatch_epochs(
            self.loss,
            self._optimizer(),
            state.params,
            state.opt_state,
            data,
            key,
            num_epochs=self.num_epochs,
            minibatch_size=self.minibatch_size,
        )
        previous = self.previous_option(batch.memory)
        options = option_statistics(batch.record, previous, batch.started, self.num_options)
        return LearnerState(params, opt_state), metrics | diagnostics | options

    def targets(self, params: Any, batch: Batch) -> tuple[dict[str, jax.Array], Metrics]:
        """Evaluate a rollout: what the loss needs of it, flat [T * B, ...], and metrics."""
        shape = batch.reward.shape
        flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), batch)
        obs, option, previous = flat.obs, flat.record, self.previous_option(flat.memory)
        memory_next = self.remember(flat.memory, option)

        log_master = self.master_log_probs(params, obs, previous)  # [N, K]
        q_all = self._apply(params, "every_q", obs, flat.memory)
        policy = self._apply(params, "action", obs, option)
        log_master_next = self.master_log_probs(params, flat.next_obs, option)
        q_all_next = self._apply(params, "every_q", flat.next_obs, memory_next)

        value = (jnp.exp(log_master) * q_all).sum(-1).reshape(shape)
        value_next = (jnp.exp(log_master_next) * q_all_next).sum(-1).reshape(shape)
        q = mi.taken(q_all, option).reshape(shape)
        # Q_O[s', o_{t+1}] where the next option was drawn; its expectation over the master policy
        # where the episode or the rollout ended first.
        drawn = jnp.roll(batch.record, -1, axis=0).reshape(-1)
        q_drawn = mi.taken(q_all_next, drawn).reshape(shape)
        last = batch.terminated | batch.truncated | (jnp.arange(shape[0]) == shape[0] - 1)[:, None]
        q_next = jnp.where(last, value_next, q_drawn)

        option_entropy = -(jnp.exp(log_master) * log_master).sum(-1)
        action_entropy = policy.entropy()
        information = self._information(params, flat, log_master)
        reward_option = flat.reward + self.information_weight * information
        reward_option += self.entropy_weight * option_entropy
        reward_action = flat.reward + self.entropy_weight * action_entropy

        ends = batch.terminated, batch.truncated
        gae = self.gamma, self.gae_lambda, self.bootstrap_on_truncation
        advantage_option = generalized_advantages(
            reward_option.reshape(shape), value, value_next, *ends, *gae
        )
        advantage_action = generalized_advantages(
            reward_action.reshape(shape), q, q_next, *ends, *gae
        )
        data = {
            "obs": obs,
            "previous": previous,
            "option": option,
            "memory": memory_next,
            "action": flat.action,
            "log_prob_option": mi.taken(log_master, option),
            "log_prob_action": policy.log_prob(flat.action),
            "advantage_option": standardize(advantage_option).reshape(-1),
            "advantage_action": standardize(advantage_action).reshape(-1),
            "value_target": (advantage_action + q).reshape(-1),
        }
        metrics = {
            "option_entropy": option_entropy.mean(),
            "action_entropy": action_entropy.mean(),
            "information": information.mean(),
            "value": value.mean(),
        }
        return data, metrics

    def loss(self, params: Any, data: dict[str, jax.Array]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: both surrogates and the critic's squared error."""
        log_master = self.master_log_probs(params, data["obs"], data["previous"])
        surrogate_option, option = clipped_surrogate(
            mi.taken(log_master, data["option"]),
            data["log_prob_option"],
            data["advantage_option"],
            self.clip_eps,
        )
        policy = self._apply(params, "action", data["obs"], data["option"])
        surrogate_action, action = clipped_surrogate(
            policy.log_prob(data["action"]),
            data["log_prob_action"],
            data["advantage_action"],
            self.clip_eps,
        )
        q = self._apply(params, "q", data["obs"], data["memory"])
        value_loss = 0.5 * jnp.square(q - data["value_target"]).mean()
        diagnostics = {f"option_{name}": x for name, x in option.items()}
        diagnostics |= {f"action_{name}": x for name, x in action.items()}
        return value_loss - surrogate_option - surrogate_action, diagnostics | {
            "value_loss": value_loss
        }

    def _information(self, params: Any, flat: Batch, log_master: jax.Array) -> jax.Array:
        """Return the intrinsic reward I_t [N]."""
        if self.mutual_information == "none":
            return jnp.zeros_like(flat.reward)
        obs, option = flat.obs, flat.record
        log_action = self._apply(params, "every_action", obs).log_prob(flat.action[:, None])
        if self.mutual_information == "action":
            return mi.action_information(log_master, log_action, option)
        if self.mutual_information == "usage":
            return mi.usage_information(log_master, log_action, option)
        previous = self.previous_option(flat.memory)
        usage = jax.nn.one_hot(previous, self.num_options).mean(axis=0)
        log_every_master = jax.vmap(
            lambda k: self.master_log_probs(params, obs, jnp.full_like(option, k)), out_axes=1
        )(jnp.arange(self.num_options))  # [N, K previous, K]
        log_marginal = jax.nn.logsumexp(log_every_master, axis=1, b=usage[:, None])
        return mi.previous_information(log_master, log_action, option, log_marginal)

    def _optimizer(self):
        return adam(self.learning_rate, self.max_grad_norm, self.adam_eps)
