"""Train an agent: `python train.py env=halfcheetah algo=mopg physics=native seeds=10`.

Every setting is in configs/; `python train.py --help` lists them.
"""

from pathlib import Path

from hitmdp_jax.training.cli import main

if __name__ == "__main__":
    main(Path(__file__).parent / "configs")
