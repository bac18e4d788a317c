"""Figures in TensorBoard while a run goes on."""

from pathlib import Path

from hitmdp_jax.errors import UsageError, warn
from hitmdp_jax.runs.checkpoint import Progress
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import FIGURES, subfolder
from hitmdp_jax.runs.interrupt import StopRequest
from hitmdp_jax.runs.sinks import Values
from hitmdp_jax.runs.sinks.tensorboard import write_pictures


class OptionFigures:
    """Shows the options' usage and durations so far in TensorBoard, whenever a run saves by plan.

    Args:
      config: the run's settings.
      run_dir: the run's folder; TensorBoard calls the figures' run `figures`.
    """

    names = ()

    def __init__(self, config: RunConfig, run_dir: Path):
        self.every = config.checkpoint_steps
        self._title, self._run_dir, self._switch_at = config.title, run_dir, config.switch_at

    def __call__(self, progress: Progress, env_steps: int) -> Values:
        """Draw a figure, and return no metric."""
        # Matplotlib takes a second to import, in which the training could have started.
        from hitmdp_jax.figures.curves import option_durations, pixels
        from hitmdp_jax.runs.metrics import read_metrics

        try:
            metrics = read_metrics(self._run_dir)
            if "option_steps_0" in metrics:
                picture = pixels(option_durations(metrics, self._title, self._switch_at))
                folder = subfolder(self._run_dir, FIGURES)
                write_pictures(folder, {"option_durations": picture}, env_steps)
        except (OSError, UsageError) as error:  # a full disk, a damaged row: they end no training
            warn(f"no figure in TensorBoard: {error}")
        return {}

    def close(self, stop: StopRequest) -> None:
        """Nothing is under way between two calls."""
