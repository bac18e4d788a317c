"""The policy of HiT-MDPs (sec. 3 and App. G): options as embeddings, chosen anew at every step."""

import math
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.agents.base import LearnerState, static, traced
from hitmdp_jax.agents.gradient_agent import GradientAgent
from hitmdp_jax.envs.option_rewards import LEARNED
from hitmdp_jax.envs.spec import Action, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning.options import drawn_option, expected_value
from hitmdp_jax.networks import (
    INITIALIZATIONS,
    MASTER_POLICIES,
    ActionDecoder,
    Critic,
    OptionDirections,
    OptionEncoder,
    Reads,
    pytorch_start,
    read,
)

INITIAL_OPTIONS = ("uniform", "first")
EMBEDDINGS = ("equal", "normal")


def equal_norm(key: jax.Array, shape: tuple[int, int]) -> jax.Array:
    """Return rows [K, E] of norm sqrt(E) in random directions: every option as likely to last."""
    rows = jax.random.normal(key, shape, jnp.float32)
    return rows / jnp.sqrt(jnp.square(rows).mean(axis=-1, keepdims=True))


def remember(memory: jax.Array, option: jax.Array, num_options: int, order: int) -> jax.Array:
    """Return the memory of the last `order` options, as one number in base K, newest first.

    Of order 1 it is the option itself; in general o_{t-1} + K o_{t-2} + K^2 o_{t-3} + ...
    """
    return option if order == 1 else (option + num_options * memory) % num_options**order


class HitNetwork(nn.Module):
    """Option embeddings W [K, E], the master policy, the action policy and the critic Q_O."""

    actions: Action
    num_options: int
    embedding_size: int
    hidden_sizes: tuple[int, ...]
    activation: str
    master_policy: str
    similarity: jax.Array | float
    initial_log_std: jax.Array | float
    value_order: int
    form: str
    option_scale: jax.Array | float
    reads: Reads = Reads()
    own_rewards: bool = False  # whether options have rewards, and so a critic, of their own
    learned_reward: bool = False  # whether one of them is learned

    def setup(self):
        """Declare the parts."""
        init = equal_norm if self.form == "equal" else nn.initializers.normal(1.0, jnp.float32)
        shape = self.num_options, self.embedding_size
        self.embeddings = self.param("embeddings", init, shape)
        # An input of norm sqrt(E) would outweigh the state.
        self.input_scale = self.embedding_size**-0.5 if self.form == "equal" else 1.0
        self.encoder = OptionEncoder(
            self.master_policy,
            self.hidden_sizes,
            self.activation,
            input_scale=self.input_scale,
        )
        self.decoder = ActionDecoder(
            self.actions, self.hidden_sizes, self.activation, self.initial_log_std
        )
        self.critic = Critic(self.hidden_sizes, self.activation)
        if self.own_rewards:
            self.own_critic = Critic(self.hidden_sizes, self.activation)
        if self.learned_reward:
            self.directions = OptionDirections(self.num_options)

    def __call__(self, obs: jax.Array) -> Any:
        """Run every part once, which initialises it."""
        option = jnp.zeros(obs.shape[:-1], jnp.int32)
        parts = [self.master(obs, option), self.action(obs, option), self.q(obs, option)]
        parts += [self.own_q(obs, option)] if self.own_rewards else []
        return parts + ([self.along_directions(obs)] if self.learned_reward else [])

    def master(self, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [..., K] for obs [..., O], previous [...]."""
        similarity = jnp.asarray(self.similarity, jnp.float32)
        seen = read(obs, self.reads.master)
        logits = self.encoder(seen, previous, self.embeddings, similarity)
        return jax.nn.log_softmax(logits)

    def action(self, obs: jax.Array, option: jax.Array) -> Any:
        """Return P(a | s, o), a distribution, for obs [..., O], option [...]."""
        rows = self.option_scale * self.input_scale * self.embeddings
        return self.decoder(read(obs, self.reads.action), rows, option)

    def q(self, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o_t], of shape [...], for obs [..., O] and memory [...] ending in o_t."""
        every = self.option_scale * jnp.eye(self.num_options**self.value_order, dtype=jnp.float32)
        return self.critic(read(obs, self.reads.critic), every, memory)

    def own_q(self, obs: jax.Array, option: jax.Array) -> jax.Array:
        """Return the value [...] of going on with the option for ever, by its own reward."""
        every = self.option_scale * jnp.eye(self.num_options, dtype=jnp.float32)
        return self.own_critic(read(obs, self.reads.critic), every, option)

    def along_directions(self, change: jax.Array) -> jax.Array:
        """Return how far changes [..., O] go along the direction of each option, [..., K]."""
        return self.directions(read(change, self.reads.posterior))

    def every_action(self, obs: jax.Array) -> Any:
        """Return P(a | s, o) of each option, over [..., K], for obs [..., O]."""
        return self.action(obs[..., None, :], jnp.arange(self.num_options))

    def every_q(self, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o] of each option, [..., K], for memory [...] before the choice."""
        every = jnp.arange(self.num_options)
        after = remember(memory[..., None], every, self.num_options, self.value_order)
        return self.q(obs[..., None, :], after)


class HitPolicy(GradientAgent):
    """An agent that draws o_t from P(o | s_t, o_{t-1}) and a_t from P(a | s_t, o_t) at every step.

    Memory: the previous option o_{t-1}, an int. At an episode's start it is drawn uniformly, or is
    option 0 ("first", Alg. 1 line 3), by which the master policy can tell an episode's start. With
    `value_order` n > 1 the memory holds the last n options (`remember`), and the values depend on
    all of them: the deep wide value functions of App. A. The policies see o_{t-1} alone. The record
    is o_t.

    The options' embeddings are "equal" in norm at the start, sqrt(E), so that each is as likely to
    last, and bodies read them divided by it; "normal" is the printed form, W ~ N(0, 1) as it is.
    The action policy and the critic read an option's vector times `option_scale` besides: options
    that start almost alike share what they learn, and part as far as it pays.

    By default layers start orthogonal, those of the policies' outputs small. With `initialization`
    "pytorch" they start as the layers of PyTorch do (`pytorch_start`), which the paper used.
    """

    similarity: float = traced(0.75)  # c, the weight of the similarity logits
    option_scale: float = traced(0.1)
    initial_log_std: float = traced(-0.5, low=-10.0, high=10.0)
    num_options: int = static(4)
    embedding_size: int = static(40)
    master_policy: str = static("similarity", MASTER_POLICIES)
    initial_option: str = static("uniform", INITIAL_OPTIONS)
    value_order: int = static(1)
    embeddings: str = static("equal", EMBEDDINGS)
    initialization: str = static("orthogonal", INITIALIZATIONS)
    master_reads: tuple[str, ...] = static((), of=str)

    def __post_init__(self) -> None:
        super().__post_init__()
        # A memory of the last options is one int32.
        if self.value_order > 1 and self.value_order * math.log2(self.num_options) >= 31:
            raise UsageError(
                f"value_order = {self.value_order} of num_options = {self.num_options} makes "
                f"{self.num_options}^{self.value_order} memories, more than 2^31: lower one."
            )

    def init(self, key: jax.Array, spec: Spec) -> LearnerState:
        """Return new parameters and optimiser state for a task."""
        new = super().init(key, spec)
        if self.initialization == "orthogonal":
            return new
        return new.replace(params=pytorch_start(new.params, jax.random.fold_in(key, 1)))

    def network(self) -> HitNetwork:
        """Return the network for the task's actions."""
        return HitNetwork(
            self.actions,
            self.num_options,
            self.embedding_size,
            self.hidden_sizes,
            self.activation,
            self.master_policy,
            self.similarity,
            self.initial_log_std,
            self.value_order,
            self.embeddings,
            self.option_scale,
            self.reads,
            bool(self.option_rewards),
            LEARNED in self.option_rewards,
        )

    def _apply(self, params: Any, method: str, *args: jax.Array) -> Any:
        return self.network().apply({"params": params}, *args, method=method)

    def option_log_probs(self, params: Any, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return log P(o | s, o_{t-1}) [..., K] for obs [..., O], previous [...]."""
        return self._apply(params, "master", obs, previous)

    def attention(self, params: Any, obs: jax.Array, previous: jax.Array) -> jax.Array:
        """Return how much the master attends to each option [..., K] for obs, previous [...]."""
        network: Any = self.network()
        _, kept = network.apply(
            {"params": params}, obs, previous, method="master", mutable=["intermediates"]
        )
        (weights,) = kept["intermediates"]["encoder"]["attention"]["weights"]
        return weights

    def policy(self, params: Any, obs: jax.Array, option: jax.Array) -> Any:
        """Return P(a | s, o), a distribution, for obs [..., O], option [...]."""
        return self._apply(params, "action", obs, option)

    def every_policy(self, params: Any, obs: jax.Array) -> Any:
        """Return P(a | s, o) of each option, a distribution over [..., K]."""
        return self._apply(params, "every_action", obs)

    def q(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o_t], of shape [...], for obs [..., O] and memory [...] ending in o_t."""
        return self._apply(params, "q", obs, memory)

    def own_q(self, params: Any, obs: jax.Array, option: jax.Array) -> jax.Array:
        """Return the value [...] of going on with the option for ever, by its own reward."""
        return self._apply(params, "own_q", obs, option)

    def every_q(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return Q_O[s, o] of each option, [..., K], for memory [...] before the choice."""
        return self._apply(params, "every_q", obs, memory)

    def initial_memory(self, key: jax.Array, batch_shape: tuple[int, ...] = ()) -> jax.Array:
        """Return the previous options of an episode's start."""
        if self.initial_option == "first":
            return jnp.zeros(batch_shape, jnp.int32)
        number = self.num_options**self.value_order
        return jax.random.randint(key, batch_shape, 0, number, jnp.int32)

    def remember(self, memory: jax.Array, option: jax.Array) -> jax.Array:
        """Return the memory after an option was taken."""
        return remember(memory, option, self.num_options, self.value_order)

    def previous_option(self, memory: jax.Array) -> jax.Array:
        """Return o_{t-1}."""
        return memory if self.value_order == 1 else memory % self.num_options

    def act(
        self,
        params: Any,
        obs: jax.Array,
        memory: jax.Array,
        key: jax.Array,
        deterministic: bool = False,
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Draw o_t and a_t; the deterministic policy takes the likeliest of each."""
        key_option, key_action = jax.random.split(key)
        log_option = self.option_log_probs(params, obs, self.previous_option(memory))
        option = drawn_option(log_option, key_option, deterministic)
        policy = self.policy(params, obs, option)
        action = policy.mode() if deterministic else policy.sample(seed=key_action)
        return action, self.remember(memory, option), option

    def option_of(self, record: jax.Array) -> jax.Array:
        """Return the options that were executed."""
        return record

    def value_of(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return V[s, o_{t-1}] = sum_o P(o | s, o_{t-1}) Q_O[s, o], of shape [...]."""
        log_option = self.option_log_probs(params, obs, self.previous_option(memory))
        return expected_value(log_option, self.every_q(params, obs, memory))

    def option_probs(self, params: Any, obs: jax.Array, memory: jax.Array) -> jax.Array:
        """Return P(o_t | s_t, o_{t-1}) [..., K]."""
        return jnp.exp(self.option_log_probs(params, obs, self.previous_option(memory)))
