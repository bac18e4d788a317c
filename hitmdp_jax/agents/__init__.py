"""The algorithms, one file each, behind one protocol."""

from hitmdp_jax.agents.ahp import AHP
from hitmdp_jax.agents.base import Agent, LearnerState
from hitmdp_jax.agents.dac import DAC
from hitmdp_jax.agents.iopg import IOPG
from hitmdp_jax.agents.mopg import MOPG
from hitmdp_jax.agents.oc import OC
from hitmdp_jax.agents.ppo import PPO
from hitmdp_jax.agents.ppoc import PPOC

AGENTS = {
    "mopg": MOPG,
    "ppo": PPO,
    "dac": DAC,
    "ahp": AHP,
    "iopg": IOPG,
    "ppoc": PPOC,
    "oc": OC,
}

__all__ = [
    "AGENTS",
    "AHP",
    "DAC",
    "IOPG",
    "MOPG",
    "OC",
    "PPO",
    "PPOC",
    "Agent",
    "LearnerState",
]
