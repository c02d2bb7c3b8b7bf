"""Reads calibrations as their owners' programs do, and writes them anew with the same libraries.

    read_calibration.py FOLDER

FOLDER holds cv.yml (OpenCV), left.yaml and right.yaml (ROS camera_info), camchain.yaml (Kalibr) and
calib.txt (KITTI). OpenCV reads its own file, PyYAML those of ROS and Kalibr (as their programs do), and
KITTI's is split at spaces (as its development kit does). Prints what was read as JSON, and how far apart
rows and places are when OpenCV projects, undistorts and triangulates points with the numbers in cv.yml.
Writes cv2.yml, ros2_left.yaml, ros2_right.yaml and camchain2.yaml.
"""

import json
import pathlib
import sys

import cv2
import numpy as np
import yaml

folder = pathlib.Path(sys.argv[1])


def floats(values):
    """YAML leaves what does not look like a number to it as text: an error here."""
    flat = np.array(values, dtype=object).ravel().tolist()
    for value in flat:
        if not isinstance(value, (int, float)):
            raise SystemExit(f"{value!r} was not read as a number")
    return [float(v) for v in flat]


said = {}

# OpenCV.
names = ["M1", "D1", "M2", "D2", "R", "T", "R1", "P1", "R2", "P2", "Q"]
file = cv2.FileStorage(str(folder / "cv.yml"), cv2.FILE_STORAGE_READ)
cv = {name: file.getNode(name).mat() for name in names}
size = file.getNode("image_size")
width, height = (int(size.at(i).real()) for i in range(2))
file.release()
said["opencv"] = {name: cv[name].ravel().tolist() for name in names} | {"size": [width, height]}

# Points before the cameras, as OpenCV sees, rectifies and triangulates them.
random = np.random.default_rng(1)
points = random.uniform((-0.5, -0.3, 1.0), (0.5, 0.3, 4.0), (200, 3))
turn = cv2.Rodrigues(cv["R"])[0]
zero = np.zeros(3)
seen = [
    cv2.projectPoints(points, zero, zero, cv["M1"], cv["D1"])[0],
    cv2.projectPoints(points, turn, cv["T"], cv["M2"], cv["D2"])[0],
]
inside = np.all([(s[:, 0] > 0).all(1) & (s[:, 0] < (width, height)).all(1) for s in seen], axis=0)
many = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
left, right = [
    cv2.undistortPointsIter(s, cv[f"M{n}"], cv[f"D{n}"], cv[f"R{n}"], cv[f"P{n}"], many)[inside, 0]
    if hasattr(cv2, "undistortPointsIter")
    else cv2.undistortPoints(s, cv[f"M{n}"], cv[f"D{n}"], None, cv[f"R{n}"], cv[f"P{n}"], many)[inside, 0]
    for n, s in zip("12", seen)
]
places = np.column_stack([left, left[:, 0] - right[:, 0], np.ones(len(left))]) @ cv["Q"].T
places = places[:, :3] / places[:, 3:]
said["points"] = int(inside.sum())
said["rows_px"] = float(np.abs(left[:, 1] - right[:, 1]).max())
said["places_m"] = float(np.abs(places - points[inside] @ cv["R1"].T).max())

out = cv2.FileStorage(str(folder / "cv2.yml"), cv2.FILE_STORAGE_WRITE)
out.write("image_width", width)
out.write("image_height", height)
for name in names:
    out.write(name, cv[name])
out.release()

# ROS.
said["ros"] = []
for side in ["left", "right"]:
    with open(folder / f"{side}.yaml") as file:
        info = yaml.safe_load(file)
    matrices = ["camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"]
    for name in matrices:
        m = info[name]
        if len(floats(m["data"])) != m["rows"] * m["cols"]:
            raise SystemExit(f"{name}: {m}")
    said["ros"].append(
        {name: floats(info[name]["data"]) for name in matrices}
        | {"size": [info["image_width"], info["image_height"]], "model": info["distortion_model"]}
    )
    with open(folder / f"ros2_{side}.yaml", "w") as file:
        yaml.safe_dump(info, file)

# Kalibr.
with open(folder / "camchain.yaml") as file:
    chain = yaml.safe_load(file)
said["kalibr"] = [
    {
        "intrinsics": floats(c["intrinsics"]),
        "distortion": floats(c["distortion_coeffs"]),
        "size": c["resolution"],
        "models": [c["camera_model"], c["distortion_model"]],
    }
    for c in (chain["cam0"], chain["cam1"])
]
said["kalibr"][1]["from_left"] = floats(chain["cam1"]["T_cn_cnm1"])
with open(folder / "camchain2.yaml", "w") as file:
    yaml.safe_dump(chain, file)

# KITTI.
with open(folder / "calib.txt") as file:
    lines = (line.split(":", 1) for line in file if line.strip())
    said["kitti"] = {key: [float(v) for v in values.split()] for key, values in lines}

print(json.dumps(said))
