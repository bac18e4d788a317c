"""`python -m hitmdp_jax.train`: see `hitmdp_jax.commands.train`.

To be run, not imported: `hitmdp_jax.train` is the function of `hitmdp_jax.training.program`.
"""

from hitmdp_jax.commands.train import main

if __name__ == "__main__":
    main()
