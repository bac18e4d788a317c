"""The algorithms, one file each, behind one protocol."""

from hitmdp_jax import plugins
from hitmdp_jax.agents.ahp import AHP
from hitmdp_jax.agents.base import Agent, LearnerState, static, traced
from hitmdp_jax.agents.dac import DAC
from hitmdp_jax.agents.hit_sac import HitSAC
from hitmdp_jax.agents.iopg import IOPG
from hitmdp_jax.agents.moc import MOC
from hitmdp_jax.agents.mopg import MOPG
from hitmdp_jax.agents.oc import OC
from hitmdp_jax.agents.ppo import PPO
from hitmdp_jax.agents.ppo_gru import PPOGRU
from hitmdp_jax.agents.ppoc import PPOC
from hitmdp_jax.agents.sac import SAC
from hitmdp_jax.errors import UsageError, unknown_name

AGENTS: dict[str, type[Agent]] = {
    "mopg": MOPG,
    "ppo": PPO,
    "dac": DAC,
    "ahp": AHP,
    "iopg": IOPG,
    "ppoc": PPOC,
    "oc": OC,
    "moc": MOC,
    "ppo_gru": PPOGRU,
    "sac": SAC,
    "hit_sac": HitSAC,
}


def find_agent(name: str) -> type[Agent]:
    """Return the algorithm of that name, or the one that `path/to/file.py:Class` names.

    Raises:
      UsageError: there is no such algorithm, or the class is none.
    """
    if not plugins.is_own(name):
        plugins.require_class(name)
        if name not in AGENTS:
            raise unknown_name("algo", name, AGENTS)
        return AGENTS[name]
    found = plugins.load_class(name)
    if not issubclass(found, Agent):
        raise UsageError(f"'{name}' is no algorithm: let it derive from hitmdp_jax.agents.Agent.")
    return found


__all__ = [
    "AGENTS",
    "AHP",
    "DAC",
    "IOPG",
    "MOC",
    "MOPG",
    "OC",
    "PPO",
    "PPOC",
    "PPOGRU",
    "SAC",
    "Agent",
    "HitSAC",
    "LearnerState",
    "find_agent",
    "static",
    "traced",
]
