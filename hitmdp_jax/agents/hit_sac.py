"""Soft actor-critic on a HiT-MDP: options as embeddings, learned off policy."""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import static, traced
from hitmdp_jax.agents.hit_policy import INITIAL_OPTIONS, equal_norm
from hitmdp_jax.agents.sac import SAC, SACNetwork, SACState, Transition
from hitmdp_jax.learning.options import (
    drawn_option,
    entropy,
    expected_value,
    kl_to_prior,
    log_sticky,
    option_statistics,
    tilted,
)
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionEncoder, TanhGaussian, read

MASTERS = ("best", "clustering")  # where P(o | s, o_{t-1}) comes from
LEARNERS = ("executed", "every")  # which options learn from a step


class HitSACNetwork(SACNetwork):
    """SAC's network whose policy and critics read an option's vector, and the master policy.

    With one option there is nothing to tell apart, and it is SAC's network.
    """

    num_options: int = 4
    embedding_size: int = 40
    option_scale: jax.Array | float = 1.0
    master: str = "best"
    similarity: jax.Array | float = 0.75
    initial_option_weight: jax.Array | float = 1.0

    def setup(self):
        """Declare the parts."""
        super().setup()
        if self.num_options > 1:
            shape = self.num_options, self.embedding_size
            self.embeddings = self.param("embeddings", equal_norm, shape)
            log_weight = nn.initializers.constant(jnp.log(self.initial_option_weight))
            self.log_option_weight = self.param("log_option_weight", log_weight, (), jnp.float32)
        if self.num_options > 1 and self.master == "clustering":
            scale = self.embedding_size**-0.5
            sizes = self.hidden_sizes, self.activation
            self.encoder = OptionEncoder("similarity", *sizes, input_scale=scale)

    def __call__(self, obs: jax.Array) -> Any:
        """Run every part once, which initialises it."""
        option = jnp.zeros(obs.shape[:-1], jnp.int32)
        return super().__call__(obs, option), self.encoded(obs, option)

    def vectors(self, *option: jax.Array) -> tuple[jax.Array, ...]:
        """Return the vectors [K, E] of all options, and which [...] is meant."""
        if self.num_options == 1:
            return ()
        return self.option_scale * self.embedding_size**-0.5 * self.embeddings, *option

    def encoded(self, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return the master network's log P(o | s, o_{t-1}) [..., K], for previous [...]."""
        if self.num_options == 1 or self.master != "clustering":
            return jnp.zeros((*previous.shape, self.num_options), jnp.float32)
        similarity = jnp.asarray(self.similarity, jnp.float32)
        seen = read(obs, self.reads.master)
        return jax.nn.log_softmax(self.encoder(seen, previous, self.embeddings, similarity))


class HitSAC(SAC):
    r"""SAC on the augmented MDP, whose states are (s_t, o_{t-1}) and whose actions are (o_t, a_t).

    Soft policy iteration there is

    .. math::
      Q(s, o, a) &\leftarrow r + \gamma (1 - d) V(s', o) \\
      V(s, o_{t-1}) &= \sum_o P(o | s, o_{t-1}) Q_O(s, o) - \alpha_O KL(P \| p) \\
      Q_O(s, o) &= E_a [Q(s, o, a) - \alpha_A \log P(a | s, o)]

    p(o | o_{t-1}) is the structural prior of the graphical model, sticky with `stay`, uniform with
    stay = 1 / K. alpha_A is SAC's temperature, and alpha_O is learned likewise, so that the
    divergence comes to `prior_divergence`. The sum over options is exact, so there are no
    importance weights, and V is known for every o_{t-1}, so the replay need not hold it.

    The "best" `master` is the closed form P \propto p(o | o_{t-1}) exp(Q_O(s, o) / alpha_O), read
    off the critics. The "clustering" one is the attention network of `OptionEncoder`, which learns
    from the same Q_O to come near it. A step teaches the `executed` option, or `every` one: what an
    action leads to does not depend on the option that chose it.

    Memory: o_{t-1}. The record is o_t.
    """

    stay: float = traced(0.9, low=1e-6, high=0.999999)  # p(o_t = o_{t-1} | o_{t-1})
    prior_divergence: float = traced(0.1)  # nats
    initial_option_weight: float = traced(1.0, positive=True)  # alpha_O
    option_scale: float = traced(1.0)
    similarity: float = traced(0.75)  # of the clustering master
    num_options: int = static(4)
    embedding_size: int = static(40)
    master: str = static("best", MASTERS)
    learners: str = static("executed", LEARNERS)
    initial_option: str = static("uniform", INITIAL_OPTIONS)
    master_reads: tuple[str, ...] = static((), of=str)  # of the clustering master

    def network(self) -> HitSACNetwork:
        """Return the network for the task's actions."""
        return HitSACNetwork(**self.of_network())

    def of_network(self) -> dict[str, Any]:
        """Return the attributes of the network that depend on the task and on hyperparameters."""
        own = ("num_options", "embedding_size", "option_scale", "master", "similarity")
        own += ("initial_option_weight",)
        return super().of_network() | {name: getattr(self, name) for name in own}

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> jax.Array:
        """Return the previous options of an episode's start."""
        if self.initial_option == "first":
            return jnp.zeros(batch_shape, jnp.int32)
        return jax.random.randint(key, batch_shape, 0, self.num_options, jnp.int32)

    def blank_record(self) -> jax.Array:
        """Return an example of what the agent notes when it acts: an option."""
        return jnp.zeros((), jnp.int32)

    def policy(self, params: Any, obs: jax.Array, option: jax.Array) -> TanhGaussian:
        """Return P(a | s, o), a distribution, for obs [..., O], option [...]."""
        return self.stretched(*self._apply(params, "gaussian", obs, option))

    def every_soft_q(self, params: Any, obs: jax.Array, key: jax.Array | None = None) -> jax.Array:
        """Return Q_O(s, o) of each option [..., K], by one action of each that the policy draws."""
        return self.soft_q(params, obs[..., None, :], key, jnp.arange(self.num_options))

    def option_weight(self, params: Any) -> jax.Array:
        """Return alpha_O, in reward per nat; of one option, whose divergence is 0, any number."""
        return jnp.exp(params["log_option_weight"]) if self.num_options > 1 else jnp.float32(1.0)

    def log_prior(self, previous: jax.Array) -> jax.Array:
        """Return log p(o | o_{t-1}) [..., K]."""
        return log_sticky(previous, self.num_options, self.stay)

    def master_log_probs(
        self, params: Any, obs: jax.Array, q_option: jax.Array, previous: jax.Array
    ) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [..., K], given Q_O(s, o) [..., K]."""
        if self.master == "clustering":
            return self._apply(params, "encoded", obs, previous)
        return tilted(self.log_prior(previous), q_option, self.option_weight(params))

    def option_log_probs(self, params: Any, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [..., K], by each option's likeliest action."""
        q_option = self.every_soft_q(params, obs)
        return self.master_log_probs(params, obs, q_option, previous)

    def option_probs(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return P(o_t | s_t, o_{t-1}) [..., K]."""
        return jnp.exp(self.option_log_probs(params, obs, memory))

    def option_of(self, record: jax.Array) -> jax.Array:
        """Return the options that were executed."""
        return record

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: jax.Array,
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Draw o_t and a_t; the deterministic policy takes the likeliest of each."""
        key_option, key_action, key_uniform = jax.random.split(key, 3)
        log_option = self.option_log_probs(params, obs, memory)
        option = drawn_option(log_option, key_option, deterministic)
        policy = self.policy(params, obs, option)
        if deterministic:
            return policy.mode(), option, option
        action = self.explored(params, policy.sample(seed=key_action), key_uniform)
        return action, option, option

    def soft_value(
        self, params: Any, obs: jax.Array, q_option: jax.Array, previous: jax.Array
    ) -> jax.Array:
        """Return V(s, o_{t-1}) [...] for previous [...], given Q_O(s, o) [..., K]."""
        log_option = self.master_log_probs(params, obs, q_option, previous)
        cost = kl_to_prior(log_option, self.log_prior(previous))
        return expected_value(log_option, q_option) - self.option_weight(params) * cost

    def value_of(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return V(s, o_{t-1}) [...], by the values of each option's likeliest action."""
        return self.soft_value(params, obs, self.every_soft_q(params, obs), memory)

    def update(self, state: SACState, batch: Batch, key: jax.Array) -> tuple[SACState, Metrics]:
        """Learn as SAC does, and count the options of the rollout."""
        seen, previous = batch.normalized(), batch.memory
        log_option = self.option_log_probs(state.params, seen.obs, previous)
        metrics = {
            "option_entropy": entropy(log_option).mean(),
            "prior_kl": kl_to_prior(log_option, self.log_prior(previous)).mean(),
        }
        counts = option_statistics(batch.record, previous, batch.started, self.num_options)
        state, learned = super().update(state, batch, key)
        return state, learned | metrics | counts

    def learned_options(
        self, step: Transition
    ) -> tuple[jax.Array, jax.Array, tuple[jax.Array, ...]]:
        """Return a minibatch's observations [N, 1, O], actions [N, 1, A] and who learns [N, k]."""
        obs, action, _ = super().learned_options(step)
        option = step.record[:, None]
        if self.learners == "every":
            option = jnp.broadcast_to(jnp.arange(self.num_options), (len(option), self.num_options))
        return obs[:, None], action[:, None], (option,)

    def q_target(
        self, params: Any, following: Any, step: Transition, key: jax.Array, *option: jax.Array
    ) -> jax.Array:
        """Return r + gamma (1 - d) V(s', o) for the options [N, k], which are o_{t-1} in s'."""
        (previous,) = option
        q_option = self.every_soft_q(following, step.next_obs, key)[:, None]
        value = self.soft_value(params, step.next_obs[:, None], q_option, previous)
        return step.reward[:, None] + self.gamma * (1.0 - step.done)[:, None] * value

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return SAC's loss of a minibatch, alpha_O's and, where there is one, the network's.

        Both are of the states reached, whose Q_O the targets ask for anyway; the network learns
        for each o_{t-1}.
        """
        loss, metrics = super().loss(params, data)
        if self.num_options == 1:
            return loss, metrics
        fixed, step = jax.lax.stop_gradient(params), data["step"]
        key_target, _ = jax.random.split(data["key"])  # the compiler makes one of equal evaluations
        _, _, (previous,) = self.learned_options(step)
        obs = step.next_obs[:, None]
        q_option = self.every_soft_q(fixed | data["target"], step.next_obs, key_target)[:, None]
        log_option = self.master_log_probs(fixed, obs, q_option, previous)
        too_much = kl_to_prior(log_option, self.log_prior(previous)).mean() - self.prior_divergence
        loss -= params["log_option_weight"] * too_much
        metrics |= {"option_weight": self.option_weight(fixed)}
        if self.master == "clustering":
            every = jnp.arange(self.num_options)
            best = tilted(self.log_prior(every), q_option, self.option_weight(fixed))
            master = self._apply(params, "encoded", obs, every)  # [N, K_prev, K]
            metrics["master_distance"] = kl_to_prior(master, best).mean()
            loss += metrics["master_distance"]
        return loss, metrics
