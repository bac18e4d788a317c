"""A run as its settings describe it: its tasks, agent and programs, and how far it has come."""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env
from jax.sharding import Mesh

from hitmdp_jax.agents import Agent
from hitmdp_jax.envs import make_env
from hitmdp_jax.envs.spec import spec_of
from hitmdp_jax.physics import find_engine
from hitmdp_jax.precision import in_32_bits
from hitmdp_jax.runs import processes
from hitmdp_jax.runs.checkpoint import Checkpoints
from hitmdp_jax.runs.checkpoint_items import Progress, with_keys, with_raw_keys
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.devices import at_once, make_mesh, memory_of, place, spread
from hitmdp_jax.runs.memory import check_run_memory
from hitmdp_jax.runs.schedule import Schedule
from hitmdp_jax.runs.warm_start import Start, read_start
from hitmdp_jax.training.program import Init, Iterate, make_train, repeat
from hitmdp_jax.training.state import Hyperparameters, TrainState, transfer
from hitmdp_jax.training.sweep import Training, apart
from hitmdp_jax.training.warm_start import check_parts


@dataclasses.dataclass(frozen=True)
class Run:
    """What a run's settings stand for on this machine."""

    config: RunConfig
    agent: Agent
    mesh: Mesh  # of the devices that share the trainings and their environments
    envs: list[Env]  # one a task

    @classmethod
    def create(cls, config: RunConfig) -> "Run":
        """Make the tasks and the agent; the engine shares its cores out among the devices.

        Raises:
          UsageError: the devices here cannot be shared out as the settings say, or do not have the
            memory, or as `make_train`.
        """
        size = len(config.trainings)
        mesh = make_mesh(size, config.data_devices)
        here = sum(d.process_index == jax.process_index() for d in mesh.devices.flat)
        engine = find_engine(config.physics).shared(here)
        envs = [make_env(**task, physics=engine) for task in config.tasks]
        run = cls(config, config.make_agent(), mesh, envs)
        run.program(0)  # which says what cannot be trained, before a folder is made
        for env in envs:
            check_run_memory(config, env, at_once(size, mesh), memory_of(mesh))
        return run

    @property
    def trainings(self) -> list[Training]:
        """What each row of the run's arrays [R, ...] belongs to."""
        return self.config.trainings

    @property
    def schedule(self) -> Schedule:
        """How far the run goes, and what falls due after which iteration."""
        return self.config.schedule

    def program(self, task: int) -> tuple[Init, Iterate]:
        """Return init and step of one training on a task; a step is one report's iterations."""
        return self._one[task]

    @functools.cached_property  # to check a task or an algorithm of one's own is to trace it
    def _one(self) -> list[tuple[Init, Iterate]]:
        return [self._build(env) for env in self.envs]

    def _build(self, env: Env) -> tuple[Init, Iterate]:
        config = self.config
        init, step = make_train(
            self.agent,
            env,
            num_steps=self.schedule.env_steps,
            num_envs=config.num_envs,
            rollout_length=config.rollout_length,
        )
        return init, repeat(step, self.schedule.iterations_per_report)

    def programs(self, task: int) -> tuple[Init, Iterate]:
        """Return init and step of all trainings on a task, ready to compile."""
        return spread(*self.program(task), self.mesh)

    def keys(self) -> jax.Array:
        """Return the trainings' keys [R]: a seed's is the same alone, in company and in a sweep."""
        seeds = [training.seed for training in self.trainings]
        return jax.vmap(jax.random.key)(jnp.array(seeds, jnp.uint32))

    def hyperparameters(self) -> Hyperparameters:
        """Return the trainings' float hyperparameters, [R] each.

        They are the program's inputs rather than part of it: another value compiles nothing anew.
        """
        size = len(self.trainings)
        own = {k: jnp.full(size, x, jnp.float32) for k, x in self.agent.traced_values().items()}
        return own | jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), self.config.swept)

    def begin(self, task: int, progress: Progress, init: Init) -> TrainState:
        """Return the state [R, ...] in which a run goes on with a task, on its devices.

        Args:
          task: the task's place.
          progress: where the run stands.
          init: the task's init of all trainings.
        """
        state = progress.state
        if state is None:
            state = init(*place((self.keys(), self.hyperparameters()), self.mesh))
            if self.start is not None:
                places = np.arange(len(self.trainings)) % self.config.seeds
                state = self.start.put(state, place(self.start.of(places), self.mesh))
        elif progress.task != task:
            state = place(state, self.mesh)
            # Both are split off the run's key, which nothing uses any more: a key that is drawn
            # from and split, too, gives the same numbers twice.
            keys, of_start = jnp.moveaxis(jax.vmap(jax.random.split)(state.key), 1, 0)
            fresh = init(of_start, state.hyperparameters)
            state = transfer(state.replace(key=keys), fresh)
        # Laid out alike, fresh or restored: the program is one, and is compiled once for both.
        return place(self.with_replay(state), self.mesh)

    @functools.cached_property
    def start(self) -> Start | None:
        """What the trainings begin with, read when it is first asked for: not to be gone on with.

        Raises:
          UsageError: as `read_start`.
        """
        config = self.config
        if config.init_from is None:
            return None
        return read_start(Path(config.init_from), self._blank, check_parts(config.init_parts))

    @functools.cached_property
    def _blank(self) -> TrainState:
        """The shapes of one training's state before its first iteration."""
        init, _ = self.program(0)
        return jax.eval_shape(init, jax.random.key(0))

    def begins_with(self) -> str:
        """Return a line on what the trainings begin with; "" where they begin anew."""
        return "" if self.start is None else self.start.told(self._blank)

    def refills(self) -> str:
        """Return a line on the replay that a resumed run fills anew; "" where it fills none."""
        replay = jax.eval_shape(lambda: self.agent.init_replay(spec_of(self.envs[0])))
        if self.config.save_replay or not jax.tree.leaves(replay):
            return ""
        return (
            "The replay was not saved (save_replay=false) and fills anew before learning goes on, "
            "so the run is not what it would have been without the break."
        )

    def with_replay(self, state: TrainState) -> TrainState:
        """Return a state with an empty replay where its checkpoint had none."""
        if jax.tree.leaves(state.replay):
            return state

        def empty(hyperparameters: Hyperparameters) -> Any:
            agent = self.agent.replace(**apart(hyperparameters)[0])
            return in_32_bits(agent.init_replay(state.spec))

        return state.replace(replay=jax.vmap(empty)(state.hyperparameters))

    def abstract_state(self, task: int) -> TrainState:
        """Return the shapes and types of the state [R, ...] that a checkpoint of a task holds."""
        init, _ = self.program(task)
        state = jax.eval_shape(lambda: jax.vmap(init)(self.keys(), self.hyperparameters()))
        return self.kept(state)

    def kept(self, state: TrainState) -> TrainState:
        """Return of a state what checkpoints keep: the replay only where that is asked for."""
        return state if self.config.save_replay else state.replace(replay=())

    def own(self, tree: Any) -> Any:
        """Return the arrays [R, ...] of the run's trainings, without what `place` repeated."""
        size = len(self.trainings)
        return jax.tree.map(lambda x: x if len(x) == size else x[:size], tree)

    def saved(self, progress: Progress) -> Progress:
        """Return the progress of the run as a checkpoint keeps it; all processes must call this."""
        assert progress.state is not None
        state = processes.gathered(self.kept(progress.state), self.mesh)
        return dataclasses.replace(progress, state=self.own(state))

    def restore(self, checkpoints: Checkpoints | None) -> Progress:
        """Return where the newest readable checkpoint, which the first process reads, says so."""
        read: list[Progress] = []

        def first() -> tuple[int, int]:
            assert checkpoints is not None
            read.append(checkpoints.restore(self.abstract_state))
            return read[0].iteration, read[0].task

        iteration, task = processes.told(first)
        if not processes.several():
            return read[0]
        wanted = self.abstract_state(task)
        raw = jax.eval_shape(with_raw_keys, wanted)
        blank = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), raw)
        state = processes.broadcast(with_raw_keys(read[0].state) if read else blank)  # pyright: ignore
        return Progress(iteration, task, with_keys(state, wanted))
