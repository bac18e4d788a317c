"""`python -m hitmdp_jax.train`: see `hitmdp_jax.commands.train`.

Imported it is the function of that name: what `hitmdp_jax.train` means depends on no import.
"""

import sys

from hitmdp_jax.commands.train import main
from hitmdp_jax.training.program import train

if __name__ == "__main__":
    main()
else:
    sys.modules[__name__] = train  # pyright: ignore[reportArgumentType] # what the import returns
