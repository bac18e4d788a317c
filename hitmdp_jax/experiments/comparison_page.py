"""The page about several runs: their returns against the first one's, and their curves."""

from collections.abc import Mapping
from pathlib import Path

from hitmdp_jax.errors import UsageError
from hitmdp_jax.experiments import ablation
from hitmdp_jax.experiments.comparison import length_warning, one_window
from hitmdp_jax.experiments.statistics import bootstrap_interval, interquartile_mean
from hitmdp_jax.experiments.sweeps import by_setting
from hitmdp_jax.figures import scores
from hitmdp_jax.figures.curves import read_metrics
from hitmdp_jax.figures.style import styles
from hitmdp_jax.report.interactive import chart, learning_curves
from hitmdp_jax.report.page import Parts, drawing, page, preformatted, table, text
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.provenance import made_with


def comparison_page(runs: Mapping[str, tuple[Path, RunConfig]], commands: Mapping[str, str]) -> str:
    """Return the page about several runs.

    Args:
      runs: name -> folder and settings; the first is what the others are measured against.
      commands: name -> what trains what its settings say.
    """
    metrics, switches, algorithms = {}, {}, {}
    for run, (folder, config) in runs.items():
        if not (read := read_metrics(folder, len(config.trainings))):
            raise UsageError(f"The run {run} has no finished iteration.")
        for setting, own in by_setting(config, read).items():
            name = f"{run}, {setting}" if setting else run
            metrics[name], switches[name] = own, config.switch_at
            algorithms[name] = config.algo["name"]
    control = next(iter(metrics))
    arms = ablation.measure(metrics, switches, control)
    final = [arm.final_returns for arm in arms]
    looks = styles(algorithms)

    def returns() -> Parts:
        if warning := length_warning({arm.name: arm.env_steps for arm in arms}):
            yield text(warning)
        middles = [interquartile_mean(x) for x in final]
        ends = [bootstrap_interval(interquartile_mean, x) for x in final]
        yield drawing(scores.intervals(looks, final, middles, ends), "Returns")
        yield table(ablation.table(arms))
        window = one_window(arm.window for arm in arms)
        yield text(f"Returns are those of {window}; {control} is the control.")

    def curves() -> Parts:
        yield chart(learning_curves(metrics, looks, switches))

    def seeds() -> Parts:
        yield drawing(scores.profiles(looks, final), "Performance profiles")

    def made_by() -> Parts:
        yield preformatted("\n".join(commands.values()))
        made = dict.fromkeys(made_with(folder) for folder, _ in runs.values())
        yield text("Made with " + "; and ".join(made) + ".")

    titles = sorted({config.title for _, config in runs.values()})
    sections = {
        "Returns": returns,
        "Learning": curves,
        "What share of seeds reaches a return": seeds,
        "Commands": made_by,
    }
    return page("Comparison", "; ".join(titles), sections)
