"""`python -m hitmdp_jax.study`: see `hitmdp_jax.commands.study`."""

from hitmdp_jax.commands.study import main

if __name__ == "__main__":
    main()
