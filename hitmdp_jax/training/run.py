"""A run as its settings describe it: its tasks, agent and programs, and how far it has come."""

import dataclasses

import jax
import jax.numpy as jnp
from brax.envs.base import Env

from hitmdp_jax.agents import Agent
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.physics import find_engine
from hitmdp_jax.training.checkpoint import Checkpoints, Progress
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.program import Init, Iterate, TrainState, make_train, repeat, transfer
from hitmdp_jax.training.sweep import Device, devices_for, place, sweep


@dataclasses.dataclass(frozen=True)
class Run:
    """What a run's settings stand for on this machine."""

    config: RunConfig
    agent: Agent
    devices: list[Device]  # which share the seeds
    envs: list[Env]  # one a task

    @classmethod
    def create(cls, config: RunConfig) -> "Run":
        """Make the tasks and the agent; the engine shares its cores out among the devices."""
        devices = devices_for(config.seeds)
        engine = find_engine(config.physics).shared(len(devices))
        envs = [make_env(**task, physics=engine) for task in config.tasks]
        return cls(config, config.make_agent(), devices, envs)

    def program(self, task: int) -> tuple[Init, Iterate]:
        """Return init and step of one seed on a task; a step is one report's iterations."""
        config = self.config
        init, step = make_train(
            self.agent,
            self.envs[task],
            num_steps=config.env_steps,
            num_envs=config.num_envs,
            rollout_length=config.rollout_length,
        )
        return init, repeat(step, config.iterations_per_report)

    def programs(self, task: int) -> tuple[Init, Iterate]:
        """Return init and step of all seeds on a task, ready to compile."""
        return sweep(*self.program(task), self.devices)

    def keys(self) -> jax.Array:
        """Return the seeds' keys [S]: seed i gets the same whether it runs alone or in company."""
        return jax.vmap(jax.random.key)(self.config.seed + jnp.arange(self.config.seeds))

    def begin(self, task: int, progress: Progress, init: Init) -> TrainState:
        """Return the state [S, ...] in which a run goes on with a task, on its devices.

        Args:
          task: the task's place.
          progress: where the run stands.
          init: the task's init of all seeds.
        """
        state = progress.state
        if state is None:
            state = init(place(self.keys(), self.devices))
        elif progress.task != task:
            state = place(state, self.devices)
            # The run's own key goes on splitting; another task's start must not repeat what it
            # gives.
            keys = jax.vmap(jax.random.fold_in, in_axes=(0, None))(state.key, task)
            state = transfer(state, init(place(keys, self.devices)))
        # Laid out alike, fresh or restored: the program is one, and is compiled once for both.
        return place(state, self.devices)

    def abstract_state(self, task: int) -> TrainState:
        """Return the shapes and types of the state [S, ...] while the run is on a task."""
        init, _ = self.program(task)
        return jax.eval_shape(jax.vmap(init), jax.eval_shape(self.keys))

    def restore(self, checkpoints: Checkpoints) -> Progress:
        """Return where the newest readable checkpoint says the run stands."""
        return checkpoints.restore(self.abstract_state)
