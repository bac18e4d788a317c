"""Train an agent: `python train.py env=halfcheetah algo=mopg physics=native seeds=10`.

Every setting is in configs/; `python train.py --help` lists them.
"""

from hitmdp_jax.cli.train import main

if __name__ == "__main__":
    main()
