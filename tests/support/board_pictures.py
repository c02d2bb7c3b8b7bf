"""Calibration boards as other programs print them, seen by known cameras; and what OpenCV makes of a calibration.

    board_pictures.py draw PATTERN LENS COUNT FOLDER
    board_pictures.py rectify CV.yml
    board_pictures.py detect PATTERN BOARD.svg

`draw` writes COUNT pairs to FOLDER/left and FOLDER/right. PATTERN is charuco, legacy or apriltags (11 x 8 squares of 24 mm with
markers of 18 mm of DICT_5X5_100 or DICT_APRILTAG_36h11, drawn by OpenCV, whole or partly in sight) or aprilgrid (6 x 4 tags of 35 mm, gaps of 0.3, laid
out as Kalibr does, with the bits of OpenCV's dictionary). LENS is plain or fisheye. Prints the cameras as JSON.

`rectify` reads a fisheye calibration with OpenCV and prints where it rectifies some pixels of both cameras to.

`detect` draws a printed board of the same kinds and prints how many of its corners (charuco, legacy, apriltags) or tags (aprilgrid) OpenCV finds.
"""

import json
import pathlib
import re
import sys

import cv2
import numpy as np

WIDTH, HEIGHT = 640, 480
SQUARE_MM, MARKER_MM, SQUARES = 24.0, 18.0, (11, 8)
TAG_MM, SPACING, TAGS = 35.0, 0.3, (6, 4)
# Pixels of the drawn board for each mm, and white paper around it, in mm.
SCALE, PAPER_MM = 10, 15
# Sample points along a side of a pixel.
SAMPLES = 4
ROTATION = cv2.Rodrigues(np.array([0.0066, 0.0082, -0.0037]))[0]
TRANSLATION_M = np.array([-0.12, 0.0011, -0.0009])


def camera(fx, fy, cx, cy):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


CAMERAS = {
    "plain": [
        (camera(533.5, 533.2, 331.0, 236.0), np.array([-0.28, 0.09, 0.0011, -0.0004, 0.0])),
        (camera(536.9, 536.4, 325.0, 245.0), np.array([-0.28, 0.09, 0.0011, -0.0004, 0.0])),
    ],
    "fisheye": [
        (camera(250.5, 250.2, 322.0, 238.0), np.array([-0.02, 0.01, -0.006, 0.001])),
        (camera(251.9, 251.4, 318.0, 243.0), np.array([-0.022, 0.011, -0.005, 0.0008])),
    ],
}


def charuco_board(pattern):
    name = cv2.aruco.DICT_APRILTAG_36h11 if pattern == "apriltags" else cv2.aruco.DICT_5X5_100
    dictionary = cv2.aruco.getPredefinedDictionary(name)
    board = cv2.aruco.CharucoBoard(SQUARES, SQUARE_MM / 1e3, MARKER_MM / 1e3, dictionary)
    board.setLegacyPattern(pattern == "legacy")
    return board


def charuco(pattern):
    board = charuco_board(pattern)
    size = tuple(int(n * SQUARE_MM * SCALE) for n in SQUARES)
    return board.generateImage(size, marginSize=0)


def aprilgrid():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    gap = SPACING * TAG_MM
    width, height = (n * (TAG_MM + gap) + gap for n in TAGS)
    picture = np.full((round(height * SCALE), round(width * SCALE)), 255, np.uint8)

    def fill(x, y, side, value):
        """A square with its lower left corner at (x, y), in mm from the lower left of the print."""
        rows = slice(round((height - y - side) * SCALE), round((height - y) * SCALE))
        picture[rows, round(x * SCALE) : round((x + side) * SCALE)] = value

    bit = TAG_MM / 10
    for tag in range(TAGS[0] * TAGS[1]):
        x, y = (gap + (tag % TAGS[0], tag // TAGS[0])[axis] * (TAG_MM + gap) for axis in (0, 1))
        fill(x, y, TAG_MM, 0)
        # OpenCV has the tags upside down.
        code = cv2.aruco.Dictionary.getBitsFromByteList(dictionary.bytesList[tag : tag + 1], 6)[::-1, ::-1]
        for row, column in np.argwhere(code):
            fill(x + (column + 2) * bit, y + (7 - row) * bit, bit, 255)
        for corner_x in (x - gap, x + TAG_MM):
            for corner_y in (y - gap, y + TAG_MM):
                fill(corner_x, corner_y, gap, 0)
    return picture


def draw(pattern, lens, count, folder):
    random = np.random.default_rng(1)
    board = aprilgrid() if pattern == "aprilgrid" else charuco(pattern)
    size_mm = np.array(board.shape[::-1]) / SCALE
    paper = PAPER_MM * SCALE
    board = cv2.copyMakeBorder(board, paper, paper, paper, paper, cv2.BORDER_CONSTANT, value=255)
    rows, columns = np.mgrid[0 : HEIGHT * SAMPLES, 0 : WIDTH * SAMPLES]
    points = np.stack([columns, rows], -1).reshape(-1, 1, 2).astype(np.float64)
    points = (points + 0.5) / SAMPLES - 0.5
    rays = []
    for matrix, distortion in CAMERAS[lens]:
        if lens == "fisheye":
            flat = cv2.fisheye.undistortPoints(points, matrix, distortion)
        else:
            many = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
            # OpenCV 5 has one function for both.
            if hasattr(cv2, "undistortPointsIter"):
                flat = cv2.undistortPointsIter(points, matrix, distortion, None, None, many)
            else:
                flat = cv2.undistortPoints(points, matrix, distortion, None, None, None, many)
        rays.append(np.column_stack([flat.reshape(-1, 2), np.ones(len(flat))]))

    def seen(ray, rotation, place_m):
        """The picture of the board at a pose."""
        normal = rotation[:, 2]
        along = (normal @ place_m) / (ray @ normal)
        on_board = (ray * along[:, None] - place_m) @ rotation * 1e3
        at = (on_board[:, :2] + size_mm / 2) * SCALE + paper - 0.5
        at[~(np.isfinite(along) & (along > 0))] = -1e4
        x, y = (at[:, axis].reshape(rows.shape).astype(np.float32) for axis in (0, 1))
        fine = cv2.remap(board, x, y, cv2.INTER_LINEAR, borderValue=90).astype(np.float32)
        picture = fine.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES).mean((1, 3)) * 0.7 + 30
        picture = cv2.GaussianBlur(picture, (0, 0), 0.6) + random.normal(0, 2, picture.shape)
        return np.clip(np.round(picture), 0, 255).astype(np.uint8)

    near_m, far_m = (0.17, 0.3) if lens == "fisheye" else (0.3, 0.5)
    for view in range(count):
        away, tilt = random.uniform(near_m, far_m), random.uniform(0.25, 0.65)
        way = view * 2.4
        turn = np.array([tilt * np.cos(way), tilt * np.sin(way), random.uniform(-0.3, 0.3)])
        rotation = cv2.Rodrigues(turn)[0]
        reach = 0.45 * away * WIDTH / CAMERAS[lens][0][0][0, 0]
        aside = random.uniform(-reach, reach, 2) * (0.7, 0.5)
        place_m = np.array([aside[0] + 0.06, aside[1], away])
        for side, ray in zip(("left", "right"), rays):
            path = pathlib.Path(folder) / side / f"{view:02}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            pose = (rotation, place_m)
            if side == "right":
                pose = (ROTATION @ rotation, ROTATION @ place_m + TRANSLATION_M)
            cv2.imwrite(str(path), seen(ray, *pose))
    cameras = [
        [m[0, 0], m[1, 1], m[0, 2], m[1, 2], *d.tolist()] for m, d in CAMERAS[lens]
    ]
    turned = cv2.Rodrigues(ROTATION)[0].ravel().tolist()
    print(json.dumps({"cameras": cameras, "rotation": turned, "translation_m": TRANSLATION_M.tolist()}))


def rectify(path):
    file = cv2.FileStorage(path, cv2.FILE_STORAGE_READ)
    columns, rows = np.meshgrid(np.linspace(60, WIDTH - 60, 9), np.linspace(40, HEIGHT - 40, 7))
    pixels = np.stack([columns, rows], -1).reshape(-1, 1, 2)
    said = {"pixels": pixels.reshape(-1, 2).tolist(), "model": file.getNode("distortion_model").string()}
    for side, n in (("left", "1"), ("right", "2")):
        m, d, r, p = (file.getNode(name + n).mat() for name in "MDRP")
        said[side] = cv2.fisheye.undistortPoints(pixels, m, d.ravel(), R=r, P=p).reshape(-1, 2).tolist()
    print(json.dumps(said))


def detect(pattern, path):
    text = pathlib.Path(path).read_text()
    width, height = (float(v) for v in re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', text).groups())
    picture = np.full((round(height * SCALE), round(width * SCALE)), 255, np.uint8)
    for area in re.findall(r"M([\d.]+) ([\d.]+)h([\d.]+)v([\d.]+)h-", text):
        x, y, wide, high = (float(v) * SCALE for v in area)
        picture[round(y) : round(y + high), round(x) : round(x + wide)] = 0
    picture = cv2.resize(picture, None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA)
    if pattern == "aprilgrid":
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        found = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture)[1]
    else:
        found = cv2.aruco.CharucoDetector(charuco_board(pattern)).detectBoard(picture)[1]
    print(json.dumps({"found": [] if found is None else found.ravel().tolist()}))


if sys.argv[1] == "draw":
    draw(sys.argv[2], sys.argv[3], int(sys.argv[4]), sys.argv[5])
elif sys.argv[1] == "detect":
    detect(sys.argv[2], sys.argv[3])
else:
    rectify(sys.argv[2])
