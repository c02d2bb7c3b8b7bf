"""Writes people.hog: the people detector of OpenCV (getDefaultPeopleDetector), as a model of lookout.

    python3 -m venv venv && venv/bin/pip install "opencv-python-headless<5" numpy
    venv/bin/python models/people.py > models/people.hog
"""

import cv2
import numpy as np

HEAD = """\
# The people detector of OpenCV, HOGDescriptor::getDefaultPeopleDetector, as models/people.py read it from the package
# opencv-python-headless {version}. Copyright of OpenCV's contributors; licence: Apache-2.0 (see models/README.md).
lookout-hog 1
window 64 128
bias {bias}
weights {count}
"""

values = [str(np.float32(v)) for v in np.ravel(cv2.HOGDescriptor_getDefaultPeopleDetector())]
print(HEAD.format(version=cv2.__version__, bias=values[-1], count=len(values) - 1), end="")
print("\n".join(values[:-1]))
