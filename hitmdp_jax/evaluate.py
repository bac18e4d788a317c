"""`python -m hitmdp_jax.evaluate`: see `hitmdp_jax.commands.evaluate`."""

from hitmdp_jax.commands.evaluate import main

if __name__ == "__main__":
    main()
