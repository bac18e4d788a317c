"""What contacts and their solver cost MJX: the time of a substep, by what is left out.

    python benchmarks/contact_budget.py ant 8

From states of random trajectories, 32 environments side by side; the programs take turns, and the
smallest of five times is told, with the largest difference of qpos after eight substeps to the
whole model's.
"""

import argparse
import copy
import time

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx

from benchmarks.solver_budget import States, sample_states
from hitmdp_jax import list_envs, make_env
from hitmdp_jax.envs.assets import ALL
from hitmdp_jax.envs.base import MujocoEnv
from hitmdp_jax.physics.base import CONTACTS

NUM_ENVS, SUBSTEPS, TURNS = 32, 8, 5


def variants(model: mujoco.MjModel, contacts: list[int]) -> dict[str, mujoco.MjModel]:
    """Return the model whole, with so many contacts of a dimension, and without parts, by name."""
    without = mujoco.mjtDisableBit
    found = {"whole": (ALL, 0)} | {f"{k} contacts": (float(k), 0) for k in contacts}
    found |= {"no contacts": (ALL, int(without.mjDSBL_CONTACT))}
    found |= {"no constraints": (ALL, int(without.mjDSBL_CONSTRAINT))}
    models = {}
    for name, (number, flags) in found.items():
        models[name] = copy.copy(model)
        models[name].numeric(CONTACTS).data[:] = number
        models[name].opt.disableflags |= flags
    return models


def main() -> None:
    """Print the table of one task."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("env", choices=list_envs())
    parser.add_argument("contacts", type=int, nargs="*", help="how many of a dimension")
    options = parser.parse_args()
    env = make_env(options.env, physics="mjx")
    assert isinstance(env, MujocoEnv), "only MuJoCo tasks have contacts"
    states = sample_states(env, env.model, NUM_ENVS)

    def program(model: mujoco.MjModel):
        mjx_model, blank = mjx.put_model(model), mjx.make_data(model)

        def substep(data: mjx.Data, _: None) -> tuple[mjx.Data, None]:
            return mjx.step(mjx_model, data), None

        def run(state: States) -> jax.Array:
            data, _ = jax.lax.scan(substep, blank.replace(**state._asdict()), length=SUBSTEPS)
            return data.qpos

        return jax.jit(jax.vmap(run)), int(blank._impl.nefc)  # pyright: ignore

    programs = {n: program(m) for n, m in variants(env.model, options.contacts).items()}
    arguments = jax.tree.map(jnp.asarray, states)
    ends = {name: np.asarray(run(arguments)) for name, (run, _) in programs.items()}
    times: dict[str, list[float]] = {name: [] for name in programs}
    for name in list(programs) * TURNS:
        start = time.perf_counter()
        jax.block_until_ready(programs[name][0](arguments))
        times[name].append(time.perf_counter() - start)
    whole = min(times["whole"])
    print(f"{options.env:20} rows of the solver  time    max |dqpos|")
    for name, (_, rows) in programs.items():
        error = np.abs(ends[name] - ends["whole"]).max()
        print(f"{name:20} {rows:18} {min(times[name]) / whole:5.2f} {error:14.1e}")


if __name__ == "__main__":
    main()
