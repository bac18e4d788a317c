"""Several runs of one command line, `-m`, one after the other, or wherever Hydra starts them."""

import sys
import time
from pathlib import Path
from typing import Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from hitmdp_jax import plugins
from hitmdp_jax.cli.guard import guarded
from hitmdp_jax.cli.overrides import name_of, quoted
from hitmdp_jax.cli.run_settings import flag_setting, folder_setting, run_config
from hitmdp_jax.cli.settings import Settings, configs
from hitmdp_jax.cli.training import train
from hitmdp_jax.errors import UsageError
from hitmdp_jax.runs.claim import RUNS
from hitmdp_jax.runs.config import RunConfig
from hitmdp_jax.runs.folder import made
from hitmdp_jax.runs.memory import check_run_memory


def run(settings: Settings, flags: list[str]) -> int:
    """Run every job, or do what other flags ask of Hydra; return the exit code.

    Raises:
      UsageError: the settings of a job are wrong, before the first one starts.
    """
    swept, overrides = settings.swept(), settings.overrides
    if settings.multirun:
        overrides = [*overrides, f"hydra.sweep.dir={quoted(str(sweep_folder(settings)))}"]
    codes = [0]

    def job(values: DictConfig) -> float | None:
        """Train one job; return its final return, which a sweeper such as Optuna's maximises."""
        plain: Any = OmegaConf.to_container(values, resolve=True)
        hydra_config = HydraConfig.get()
        given = hydra_config.overrides.task
        if swept:
            label = ",".join(_short(o) for o in given if name_of(o) in swept).replace("/", "-")
            plain["run_dir"] = str(Path(hydra_config.sweep.dir) / label)
            print(f"job {hydra_config.job.num + 1}: {label}", flush=True)
        names = [name_of(o) for o in given]
        guarded(lambda: codes.append(train(plain, names, go_on=bool(swept))), shows=False)
        if codes[-1] > 128:
            sys.exit(codes[-1])  # who stops one job means the sweep
        return final_return(Path(plain["run_dir"]), run_config(plain)) if swept else None

    sys.argv = [sys.argv[0], *flags, *overrides]
    hydra.main(version_base="1.3", config_path=str(configs()), config_name="config")(job)()
    return max(codes)


def final_return(run_dir: Path, config: RunConfig) -> float:
    """Return a finished run's return: the interquartile mean over the seeds of its best setting."""
    from hitmdp_jax.interpret.summary import rank
    from hitmdp_jax.runs.metrics import read_metrics

    best, *_ = rank(config, read_metrics(run_dir, len(config.trainings))).values()
    return best.iqm


def _short(override: str) -> str:
    """Return a swept setting as a part of a folder's name: `env=my_task.MyTask` for a file's."""
    return f"{name_of(override).removesuffix('.name')}={plugins.label(override.partition('=')[2])}"


def sweep_folder(settings: Settings) -> Path:
    """Return the folder of a sweep, having checked every job before the first one starts."""
    jobs = [settings.values(job) for job in settings.jobs()]
    elsewhere = any(o.startswith("hydra/launcher") for o in settings.overrides)
    for values in jobs:
        config = run_config(values)
        config.check_installed()
        if not elsewhere:
            check_run_memory(config)
        for flag in ("overwrite", "report", "distributed", "trust"):
            flag_setting(values, flag)
        if values["distributed"]:
            raise UsageError("distributed=true trains one run in several processes: leave -m out.")
        if values["resume"] is not None:
            raise UsageError("resume continues one run: leave -m out.")
    if len({str(values["run_dir"]) for values in jobs}) > 1:
        raise UsageError("run_dir names the folder of the whole sweep; it cannot be swept.")
    default = RUNS / "sweeps" / time.strftime("%Y-%m-%d_%H-%M-%S")
    return made(folder_setting(jobs[0]) or default)
