"""`python -m hitmdp_jax.report`: see `hitmdp_jax.commands.report`."""

from hitmdp_jax.commands.report import main

if __name__ == "__main__":
    main()
