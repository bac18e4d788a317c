"""Imports MJX, which prints two lines where Warp, which is optional, is missing, and drops them.

Brax imports MJX too. So whatever imports one of the two first imports this module before it.
"""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    import mujoco.mjx  # noqa: F401
