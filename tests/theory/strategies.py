"""Random finite models for hypothesis, edge cases included, and fixed ones by seed.

Both kinds have arrays of the same shapes and types, so that they share compiled programs.
"""

import hypothesis.extra.numpy as hnp
import hypothesis.strategies as st
import numpy as np
from hypothesis import settings

from hitmdp_jax.theory import HiTMDP, OptionModel

SHAPE = (2, 3, 4)  # (S, K, A), all different; one shape, because each is compiled anew
ENTROPIES = ("option_entropy", "action_entropy")
TINY = (2, 2, 2)  # small enough to enumerate trajectories

few = settings(max_examples=25, database=None)


@st.composite
def distributions(draw, *shape, interior=False):
    """Draw distributions over the last axis; without `interior`, zeros are common."""
    weights = draw(hnp.arrays(np.int8, shape, elements=st.integers(int(interior), 4)))
    weights = weights.astype(float)
    weights[weights.sum(-1) == 0] = 1.0
    return weights / weights.sum(-1, keepdims=True)


def tables(*shape, low=-4, high=4, scale=0.5):
    """Draw arrays of multiples of `scale`."""
    values = hnp.arrays(np.int8, shape, elements=st.integers(low, high))
    return values.map(lambda x: x * scale)


gammas = st.sampled_from([0.0, 0.5, 0.9, 0.99]).map(np.asarray)


@st.composite
def option_models(draw, shape=SHAPE):
    """Draw SMDP option models; terminations of 0 and 1 are common."""
    s, k, a = shape
    return OptionModel(
        transition=draw(distributions(s, a, s)),
        reward=draw(tables(s, a)),
        master=draw(distributions(s, k)),
        termination=draw(tables(k, s, low=0, scale=0.25)),
        action=draw(distributions(k, s, a)),
        gamma=draw(gammas),
    )


@st.composite
def hit_mdps(draw, shape=SHAPE, interior=True, soft=True):
    """Draw HiT-MDPs with any master policy; `soft` gives them intrinsic rewards."""
    s, k, a = shape
    weights = st.sampled_from([0.0, 0.3, 1.0]) if soft else st.just(0.0)
    return HiTMDP(
        transition=draw(distributions(s, a, s)),
        reward=draw(tables(s, a)),
        master=draw(distributions(s, k, k, interior=interior)),
        action=draw(distributions(k, s, a, interior=interior)),
        gamma=draw(gammas),
        information=draw(tables(s, k, k, a)) if soft else np.zeros((s, k, k, a)),
        option_entropy=np.asarray(draw(weights)),
        action_entropy=np.asarray(draw(weights)),
    )


@st.composite
def with_start(draw, models, interior=False):
    """Draw a model, and a joint distribution [S, K] over a state and an option of it."""
    model = draw(models)
    s, k = model.master.shape[0], model.master.shape[-1]
    start = draw(distributions(s * k, interior=interior))
    return model, start.reshape(s, k)


def random_option_model(seed=0, shape=SHAPE, gamma=0.9):
    """Return a model without zeros."""
    s, k, a = shape
    rng = np.random.default_rng(seed)
    return OptionModel(
        transition=rng.dirichlet(np.ones(s), (s, a)),
        reward=rng.normal(size=(s, a)),
        master=rng.dirichlet(np.ones(k), s),
        termination=rng.uniform(size=(k, s)),
        action=rng.dirichlet(np.ones(a), (k, s)),
        gamma=np.asarray(gamma),
    )


def random_hit_mdp(seed=0, shape=SHAPE, gamma=0.9, **soft):
    """Return a HiT-MDP without zeros."""
    s, k, a = shape
    rng = np.random.default_rng(seed)
    weights = {name: np.asarray(soft.pop(name, 0.0)) for name in ENTROPIES}
    return HiTMDP(
        transition=rng.dirichlet(np.ones(s), (s, a)),
        reward=rng.normal(size=(s, a)),
        master=rng.dirichlet(np.ones(k), (s, k)),
        action=rng.dirichlet(np.ones(a), (k, s)),
        gamma=np.asarray(gamma),
        information=soft.pop("information", np.zeros((s, k, k, a))),
        **weights,
        **soft,
    )
