"""The same as figure8; in the paper it shows a harder task."""

from hitmdp_jax.figures.catalogue import figure8

FIGURE = figure8.FIGURE
