"""A client of shared memory with pictures: prints a line a frame, until it is stopped. client.py INSTANCE FOLDER"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "clients/python"))
import lookout  # noqa: E402

for frame in lookout.Client(instance=sys.argv[1], directory=sys.argv[2], pictures=True):
    known = 0 if frame.disparity is None else int((frame.disparity > 0).sum())
    print(frame.sequence, known, flush=True)
