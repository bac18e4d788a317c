"""An SMDP with options, and the master policy that makes it an MDP (sec. 2 and App. C.2)."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct

from hitmdp_jax.errors import UsageError


@struct.dataclass
class OptionModel:
    """A finite SMDP option framework: S states, A actions, K Markovian options (sec. 2).

    The rows of every distribution sum to one, with one exception: where a row of `transition` sums
    to less, the missing mass ends the episode, and nothing is earned after it. Rewards are
    deterministic given (s, a). `check` looks for mistakes.
    """

    transition: jax.Array  # [S, A, S] P(s' | s, a)
    reward: jax.Array  # [S, A] r(s, a)
    master: jax.Array  # [S, K] P(o | s), the SMDP master policy
    termination: jax.Array  # [K, S] P_o(b = 1 | s)
    action: jax.Array  # [K, S, A] P_o(a | s), the intra-option policies
    gamma: jax.Array | float  # discount factor; below 1 unless every policy's episodes end
    initiation: jax.Array | None = None  # [K, S] bool, s in I_o; everywhere if None


def as_float(x: jax.typing.ArrayLike) -> jax.Array:
    """Return x in float64 where x64 is enabled, else in float32."""
    return jnp.asarray(x, jnp.result_type(float))


def check(model: OptionModel, tolerance: float = 1e-6) -> OptionModel:
    """Return the model unchanged, having checked its shapes and distributions. Not for tracers.

    Raises:
      UsageError: a shape disagrees, a distribution does not sum to one, gamma is out of range, or
        no option may start in some state where one is needed.
    """
    arrays = {name: np.asarray(value) for name, value in vars(model).items() if value is not None}
    if arrays["reward"].ndim != 2 or arrays["master"].ndim != 2:
        raise UsageError(
            f"reward must be [S, A] and master [S, K]; got {arrays['reward'].shape} and "
            f"{arrays['master'].shape}."
        )
    (num_states, num_actions), num_options = arrays["reward"].shape, arrays["master"].shape[1]
    shapes = {
        "transition": (num_states, num_actions, num_states),
        "master": (num_states, num_options),
        "termination": (num_options, num_states),
        "action": (num_options, num_states, num_actions),
        "initiation": (num_options, num_states),
        "gamma": (),
    }
    for name, shape in shapes.items():
        if name in arrays and arrays[name].shape != shape:
            raise UsageError(
                f"{name} has shape {arrays[name].shape}; S = {num_states}, A = {num_actions}, "
                f"K = {num_options} need {shape}."
            )
    for name in ("transition", "master", "action", "termination"):
        probabilities, totals = arrays[name], arrays[name].sum(-1)
        if not np.all((probabilities >= 0) & (probabilities <= 1 + tolerance)):
            raise UsageError(f"{name} has entries outside [0, 1].")
        if name == "transition" and np.any(totals > 1 + tolerance):
            raise UsageError(f"a row of transition sums to {totals.max():.6g}; at most 1 is valid.")
        if name in ("master", "action") and np.any(np.abs(totals - 1) > tolerance):
            worst = totals.flat[np.abs(totals - 1).argmax()]
            raise UsageError(f"a row of {name} sums to {worst:.6g}; 1 is valid.")
    endless = np.all(arrays["transition"].sum(-1) >= 1 - tolerance)
    if not 0 <= arrays["gamma"] <= 1 or (arrays["gamma"] == 1 and endless):
        raise UsageError(
            f"gamma is {arrays['gamma']:.6g}; 0 <= gamma < 1 is valid, or 1 where episodes end."
        )
    if "initiation" in arrays:
        stuck = np.flatnonzero((arrays["master"] * arrays["initiation"].T).sum(-1) <= 0)
        if stuck.size:
            raise UsageError(f"the master policy picks no option that may start in states {stuck}.")
    return model


def sample_option_model(
    key: jax.Array,
    num_states: int,
    num_options: int,
    num_actions: int,
    gamma: jax.Array | float,
    concentration: float = 1.0,
) -> OptionModel:
    """Draw an option framework whose episodes never end (sec. 2).

    Args:
      key: PRNG key.
      num_states: S.
      num_options: K.
      num_actions: A.
      gamma: discount factor, below 1.
      concentration: of the symmetric Dirichlet that every distribution is drawn from; at 1 they are
        uniform over the simplex, below it most of the mass falls on a few outcomes.

    Returns:
      A model with standard normal rewards and termination probabilities uniform in [0, 1].
    """
    keys = jax.random.split(key, 5)
    dtype = jnp.result_type(float)

    def distributions(key: jax.Array, *shape: int) -> jax.Array:
        alpha = jnp.full(shape[-1], concentration, dtype)
        return jax.random.dirichlet(key, alpha, shape[:-1], dtype)

    return OptionModel(
        transition=distributions(keys[0], num_states, num_actions, num_states),
        reward=jax.random.normal(keys[1], (num_states, num_actions), dtype),
        master=distributions(keys[2], num_states, num_options),
        termination=jax.random.uniform(keys[3], (num_options, num_states), dtype),
        action=distributions(keys[4], num_options, num_states, num_actions),
        gamma=gamma,
    )


def initiable_master_policy(model: OptionModel) -> jax.Array:
    """Return P(o | s) [S, K] over the options that may start in s: the master, renormalised.

    The paper defines initiation sets (sec. 2) and then never uses them; Eq. 1 holds for this P.
    """
    master = as_float(model.master)
    if model.initiation is None:
        return master
    allowed = jnp.where(jnp.asarray(model.initiation, bool).T, master, 0.0)
    return allowed / allowed.sum(-1, keepdims=True)


def mixture_master_policy(model: OptionModel) -> jax.Array:
    r"""Return the mixture master policy P(o_t | s_t, b_t, o_{t-1}) [2, S, K_prev, K] (Eq. 3, 19).

    .. math::
      P(o_t | s_t, b_t, o_{t-1}) = P(o_t | s_t)^{b_t} \, 1[o_t = o_{t-1}]^{1 - b_t}

    The first axis is b_t: at 0 the option goes on, at 1 the master policy picks anew.
    """
    master = initiable_master_policy(model)
    num_states, num_options = master.shape
    identity = jnp.eye(num_options, dtype=master.dtype)
    go_on = jnp.broadcast_to(identity, (num_states, num_options, num_options))
    pick = jnp.broadcast_to(master[:, None, :], go_on.shape)
    return jnp.stack([go_on, pick])


def markovian_master_policy(model: OptionModel) -> jax.Array:
    r"""Return the Markovian master policy P(o_t | s_t, o_{t-1}) [S, K_prev, K] (Eq. 22).

    The termination b_t is summed out of the mixture master policy:

    .. math::
      P(o_t | s_t, o_{t-1}) = (1 - \beta_{o_{t-1}}(s_t)) \, 1[o_t = o_{t-1}]
        + \beta_{o_{t-1}}(s_t) P(o_t | s_t)

    Not every P(o_t | s_t, o_{t-1}) has this form: its trace over options is at least one, so a
    HiT-MDP may alternate between options in a way that no SMDP over the same options can.
    """
    go_on, pick = mixture_master_policy(model)
    terminate = as_float(model.termination).T[:, :, None]  # [S, K_prev, 1]
    return (1.0 - terminate) * go_on + terminate * pick
