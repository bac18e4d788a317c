"""The Thanksgiving turkey: actions that change only later rewards (App. A)."""

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State

ROAST_THRESHOLD = 0.0  # actions above it roast, others stuff


class Turkey(Env):
    """Stuff the turkey, then roast it; the camera shows only whether it is raw or cooked.

    Observation [2]: one-hot of raw and cooked. Action [1]: positive roasts, else stuffs. Stuffing
    is rewarded 0. Roasting terminates the episode with reward 10 if the turkey is stuffed and -10
    if not; so does the second action, whatever it is. The best return is 10. A policy of the
    observation alone that roasts with probability p gets -10 p + 10 p (1 - p) = -10 p^2, at best 0:
    what was done before must be remembered.

    Args:
      stuffed_reward: for roasting a stuffed turkey.
      plain_reward: for roasting a plain one.
    """

    episode_length = 2
    observation_size = 2  # pyright: ignore[reportAssignmentType]
    action_size = 1  # pyright: ignore[reportAssignmentType]
    backend = "none"  # pyright: ignore[reportAssignmentType]
    traced = ("stuffed_reward", "plain_reward")

    def __init__(self, stuffed_reward: float = 10.0, plain_reward: float = -10.0):
        self.stuffed_reward, self.plain_reward = stuffed_reward, plain_reward

    def reset(self, rng: jax.Array) -> State:
        """Return the raw, plain turkey; there is nothing random in it."""
        zero = jnp.zeros((), jnp.float32)
        raw = jnp.array([1.0, 0.0], jnp.float32)
        return State(None, raw, reward=zero, done=zero, info={"stuffed": zero})

    def step(self, state: State, action: jax.Array) -> State:
        """Stuff or roast."""
        roast = (action[0] > ROAST_THRESHOLD).astype(jnp.float32)
        outcome = jnp.where(state.info["stuffed"] > 0, self.stuffed_reward, self.plain_reward)
        return state.replace(  # pyright: ignore[reportAttributeAccessIssue]
            obs=jnp.stack([1.0 - roast, roast]),
            reward=roast * outcome,
            done=jnp.maximum(roast, state.info["stuffed"]),
            info=state.info | {"stuffed": jnp.ones((), jnp.float32)},
        )
