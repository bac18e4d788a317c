"""`python -m hitmdp_jax.reproduce`: see `hitmdp_jax.commands.reproduce`."""

from hitmdp_jax.commands.reproduce import main

if __name__ == "__main__":
    main()
