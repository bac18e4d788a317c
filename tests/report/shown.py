"""What a page shows: a policy without its programs, and what the page holds packed."""

import base64
import gzip
import re
from types import SimpleNamespace

import numpy as np

from hitmdp_jax.errors import UsageError


def no_video(path):
    raise UsageError("no luck.")


def clips(options, paths):
    """Write into each clip whose it is."""
    for k, path in zip(options, paths, strict=True):
        path.write_bytes(f"clip {k}".encode())


def shown(analysis=None, video=no_video, clips=clips):
    """Return what a page asks for: its pictures are grey."""

    def poses():
        return dict.fromkeys(analysis.typical, np.full((3, 4, 3), 0.5))

    return SimpleNamespace(analyse=lambda: analysis, video=video, clips=clips, poses=poses)


def charts(page):
    """Return the charts of a page as its script finds them [JSON], each as it was packed."""
    return [_unpacked(text) for text in re.findall(', packed = "([^"]+)"', page)]


def drawings(page):
    """Return the drawings that a light page holds, as one text [JSON]."""
    return _unpacked(re.search('id="drawings">([^<]+)<', page)[1])


def _unpacked(text):
    return gzip.decompress(base64.b64decode(text)).decode()
