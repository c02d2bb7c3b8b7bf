"""Reads the results of a running lookout daemon from shared memory.

    import lookout

    for frame in lookout.Client(pictures=True):
        print(frame.sequence, frame.level, frame.obstacles["distance_m"])
        near = frame.disparity > 256 * 20    # disparities of more than 20 px, read in place

The library is liblookout.so: the file that the variable LOOKOUT_LIBRARY names, one beside this package, or one that the system
finds. docs/client-records.md describes the fields of the records: unit, sign, range, and what they hold where they are unknown.
"""

from . import _layout
from ._client import Client, Error, Frame
from ._layout import *  # noqa: F403

__all__ = ["Client", "Error", "Frame", *_layout.__all__]
