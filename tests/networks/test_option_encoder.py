import functools

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax

from hitmdp_jax.networks.mlp import MLP
from hitmdp_jax.networks.option_encoder import MASTER_POLICIES, OptionEncoder

B, O, K, E = 6, 5, 4, 8  # noqa: E741


@pytest.fixture(scope="module")
def case():
    random = np.random.default_rng(0)
    obs, embeddings = random.normal(size=(B, O)), random.normal(size=(K, E))
    return jax.device_put((obs, random.integers(K, size=B), embeddings))


def encoder(form):
    return OptionEncoder(form, sizes=(16, 16))


@functools.partial(jax.jit, static_argnums=0)
def initialized(form, key, case):
    params = encoder(form).init(key, *case, 0.75)
    # Biases start at zero, where an error in them would not show.
    return jax.tree.map(lambda x: x + 0.1 * jax.random.normal(key, x.shape), params)


@functools.partial(jax.jit, static_argnums=0)
def encode(form, variables, case, similarity):
    return encoder(form).apply(variables, *case, similarity)


@functools.partial(jax.jit, static_argnums=1)
def query_of(params, form, obs, previous, embeddings):
    body = MLP((16, 16)).apply({"params": params["query_body"]}, obs, embeddings, previous)
    query = body @ params["query"]["kernel"] + params["query"]["bias"]
    return query + (embeddings[previous] if form == "similarity" else 0.0)


@jax.jit
def logits_of(params, query, attended):
    x = nn.LayerNorm().apply({"params": params["norm"]}, query + attended)
    x = MLP((16, 16)).apply({"params": params["logits_body"]}, x)
    return x @ params["logits"]["kernel"] + params["logits"]["bias"]


def attention_by_hand(params, query, embeddings):
    """Eq. 46-47 in NumPy, with one head."""

    def project(name, x):
        return x @ np.asarray(params[f"{name}_kernel"]) + np.asarray(params[f"{name}_bias"])

    q, k, v = project("query", query), project("key", embeddings), project("value", embeddings)
    return project("out", softmax(q @ k.T / np.sqrt(E), axis=-1) @ v)


def of_one_head(params):
    """Return the parameters as Flax lays them out, with an axis for the head."""
    axes = {"out_kernel": 0, "out_bias": ()} | {
        f"{name}_bias": 0 for name in ("query", "key", "value")
    }
    laid_out: dict = {"query": {}, "key": {}, "value": {}, "out": {}}
    for name, x in params.items():
        part, kind = name.split("_")
        laid_out[part][kind] = jnp.expand_dims(x, axes.get(name, 1))
    return laid_out


@functools.partial(jax.jit, static_argnums=1)
def logits_by_flax(params, form, obs, previous, embeddings):
    """Flax's module called as documented, one sample with its own copy of keys and values."""
    query = query_of(params, form, obs, previous, embeddings)
    copies = jnp.broadcast_to(embeddings, (B, K, E))
    flax_attention = nn.MultiHeadDotProductAttention(num_heads=1)
    attended = flax_attention.apply(
        {"params": of_one_head(params["attention"])}, query[:, None], copies
    )[:, 0]
    expected = logits_of(params, query, attended)
    if form == "similarity":
        expected += 0.75 * query @ embeddings.T / jnp.sqrt(E)
    return expected


@pytest.mark.parametrize("form", MASTER_POLICIES)
def test_encoder_equals_flax_attention_on_each_sample(form, key, case):
    variables = initialized(form, key, case)
    expected = logits_by_flax(variables["params"], form, *case)
    logits = encode(form, variables, case, 0.75)
    np.testing.assert_allclose(logits, expected, rtol=1e-4, atol=1e-5)


def test_attention_equals_the_printed_equations(key, case):
    variables = initialized("printed", key, case)
    params = variables["params"]
    query = query_of(params, "printed", *case)
    attended = attention_by_hand(params["attention"], np.asarray(query), np.asarray(case[2]))
    np.testing.assert_allclose(
        encode("printed", variables, case, 0.0),
        logits_of(params, query, attended),
        rtol=1e-4,
        atol=1e-5,
    )


def test_similarity_makes_an_option_its_own_nearest_neighbour(key):
    random = np.random.default_rng(0)
    embeddings, obs = random.normal(size=(4, 40)), random.normal(size=(64, O))
    previous = np.arange(64) % 4

    @functools.partial(jax.jit, static_argnums=0)
    def stay(form, key):
        arguments = obs, previous, jnp.asarray(embeddings), 0.75
        logits, _ = OptionEncoder(form).init_with_output(key, *arguments)
        return jax.nn.softmax(logits)[jnp.arange(64), previous].mean()

    assert stay("similarity", key) > 0.9
    np.testing.assert_allclose(stay("printed", key), 0.25, atol=0.05)


def test_similarity_weight_is_traced(key, case):
    variables = initialized("similarity", key, case)
    logits = [encode("similarity", variables, case, c) for c in (0.0, 1.0)]
    assert not np.allclose(*logits)
