"""`python -m hitmdp_jax.video`: see `hitmdp_jax.commands.video`."""

from hitmdp_jax.commands.video import main

if __name__ == "__main__":
    main()
