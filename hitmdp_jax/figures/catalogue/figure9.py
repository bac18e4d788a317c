"""The same as figure8; the paper's has harder tasks."""

from hitmdp_jax.figures.catalogue import figure8

FIGURE = figure8.FIGURE
