"""The package's version, as it was installed."""

import importlib.metadata

__version__ = importlib.metadata.version("hitmdp-jax")
