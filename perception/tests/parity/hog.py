"""Writes hog.txt: descriptors and detections of OpenCV's HOGDescriptor on the picture of tests/parity_hog.rs.

    python3 -m venv venv && venv/bin/pip install "opencv-python-headless<5" numpy
    venv/bin/python perception/tests/parity/hog.py > perception/tests/parity/hog.txt
"""

import cv2
import numpy as np

CELL = 6


def noise(x, y, seed):
    v = (x * 73_856_093) ^ (y * 19_349_663) ^ np.uint32(seed * 83_492_791 & 0xFFFFFFFF)
    v = v * np.uint32(2_654_435_761)
    v ^= v >> np.uint32(15)
    v = v * np.uint32(2_246_822_519)
    return (v >> np.uint32(24)).astype(np.int64)


def picture(width, height, seed, people):
    """Smooth noise with figures (left, top, height): a head, a body, two legs."""
    y, x = np.mgrid[0:height, 0:width]
    a, b = x % CELL, y % CELL
    i, j = (x // CELL).astype(np.uint32), (y // CELL).astype(np.uint32)
    one = np.uint32(1)
    upper = noise(i, j, seed) * (CELL - a) + noise(i + one, j, seed) * a
    lower = noise(i, j + one, seed) * (CELL - a) + noise(i + one, j + one, seed) * a
    smooth = (upper * (CELL - b) + lower * b) // (CELL * CELL)
    grey = smooth // 4 + 150
    for left, top, size in people:
        u, v = (x - left) * 24 // size, (y - top) * 24 // size
        head = (v >= 0) & (v < 4) & (u >= 4) & (u < 7)
        body = (v >= 4) & (v < 13) & (u >= 2) & (u < 9)
        legs = (v >= 13) & (v < 24) & (u >= 3) & (u < 8) & (u != 5)
        grey = np.where((x >= left) & (y >= top) & (head | body | legs), 30 + smooth // 8, grey)
    return grey.astype(np.uint8)


hog = cv2.HOGDescriptor()
hog.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())
print(f"# OpenCV {cv2.__version__}, by hog.py")
image = picture(200, 210, 7, [(30, 20, 96), (110, 30, 130)])
for left, top in [(12, 4), (100, 60)]:
    print(f"descriptor {left} {top}")
    window = np.ascontiguousarray(image[top : top + 128, left : left + 64])
    print(" ".join(f"{v:.6f}" for v in np.ravel(hog.compute(window))))
for padding, growth, threshold, group in [
    (0, 1.05, -1.9, 0),
    (8, 1.1, -1.7, 0),
    (16, 1.3, -2.0, 0),
    (0, 1.05, -2.0, 2),
    (16, 1.05, -1.7, 1),
]:
    windows, scores = hog.detectMultiScale(
        image, threshold, (8, 8), (padding, padding), growth, group, False
    )
    print(f"padding {padding} growth {growth} threshold {threshold} group {group}")
    for (x, y, width, height), score in sorted(zip(map(tuple, windows), np.ravel(scores))):
        print(x, y, width, height, f"{score:.5f}")
