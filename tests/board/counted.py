#!/usr/bin/env python3
"""Times of our kernels and OpenCV's on the same pictures, in turns; prints one line of Markdown each.

  counted.py LEFT RIGHT STEREO_LIBRARY.so REMAP_LIBRARY.so [ROUNDS]

The libraries are the examples of perception. On a machine whose clock counts instructions (QEMU's -icount shift=0, one
core) a nanosecond is an instruction, so that a time is their number. Needs numpy and opencv-python.
"""
import ctypes
import statistics
import sys
import time

import cv2
import numpy as np

SIZES = [(640, 480, 64), (640, 480, 128), (1242, 375, 128)]
FOCAL_PX, DISTORTION, RIGHT_TURN_RAD = 520.0, (-0.3, 0.1, 0.001, -0.001), 0.02


def pointer(array):
    return array.ctypes.data_as(ctypes.c_void_p)


def sgbm(disparities):
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=disparities, blockSize=5, P1=200, P2=800, disp12MaxDiff=1, preFilterCap=63,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    return matcher.compute


def bm(disparities):
    matcher = cv2.StereoBM_create(disparities, 15)
    matcher.setTextureThreshold(10)
    matcher.setUniquenessRatio(10)
    matcher.setSpeckleWindowSize(100)
    matcher.setSpeckleRange(32)
    matcher.setDisp12MaxDiff(1)
    return matcher.compute


def ours(library, variant, disparities):
    def compute(left, right):
        height, width = left.shape
        out = np.empty((height, width), np.float32)
        code = library.peer_run(pointer(left), pointer(right), width, height, disparities, variant, 1, pointer(out))
        if code:
            raise RuntimeError(f"our matcher failed with {code}")
        return out
    return compute


def medians(work, rounds):
    times = {name: [] for name in work}
    for turn in range(rounds + 1):
        for name, run in work.items():
            start = time.perf_counter_ns()
            run()
            if turn:  # the first round makes workspaces
                times[name].append(time.perf_counter_ns() - start)
    return {name: statistics.median(values) for name, values in times.items()}


def row(what, found):
    first = next(iter(found.values()))
    cells = [f"{value * 1e-6:.4g} ({value / first:.2f})" for value in found.values()]
    print(f"| {what} | " + " | ".join(cells) + " |", flush=True)


def main():
    if len(sys.argv) not in (5, 6):
        sys.exit(__doc__)
    left_path, right_path, stereo_path, remap_path = sys.argv[1:5]
    rounds = int(sys.argv[5]) if len(sys.argv) == 6 else 3
    cv2.setNumThreads(1)
    pictures = [cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in (left_path, right_path)]
    for path, picture in zip((left_path, right_path), pictures):
        if picture is None:
            sys.exit(f"{path}: no picture that OpenCV reads")
    stereo, remap = ctypes.CDLL(stereo_path), ctypes.CDLL(remap_path)
    print("| millions of instructions, or ms (ratio to the first) | SGBM 3-way | BM 15 | full | fast |\n|---|---|---|---|---|")
    for width, height, disparities in SIZES:
        left, right = (cv2.resize(p, (width, height), interpolation=cv2.INTER_AREA) for p in pictures)
        matchers = {"sgbm": sgbm(disparities), "bm": bm(disparities), "full": ours(stereo, 1, disparities),
                    "fast": ours(stereo, 0, disparities)}
        work = {name: (lambda run=run: run(left, right)) for name, run in matchers.items()}
        row(f"{width}×{height}×{disparities}", medians(work, rounds))
    width, height = 640, 480
    picture = np.ascontiguousarray(cv2.resize(pictures[0], (width, height), interpolation=cv2.INTER_AREA))
    camera = np.array([[FOCAL_PX, 0, width / 2], [0, FOCAL_PX, height / 2], [0, 0, 1]])
    turn, _ = cv2.Rodrigues(np.array([0.0, RIGHT_TURN_RAD, 0.0]))
    maps = cv2.initUndistortRectifyMap(camera, np.array(DISTORTION), turn, camera, (width, height), cv2.CV_32FC1)
    fixed = cv2.convertMaps(*maps, cv2.CV_16SC2)
    remap.remap_make.restype = ctypes.c_int64
    if remap.remap_make(pointer(maps[0]), pointer(maps[1]), width, height) < 0:
        sys.exit("our remapping could not make its table")
    out = np.empty_like(picture)
    work = {"cv2.remap": lambda: cv2.remap(picture, *fixed, cv2.INTER_LINEAR),
            "ours": lambda: remap.remap_run(pointer(picture), pointer(out))}
    print("\n| | cv2.remap, fixed-point maps | ours |\n|---|---|---|")
    row(f"rectifying {width}×{height}", medians(work, 10 * rounds))


if __name__ == "__main__":
    main()
