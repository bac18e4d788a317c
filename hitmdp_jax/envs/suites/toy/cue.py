"""A cue, a corridor and a turn: a task that asks for a memory and for nothing else."""

import jax
import jax.numpy as jnp
from brax.envs.base import State

from hitmdp_jax.checks import MOST, check_size
from hitmdp_jax.envs.spec import Discrete, Observation, Spec
from hitmdp_jax.envs.spec_task import SpecTask

SEEN = ("cue left", "cue right", "corridor", "junction")


class Cue(SpecTask):
    """See a cue, walk down a corridor, and turn to the side that the cue showed.

    Observation [4], one-hot: the cue (left or right, each with probability 1/2) in the first step,
    then the corridor, at last the junction. Action: 0 turns left and 1 turns right; it counts at
    the junction alone. The turn ends the episode, with reward 1 to the cue's side and -1 to the
    other. The best return is 1; a policy of the observation alone gets 0, whatever it does. It is
    the T-maze of Bakker 2001, in which the walk is not to be learned.

    Args:
      length: steps from the cue to the junction.
    """

    def __init__(self, length: int = 10):
        check_size("length", length, MOST)
        self._length = length
        self.spec = Spec(
            Observation((len(SEEN),), names=SEEN), Discrete(2, ("left", "right")), length + 1
        )

    def reset(self, rng: jax.Array) -> State:
        """Show a cue."""
        zero = jnp.zeros((), jnp.float32)
        side = jax.random.bernoulli(rng).astype(jnp.int32)
        info = {"side": side, "walked": jnp.zeros((), jnp.int32)}
        return State(None, jax.nn.one_hot(side, len(SEEN)), zero, zero, {"success": zero}, info)

    def step(self, state: State, action: jax.Array) -> State:
        """Walk on; at the junction, turn."""
        walked = state.info["walked"] + 1
        turned = walked > self._length
        right = (action == state.info["side"]) & turned
        seen = jnp.where(walked >= self._length, SEEN.index("junction"), SEEN.index("corridor"))
        return state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            obs=jax.nn.one_hot(seen, len(SEEN)),
            reward=jnp.where(turned, jnp.where(right, 1.0, -1.0), 0.0),
            done=turned.astype(jnp.float32),
            metrics=state.metrics | {"success": right.astype(jnp.float32)},
            info=state.info | {"walked": walked},
        )
