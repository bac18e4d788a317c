"""Score a trained run: `python -m hitmdp_jax.evaluate RUN_DIR --engine gymnasium --episodes 50`."""

import argparse
from pathlib import Path

import jax
from rich.console import Console
from rich.table import Table

from hitmdp_jax.analysis.evaluation import ENGINES, Scores, score
from hitmdp_jax.analysis.statistics import number
from hitmdp_jax.errors import UsageError, exit_with
from hitmdp_jax.training.config import RunConfig
from hitmdp_jax.training.host import set_up_host
from hitmdp_jax.training.policy import load


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m hitmdp_jax.evaluate", description=__doc__)
    parser.add_argument("run_dir", type=Path, help="a run's folder")
    parser.add_argument(
        "--engine", default=None, help=f"one of {', '.join(ENGINES)}; the run's own"
    )
    parser.add_argument("--episodes", type=int, default=50, help="episodes a seed (50)")
    parser.add_argument("--seed", type=int, default=None, help="one of the run's seeds; all")
    parser.add_argument("--deterministic", action="store_true", help="do not sample")
    options = parser.parse_args()
    try:
        config = RunConfig.load(options.run_dir)
        seeds = range(config.seed, config.seed + config.seeds)
        chosen = seeds if options.seed is None else [options.seed]
        engine = options.engine or config.physics
        set_up_host(engine, options.episodes)
        table = Table("seed", "return", "std", "min", "max", "std error", "length", title=engine)
        for seed in chosen:
            policy = load(options.run_dir, seed)
            key = jax.random.key(seed)
            scores = score(policy, config, engine, options.episodes, key, options.deterministic)
            table.add_row(str(seed), *row(scores))
    except UsageError as error:
        exit_with(error)
    Console().print(table)


def row(scores: Scores) -> list[str]:
    """Return the table's entries for one seed."""
    returns, lengths = scores.returns, scores.lengths
    numbers = returns.mean(), returns.std(), returns.min(), returns.max(), scores.standard_error
    length = f"{lengths.mean():.1f} ({lengths.min()} to {lengths.max()})"
    return [number(x, ",.1f") for x in numbers] + [length]


if __name__ == "__main__":
    main()
