"""Prints each frame of a run as a line of JSON until it ends, and checks what the package promises of its arrays."""

import json
import sys

import numpy

import lookout

client = lookout.Client(*sys.argv[1:3], pictures=True)
assert lookout.LEVEL_ALARM == 3 and lookout.FAULT_NO_ROAD == 1 and not hasattr(lookout, "numpy")
before = None
for frame in client:
    if frame.withdrawn:
        assert frame.disparity is None and frame.level == "off" and len(frame.obstacles) == 0
        break
    disparity = frame.disparity
    assert disparity.shape == (240, 320) and disparity.dtype == numpy.uint16
    assert (disparity > 0).sum() > disparity.size // 10
    # Two views of one memory: nothing was copied.
    assert numpy.shares_memory(disparity, frame.disparity) and disparity.base is not None
    assert numpy.shares_memory(frame.left, frame.left) and frame.right.shape == frame.confidence.shape
    assert ((frame.confidence > 0) == (disparity > 0)).all()
    try:
        disparity[0, 0] = 1
        raise AssertionError("shared memory was written")
    except ValueError:
        pass
    if before is not None:
        assert before.sequence < frame.sequence and before.run == frame.run
        try:
            before.left
            raise AssertionError("pictures of a frame that is over")
        except ValueError:
            pass
        # Records stay.
        assert before.alarm["level"] < 4
    assert isinstance(frame, lookout.Frame)
    before = frame
    assert 0 < frame.age_s < 120
    if frame.rig["width"]:
        assert frame.rig["focal_px"] == 440.0 and frame.rig["baseline_m"] == 0.12
    obstacles = [
        {"track": int(o["track"]), "class": o["class"].decode(), "distance_m": float(o["distance_m"])} for o in frame.obstacles
    ]
    line = {"sequence": frame.sequence, "level": frame.level, "reason": frame.reason, "obstacles": obstacles}
    print(json.dumps(line), flush=True)
client.close()
try:
    client.next(0)
    raise AssertionError("it is closed")
except lookout.Error:
    pass
try:
    lookout.Client("no/name")
    raise AssertionError("no daemon has this name")
except lookout.Error as error:
    assert "instance.name" in str(error)
