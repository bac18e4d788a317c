"""PyTorch's start, by the bounds that its documentation gives for `Linear` and for attention."""

import jax
import numpy as np
from scipy import stats

from hitmdp_jax import make_env, spec_of
from hitmdp_jax.agents.mopg import MOPG

SIZE, OPTIONS, EMBEDDING, WIDTH = 17, 4, 40, 64  # of HalfCheetah and MOPG's defaults
LAYERS = {
    # 1 / bound^2: the layer's number of inputs
    "critic/body/input_0": SIZE + OPTIONS,
    "critic/body/input_1": SIZE + OPTIONS,
    "critic/body/hidden_1": WIDTH,
    "critic/value": WIDTH,
    "decoder/body/input_0": SIZE + EMBEDDING,
    "decoder/body/input_1": SIZE + EMBEDDING,
    "decoder/mean": WIDTH,
    "encoder/query_body/input_0": SIZE + EMBEDDING,
    "encoder/query": WIDTH,
    "encoder/logits_body/input_0": EMBEDDING,
    "encoder/logits": WIDTH,
}
AS_WRITTEN = ("embeddings", "critic/scale", "critic/shift", "decoder/log_std", "encoder/norm")


def start(initialization):
    spec = spec_of(make_env("halfcheetah", physics="native"))
    agent = MOPG(initialization=initialization, master_policy="printed", embeddings="normal")
    return agent.init(jax.random.key(0), spec).params


def at(params, path):
    for name in path.split("/"):
        params = params[name]
    return params


def is_uniform(x, bound):
    x = np.asarray(x).ravel()
    assert np.abs(x).max() <= bound
    assert stats.kstest(x, stats.uniform(-bound, 2 * bound).cdf).pvalue > 1e-4


def test_layers_start_uniform_within_one_over_the_root_of_their_inputs():
    params = start("pytorch")
    for path, inputs in LAYERS.items():
        layer = at(params, path)
        is_uniform(layer["kernel"], inputs**-0.5)
        if "bias" in layer:
            is_uniform(layer["bias"], inputs**-0.5)


def test_an_attention_starts_as_pytorchs_does():
    attention = start("pytorch")["encoder"]["attention"]
    for name in ("query", "key", "value"):
        # Xavier's bound of the matrix [3 E, E] that holds all three
        is_uniform(attention[f"{name}_kernel"], (6 / (EMBEDDING + 3 * EMBEDDING)) ** 0.5)
    is_uniform(attention["out_kernel"], EMBEDDING**-0.5)
    for name in ("query", "key", "value", "out"):
        assert not np.any(attention[f"{name}_bias"])


def test_no_two_layers_start_alike_and_the_rest_stays():
    params, before = start("pytorch"), start("orthogonal")
    kernels = [x.ravel()[:8] for x in jax.tree.leaves(params) if x.ndim == 2 and x.size > 8]
    assert len(np.unique(np.stack(kernels), axis=0)) == len(kernels)
    for path in AS_WRITTEN:
        jax.tree.map(np.testing.assert_array_equal, at(params, path), at(before, path))
