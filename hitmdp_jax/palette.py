"""The colours of options: the same in every figure, on every page, in films and on the terminal."""

import functools

import numpy as np

# All have a contrast of at least 3 on white, and are told apart by eyes that lack the red or the
# green cones.
PALETTE = (
    "#4477aa", "#ee6677", "#20733d", "#a88600", "#7a1a70", "#1d9ba6", "#8f1200", "#454545",
)  # fmt: skip


@functools.cache  # a path asks once a step
def option_color(k: int) -> str:
    """Return the colour of option k: the palette's, then mixtures of two of them, then darker."""
    cycle, k = divmod(k, len(PALETTE))
    darker, apart = divmod(cycle, 4)  # four apart, both neighbours would give the same mixture
    pair = [_parts(PALETTE[i % len(PALETTE)]) for i in (k, k + apart)]
    mixed = np.mean(pair, axis=0) * 0.75**darker
    return "#" + "".join(f"{part:02x}" for part in np.round(mixed).astype(int))


def _parts(color: str) -> list[int]:
    """Return red, green and blue, from 0 to 255."""
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]
