"""`python -m hitmdp_jax.export`: see `hitmdp_jax.commands.export`."""

from hitmdp_jax.commands.export import main

if __name__ == "__main__":
    main()
