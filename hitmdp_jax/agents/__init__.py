"""The algorithms, one file each, behind one protocol."""

from hitmdp_jax.agents.base import Agent, LearnerState
from hitmdp_jax.agents.dac import DAC
from hitmdp_jax.agents.mopg import MOPG
from hitmdp_jax.agents.ppo import PPO

AGENTS = {"mopg": MOPG, "ppo": PPO, "dac": DAC}

__all__ = ["AGENTS", "DAC", "MOPG", "PPO", "Agent", "LearnerState"]
