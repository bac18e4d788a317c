"""The master policy P(o_t | s_t, o_{t-1}) as attention clustering over option embeddings."""

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.networks.mlp import MLP, orthogonal, select

MASTER_POLICIES = ("similarity", "printed")


class OptionEncoder(nn.Module):
    """Scores each option embedding by how close it is to the projected pair [s_t, o_{t-1}].

    As printed (Eq. 48-49, App. G.1): q = Dense(FFN([s, W[o]])), x = LayerNorm(q + MHA(q, W, W)),
    logits = Dense(FFN(x)). Nothing there ties a logit to the similarity of q and W[o_{t-1}], so
    the paper's "a vector is closest to itself" (sec. 3.2) does not come out and options last one or
    two steps. The `similarity` form makes the sentence true: q gains W[o_{t-1}] and the logits gain
    c q W^T / sqrt(E).

    Attributes:
      master_policy: "similarity" or "printed".
      sizes: widths of each FFN.
      activation: a name of `mlp.ACTIVATIONS`.
      head_gain: gain of the logits' layer; small makes the first policy nearly uniform.
      input_scale: what the query's body reads W multiplied by.
    """

    master_policy: str = "similarity"
    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    head_gain: float = 0.01
    input_scale: float = 1.0

    @nn.compact
    def __call__(
        self, obs: jax.Array, previous: jax.Array, embeddings: jax.Array, similarity: jax.Array
    ) -> jax.Array:
        """Return the logits of the next option.

        Args:
          obs: [..., O] normalised observations.
          previous: [...] int, the options o_{t-1}.
          embeddings: [K, E], W.
          similarity: c, the weight of the similarity logits; unused in the printed form.

        Returns:
          [..., K] logits.
        """
        num_options, width = embeddings.shape
        by_similarity = self.master_policy == "similarity"
        # Under similarity a query starts as W[o_{t-1}] itself and learns how a state moves it: with
        # gain 1 options last 2 steps after 1M steps of HalfCheetah, with 0.01 they last 15.
        query_gain = self.head_gain if by_similarity else 1.0
        query = nn.Dense(width, kernel_init=orthogonal(query_gain), name="query")(
            MLP(self.sizes, self.activation, name="query_body")(
                obs, self.input_scale * embeddings, previous
            )
        )
        if by_similarity:
            query = query + select(embeddings, previous)
        attended = Attention(width, name="attention")(query, embeddings)
        clustered = nn.LayerNorm(name="norm")(query + attended)
        head = nn.Dense(num_options, kernel_init=orthogonal(self.head_gain), name="logits")
        logits = head(MLP(self.sizes, self.activation, name="logits_body")(clustered))
        if by_similarity:
            logits = logits + similarity * query @ embeddings.T / jnp.sqrt(width)
        return logits


class Attention(nn.Module):
    """Attention of one head (Eq. 46-47) from many queries to few keys, which are the values, too.

    Equals `flax.linen.MultiHeadDotProductAttention`. There the projections of queries and results
    are products of the size of the batch; q' k = q (Wq k) and sum_k w_k v_k Wo = sum_k w_k (v_k Wo)
    leave products of the size of K, which takes a tenth off an update.

    Attributes:
      width: E.
    """

    width: int

    @nn.compact
    def __call__(self, query: jax.Array, rows: jax.Array) -> jax.Array:
        """Map queries [..., E] and rows [K, E] to [..., E]."""

        def projection(name: str) -> tuple[jax.Array, jax.Array]:
            kernel = nn.initializers.lecun_normal()
            return (
                self.param(f"{name}_kernel", kernel, (self.width, self.width), jnp.float32),
                self.param(f"{name}_bias", nn.initializers.zeros, (self.width,), jnp.float32),
            )

        (w_query, b_query), (w_key, b_key) = projection("query"), projection("key")
        (w_value, b_value), (w_out, b_out) = projection("value"), projection("out")
        keys, values = rows @ w_key + b_key, rows @ w_value + b_value
        scores = query @ (w_query @ keys.T) + b_query @ keys.T
        weights = nn.softmax(scores / jnp.sqrt(self.width))
        self.sow("intermediates", "weights", weights)  # kept where they are asked for
        return weights @ (values @ w_out) + b_out
