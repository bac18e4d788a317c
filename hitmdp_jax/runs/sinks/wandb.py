"""Weights & Biases: one run of theirs for the program, or one for each training."""

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hitmdp_jax.errors import missing_extra
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import WANDB, subfolder
from hitmdp_jax.runs.sinks.base import Sink, Values, curves
from hitmdp_jax.training.sweep import Training


def open_sink(config: RunConfig, run_dir: Path, resume_after: int) -> "WandbSink | None":
    """Return the sink of a run, if it asks for one; it continues their run by itself.

    Raises:
      UsageError: the client is not installed.
    """
    if config.wandb == "off":
        return None
    if importlib.util.find_spec("wandb") is None:
        raise missing_extra("wandb", "wandb=program or wandb=seed")
    return WandbSink(run_dir, config.trainings, config.to_dict(), config.wandb == "seed")


class WandbSink(Sink):
    """Logs to Weights & Biases; `WANDB_MODE=offline` keeps everything in the run's folder.

    Nothing needs a flush: the client's own process outlives this one.

    Args:
      run_dir: the run's folder, whose name groups the runs.
      trainings: what each row of the metrics belongs to.
      settings: the run's, which are shown beside its curves.
      by_seed: make one of theirs for each training. Otherwise it is one of means over seeds, or in
        a sweep one for each setting.
    """

    name = "Weights & Biases"

    def __init__(
        self,
        run_dir: Path,
        trainings: Sequence[Training],
        settings: Mapping[str, Any],
        by_seed: bool,
    ):
        import wandb

        groups: dict[int, list[int]] = {}
        for i, training in enumerate(trainings):
            groups.setdefault(i if by_seed else training.setting, []).append(i)
        folder = run_dir.absolute()
        subfolder(folder, WANDB)  # theirs, so that they follow no link there

        def begin(training: Training) -> Any:
            name, shown = folder.name, dict(settings)
            if training.swept:
                name += f"-setting{training.setting}"
                shown |= {"swept": training.swept}
            if by_seed:
                name += f"-seed{training.seed}"
                shown |= {"seed": training.seed}
            return wandb.init(
                project="hitmdp_jax",
                dir=str(folder),
                name=name,
                id=f"{folder.parent.parent.name}-{folder.parent.name}-{name}".replace("/", "-"),
                group=folder.name,
                config=shown,
                resume="allow",
                reinit="create_new",
                settings=wandb.Settings(silent=True),
            )

        self._runs = [(begin(trainings[places[0]]), places) for places in groups.values()]

    def write(self, iteration: int, env_steps: int, metrics: Values) -> None:
        """Log what is known."""
        for run, places in self._runs:
            points = {}
            for name, x in curves(metrics):
                known = x[places][~np.isnan(x[places])]
                if known.size:
                    points[name] = float(known.mean())
            run.log(points, step=env_steps, commit=True)

    def close(self) -> None:
        """Finish the runs."""
        for run, _ in self._runs:
            run.finish()
