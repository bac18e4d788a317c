"""SAC: soft actor-critic (Haarnoja et al. 2018, arXiv 1812.05905), off policy, without options."""

import math
from typing import Any, Self

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import struct

from hitmdp_jax.agents.base import LearnerState, static, traced
from hitmdp_jax.agents.gradient_agent import GradientAgent
from hitmdp_jax.envs.spec import Action, Discrete, Spec
from hitmdp_jax.errors import UsageError
from hitmdp_jax.learning import replay as replays
from hitmdp_jax.learning.normalization import normalize
from hitmdp_jax.learning.optimization import gradient_step
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.mesh import for_all
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import ActionCritic, Reads, SquashedHead, TanhGaussian, read
from hitmdp_jax.precision import in_32_bits

CRITICS = ("critic_0", "critic_1")  # the twins, of which the lower value counts


class Transition(struct.PyTreeNode):
    """A step as the replay keeps it; of minibatches every array has an axis [N] in front."""

    obs: jax.Array  # [O], raw
    next_obs: jax.Array  # [O], raw, before any reset
    action: jax.Array  # [A], as the task takes it
    record: Any  # what the agent noted when it acted
    reward: jax.Array  # [], scaled
    done: jax.Array  # [] 1 where nothing follows; a time limit is not the end


class SACNetwork(nn.Module):
    """A tanh-Gaussian policy, twin critics and the temperature, nothing shared."""

    actions: Action
    hidden_sizes: tuple[int, ...]
    activation: str
    layer_norm: bool
    initial_temperature: jax.Array | float
    reads: Reads = Reads()

    def setup(self):
        """Declare the parts; `uniform` is 1 while actions are drawn uniformly."""
        self.actor = SquashedHead(self.actions.size, self.hidden_sizes, self.activation)
        body = self.hidden_sizes, self.activation, self.layer_norm
        self.critic_0, self.critic_1 = ActionCritic(*body), ActionCritic(*body)
        log_temperature = nn.initializers.constant(jnp.log(self.initial_temperature))
        self.log_temperature = self.param("log_temperature", log_temperature, (), jnp.float32)
        self.uniform = self.param("uniform", nn.initializers.ones, (), jnp.float32)

    def __call__(self, obs: jax.Array, *option: jax.Array) -> Any:
        """Run every part once, which initialises it."""
        mean, std = self.gaussian(obs, *option)
        return mean, std, self.q(obs, mean, *option)

    def vectors(self, *option: jax.Array) -> tuple[jax.Array, ...]:
        """Return what the bodies read of options beside the state: nothing."""
        return ()

    def gaussian(self, obs: jax.Array, *option: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return the mean and the standard deviation [..., A] before tanh, for obs [..., O]."""
        return self.actor(read(obs, self.reads.action), *self.vectors(*option))

    def q(self, obs: jax.Array, action: jax.Array, *option: jax.Array) -> jax.Array:
        """Return both critics' values [2, ...] of actions [..., A] within +-1."""
        seen, vectors = read(obs, self.reads.critic), self.vectors(*option)
        return jnp.stack([c(seen, action, *vectors) for c in (self.critic_0, self.critic_1)])


class SACState(LearnerState):
    """What an update of SAC changes."""

    target: Any  # the critics' parameters, following slowly


class SAC(GradientAgent):
    """Learns from a replay one policy that is as random as its returns allow.

    The policy's entropy is paid for at the price `temperature`, in reward per nat, which is learned
    so that the entropy comes to `target_entropy` for each of the A numbers of an action. Both
    count in units of the task's range, stretched to +-1; where it has none, that is the range.

    While the replay holds fewer than `warmup_steps`, nothing is learned. In a new training actions
    are uniform until then.
    """

    adam_eps: float = traced(1e-8, positive=True)
    max_grad_norm: float = traced(math.inf, infinite=True, positive=True)
    hidden_sizes: tuple[int, ...] = static((256, 256))
    normalize_observations: bool = static(False)
    layer_norm: bool = static(False)  # of the critics
    polyak: float = traced(0.005, high=1.0)  # how far each update moves the target critics
    initial_temperature: float = traced(1.0, positive=True)
    target_entropy: float = traced(-1.0, low=-math.inf)  # nats, times A
    update_to_data: int = static(1)  # gradient steps for each new step
    batch_size: int = static(256)
    replay_size: int = static(1_000_000)
    warmup_steps: int = static(10_000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.warmup_steps > self.replay_size:
            raise UsageError(
                f"warmup_steps = {self.warmup_steps} is more than replay_size = "
                f"{self.replay_size} can hold: lower it, or learning never begins."
            )

    def bind(self, spec: Spec) -> Self:
        """Return the agent of a task; Raises UsageError where actions are choices."""
        if isinstance(spec.action, Discrete):
            raise UsageError(
                f"{type(self).__name__} needs actions that are numbers, and here an action is "
                f"{spec.action}: take another algorithm, such as algo=mopg or algo=ppo."
            )
        return super().bind(spec)

    def network(self) -> SACNetwork:
        """Return the network for the task's actions."""
        return SACNetwork(**self.of_network())

    def of_network(self) -> dict[str, Any]:
        """Return the attributes of the network that depend on the task and on hyperparameters."""
        same = ("hidden_sizes", "activation", "layer_norm", "initial_temperature", "reads")
        return {"actions": self.actions} | {name: getattr(self, name) for name in same}

    def _apply(self, params: Any, method: str, *args: jax.Array) -> Any:
        return self.network().apply({"params": params}, *args, method=method)

    def init(self, key: jax.Array, spec: Spec) -> SACState:
        """Return new parameters, the target critics among them, and optimiser state for a task."""
        new = super().init(key, spec)
        return SACState(new.params, new.opt_state, {name: new.params[name] for name in CRITICS})

    def init_replay(self, spec: Spec) -> replays.Replay:
        """Return an empty replay of a task's transitions."""
        obs, number = jnp.zeros(spec.observation.size, jnp.float32), jnp.zeros((), jnp.float32)
        action = jnp.zeros(spec.action.shape, jnp.float32)
        one = Transition(obs, obs, action, self.blank_record(), number, number)
        return replays.empty(one, self.replay_size)

    def blank_record(self) -> Any:
        """Return an example of what the agent notes when it acts."""
        return ()

    def store(self, replay: replays.Replay, batch: Batch) -> replays.Replay:
        """Return the replay with a rollout in it."""
        done = batch.terminated
        if not self.bootstrap_on_truncation:
            done = done | batch.truncated
        kept = Transition(
            obs=jnp.asarray(batch.obs, jnp.float32),
            next_obs=jnp.asarray(batch.next_obs, jnp.float32),
            action=jnp.asarray(batch.action, jnp.float32),
            record=batch.record,
            reward=batch.reward,
            done=done.astype(jnp.float32),
        )
        return replays.add(replay, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), kept))

    def action_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the greatest action, [A] each."""
        limits = self.actions.limits
        ones = np.ones(self.actions.size, np.float32)
        return (-ones, ones) if limits is None else (limits[0], limits[1])

    def policy(self, params: Any, obs: jax.Array, option: Any = None) -> TanhGaussian:
        """Return P(a | s), a distribution, for obs [..., O]; there are no options."""
        return self.stretched(*self._apply(params, "gaussian", obs))

    def stretched(self, mean: jax.Array, std: jax.Array) -> TanhGaussian:
        """Return the policy over the task's range, given the Gaussian [..., A] before tanh."""
        low, high = self.action_range()
        return TanhGaussian(mean, std, low, high)

    def draw(
        self, params: Any, obs: jax.Array, key: jax.Array | None, *option: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Draw actions [..., A] within +-1, or take the likeliest, and return their log P [...]."""
        policy = TanhGaussian(*self._apply(params, "gaussian", obs, *option))
        return in_32_bits(
            policy.mode_and_log_prob() if key is None else policy.sample_and_log_prob(seed=key)
        )

    def soft_q(
        self, params: Any, obs: jax.Array, key: jax.Array | None, *option: jax.Array
    ) -> jax.Array:
        """Return min Q(s, a) - alpha log P(a | s) [...] of an action that the policy draws."""
        action, log_prob = self.draw(params, obs, key, *option)
        q = self._apply(params, "q", obs, action, *option).min(0)
        return q - jnp.exp(params["log_temperature"]) * log_prob

    def value_of(self, params: Any, obs: jax.Array, memory: Any) -> jax.Array:
        """Return the soft value [...] of the likeliest action."""
        return self.soft_q(params, obs, None)

    def act(
        self, params: Any, obs: jax.Array, memory: Any, key: jax.Array, deterministic: bool = False
    ) -> tuple[jax.Array, Any, Any]:
        """Draw a_t; the deterministic policy takes the likeliest."""
        key_action, key_uniform = jax.random.split(key)
        policy = self.policy(params, obs)
        if deterministic:
            return policy.mode(), memory, ()
        return self.explored(params, policy.sample(seed=key_action), key_uniform), memory, ()

    def explored(self, params: Any, action: jax.Array, key: jax.Array) -> jax.Array:
        """Return the actions [..., A], or uniform ones while a new training fills its replay."""
        low, high = self.action_range()
        uniform = jax.random.uniform(key, action.shape, jnp.float32, low, high)
        return jnp.where(params["uniform"] > 0, uniform, action)

    def update(self, state: SACState, batch: Batch, key: jax.Array) -> tuple[SACState, Metrics]:
        """Learn from the replay, `update_to_data` gradient steps for each step of the rollout."""

        def drawn(state: SACState, key: jax.Array) -> dict[str, Any]:
            # A minibatch of old steps, its observations as the policy sees them today.
            key_data, key_loss = jax.random.split(key)
            data = replays.sample(batch.replay, key_data, self.batch_size)
            seen = {x: normalize(getattr(data, x), batch.normalizer) for x in ("obs", "next_obs")}
            return {"step": data.replace(**seen), "target": state.target, "key": key_loss}

        def step(state: SACState, key: jax.Array) -> tuple[SACState, Metrics]:
            # Critics, policy and temperature take a step on one loss; the targets follow.
            data, of_adam = drawn(state, key), (state.params, state.opt_state)
            params, opt_state, metrics = gradient_step(self.loss, self.optimizer(), *of_adam, data)
            target = self.follow({name: params[name] for name in CRITICS}, state.target)
            return SACState(params, opt_state, target), metrics

        def learn(state: SACState) -> tuple[SACState, Metrics]:
            keys = jax.random.split(key, self.update_to_data * batch.reward.size)
            state, metrics = jax.lax.scan(step, state, keys)
            return state, jax.tree.map(jnp.mean, metrics)

        def wait(state: SACState) -> tuple[SACState, Metrics]:
            loss, metrics = self.loss(state.params, drawn(state, key))
            return state, metrics | {"loss": loss}

        filled = for_all(batch.replay.size >= self.warmup_steps)
        state, metrics = jax.lax.cond(filled, learn, wait, state)
        uniform = jnp.where(filled, 0.0, state.params["uniform"])
        return state.replace(params=state.params | {"uniform": uniform}), metrics

    def follow(self, critics: Any, target: Any) -> Any:
        """Return the target critics after a step towards the critics (Polyak averaging)."""
        return optax.incremental_update(critics, target, self.polyak)

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return the loss of a minibatch: the critics', the policy's and the temperature's."""
        fixed, step = jax.lax.stop_gradient(params), data["step"]
        key_target, key_policy = jax.random.split(data["key"])
        obs, action, option = self.learned_options(step)
        target = self.q_target(fixed, fixed | data["target"], step, key_target, *option)
        error = jnp.square(self._apply(params, "q", obs, action, *option) - target)
        value_loss = 0.5 * error.mean(axis=range(1, error.ndim)).sum()
        drawn, log_prob = self.draw(params, obs, key_policy, *option)
        q = self._apply(fixed, "q", obs, drawn, *option).min(0)
        temperature = jnp.exp(fixed["log_temperature"])
        policy_loss = (temperature * log_prob - q).mean()
        missing = jax.lax.stop_gradient(self.target_entropy * self.actions.size + log_prob).mean()
        loss = value_loss + policy_loss - params["log_temperature"] * missing
        return loss, {
            "value": q.mean(),
            "value_loss": value_loss,
            "action_entropy": -log_prob.mean(),
            "temperature": temperature,
        }

    def learned_options(
        self, step: Transition
    ) -> tuple[jax.Array, jax.Array, tuple[jax.Array, ...]]:
        """Return a minibatch's observations, its actions within +-1, and who learns: no option."""
        low, high = self.action_range()
        return step.obs, (2.0 * step.action - low - high) / (high - low), ()

    def q_target(
        self, params: Any, following: Any, step: Transition, key: jax.Array, *option: jax.Array
    ) -> jax.Array:
        """Return r + gamma (1 - d) (min Q'(s', a') - alpha log P(a' | s')), [N]."""
        value = self.soft_q(following, step.next_obs, key)
        return step.reward + self.gamma * (1.0 - step.done) * value
