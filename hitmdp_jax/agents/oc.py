"""OC: the Option-Critic (Bacon, Harb & Precup 2017), as an n-step actor-critic."""

from typing import Any

import jax
import jax.numpy as jnp
from flax import struct

from hitmdp_jax.agents.base import LearnerState, static, traced
from hitmdp_jax.agents.option_agent import OptionAgent
from hitmdp_jax.envs.spec import Spec
from hitmdp_jax.learning.optimization import gradient_step
from hitmdp_jax.learning.options import at_option, expected_value, termination_objective
from hitmdp_jax.learning.rollout import Batch
from hitmdp_jax.metrics import Metrics
from hitmdp_jax.networks import OptionHeads


class TargetNetwork(struct.PyTreeNode):
    """An old copy of the parameters, which the critic bootstraps from."""

    params: Any
    age: jax.Array  # int32, steps of each environment since it was copied


class TargetState(LearnerState):
    """What an update of OC changes."""

    target: TargetNetwork


class OC(OptionAgent):
    """Learns Q[s, o], and from it the terminations and, by policy gradient, the action policies.

    The master is epsilon-greedy in Q; its network is idle. After each short rollout (n = 5 steps of
    a few environments) comes one gradient step on the sum of three losses: the squared error of
    Q[s_t, o_t] to the n-step return R_t; the policy gradient of pi_o(a | s) with advantage
    R_t - Q[s_t, o_t] and an entropy bonus; the termination gradient with Q's advantage of going on
    over choosing anew. Returns bootstrap from a target network's value of arriving with o_t,
    (1 - beta_o(s')) Q[s', o] + beta_o(s') max_o' Q[s', o'].

    Against PPOC: no learnt master, no clipped surrogate, no GAE, each sample used once. Against
    MOPG also: options last by their terminations.
    """

    entropy_weight: float = traced(0.01)  # of pi_o(a | s)
    termination_regularizer: float = traced(0.01)  # advantage granted to going on
    epsilon: float = traced(0.1, high=1.0)  # of the master, constant
    target_period: int = static(1000)  # steps of each environment between copies

    def heads(self, params: Any, obs: jax.Array) -> OptionHeads:
        """Evaluate the network in states [..., O], the epsilon-greedy policy as the master."""
        heads = super().heads(params, obs)
        best = jax.nn.one_hot(heads.value.argmax(-1), self.num_options, dtype=jnp.float32)
        master = self.epsilon / self.num_options + (1.0 - self.epsilon) * best
        return heads.replace(log_master=jnp.log(master))

    def init(self, key: jax.Array, spec: Spec) -> TargetState:
        """Return new parameters, optimiser state and target network for a task."""
        new = super().init(key, spec)
        target = TargetNetwork(new.params, jnp.zeros((), jnp.int32))
        return TargetState(new.params, new.opt_state, target)

    def update(
        self, state: TargetState, batch: Batch, key: jax.Array
    ) -> tuple[TargetState, Metrics]:
        """Take one gradient step, and copy the target network when it is due."""
        batch, target = batch.normalized(), state.target
        data, metrics = self.targets(state.params, batch)
        reached = self.value_upon_arrival(target.params, batch.next_obs, batch.record)
        data["q_target"] = self.returns(batch, reached)
        params, opt_state, diagnostics = gradient_step(
            self.loss, self.optimizer(), state.params, state.opt_state, data
        )
        age = target.age + len(batch.reward)
        due = age >= self.target_period
        target = TargetNetwork(
            jax.tree.map(lambda new, old: jnp.where(due, new, old), params, target.params),
            jnp.where(due, 0, age),
        )
        return TargetState(params, opt_state, target), metrics | diagnostics

    def value_upon_arrival(self, params: Any, obs: jax.Array, option: jax.Array) -> jax.Array:
        """Return U[s, o], of shape [...]: the value of reaching s during o (Bacon's Eq. 3)."""
        heads = self.heads(params, obs)
        stop = jax.nn.sigmoid(at_option(heads.termination, option))
        return (1.0 - stop) * at_option(heads.value, option) + stop * heads.value.max(-1)

    def loss(self, params: Any, data: dict[str, Any]) -> tuple[jax.Array, Metrics]:
        """Return a rollout's loss [T, B]: critic, action policies, terminations."""
        heads, option = self.heads(params, data["obs"]), data["option"]
        q, policy = at_option(heads.value, option), heads.policy(option)
        advantage = jax.lax.stop_gradient(data["q_target"] - q)
        actor = (policy.log_prob(data["action"]) * advantage).mean()
        bonus = self.entropy_weight * policy.entropy().mean()
        choosing_anew = expected_value(heads.log_master, heads.value)
        termination = termination_objective(
            heads.termination,
            heads.value,
            choosing_anew,
            data["memory"],
            self.termination_regularizer,
        ).mean()
        value_loss = 0.5 * jnp.square(q - data["q_target"]).mean()
        loss = value_loss + termination - actor - bonus
        return loss, {"value_loss": value_loss, "termination_loss": termination}
