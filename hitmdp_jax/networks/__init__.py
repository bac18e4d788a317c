"""Flax modules: the option encoder, the decoders, the option heads and the body they share."""

from hitmdp_jax.networks.decoders import ActionCritic, ActionDecoder, Critic
from hitmdp_jax.networks.directions import OptionDirections
from hitmdp_jax.networks.initialization import INITIALIZATIONS, pytorch_start
from hitmdp_jax.networks.mlp import MLP
from hitmdp_jax.networks.option_encoder import MASTER_POLICIES, OptionEncoder
from hitmdp_jax.networks.option_heads import OptionHeads, OptionNetwork
from hitmdp_jax.networks.reads import Reads, read
from hitmdp_jax.networks.squashed import SquashedHead, TanhGaussian

__all__ = [
    "INITIALIZATIONS",
    "MASTER_POLICIES",
    "MLP",
    "ActionCritic",
    "ActionDecoder",
    "Critic",
    "OptionDirections",
    "OptionEncoder",
    "OptionHeads",
    "OptionNetwork",
    "Reads",
    "SquashedHead",
    "TanhGaussian",
    "pytorch_start",
    "read",
]
