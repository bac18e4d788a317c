"""The master policy P(o_t | s_t, o_{t-1}) as attention clustering over option embeddings."""

import flax.linen as nn
import jax
import jax.numpy as jnp

from hitmdp_jax.networks.mlp import MLP, orthogonal

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
      activation: "relu" or "tanh".
      head_gain: gain of the logits' layer; small makes the first policy nearly uniform.
    """

    master_policy: str = "similarity"
    sizes: tuple[int, ...] = (64, 64)
    activation: str = "relu"
    head_gain: float = 0.01

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
        previous_embedding = embeddings[previous]
        # Under similarity a query starts as W[o_{t-1}] itself and learns how a state moves it: with
        # gain 1 options last 2 steps after 1M steps of HalfCheetah, with 0.01 they last 15.
        query_gain = self.head_gain if by_similarity else 1.0
        query = nn.Dense(width, kernel_init=orthogonal(query_gain), name="query")(
            MLP(self.sizes, self.activation, name="query_body")(obs, previous_embedding)
        )
        if by_similarity:
            query = query + previous_embedding
        # The batch is the attention's sequence of queries: keys and values, which depend on the
        # embeddings alone, are projected once instead of once a sample.
        attention = nn.MultiHeadDotProductAttention(num_heads=1, name="attention")
        attended = attention(query.reshape(-1, width), embeddings).reshape(query.shape)
        clustered = nn.LayerNorm(name="norm")(query + attended)
        head = nn.Dense(num_options, kernel_init=orthogonal(self.head_gain), name="logits")
        logits = head(MLP(self.sizes, self.activation, name="logits_body")(clustered))
        if by_similarity:
            logits = logits + similarity * query @ embeddings.T / jnp.sqrt(width)
        return logits
