"""How long options last during training, and how they share the steps (App. B.2)."""

from matplotlib.figure import Figure

from hitmdp_jax.figures.curves import count_options, option_durations
from hitmdp_jax.figures.registry import Entry, Needs, RunMetrics, Section


def draw(run: RunMetrics) -> Figure:
    """Draw each option's duration and share of steps in the training of the first seed.

    Raises:
      UsageError: the run has no options, or no iteration yet.
    """
    count_options(run.metrics, run.title)
    return option_durations(run.metrics, run.title, run.switch_at)


FIGURE = Entry(
    "How long options last, and how they share the steps", Needs.METRICS, draw, Section.TRAINING
)
