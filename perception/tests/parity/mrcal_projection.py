"""Compares the uncertainty of projection with mrcal's, on the corners of a calibration.

    python3.12 -m venv venv && venv/bin/pip install --no-deps mrcal && venv/bin/pip install numpy numpysane gnuplotlib pyyaml shapely scipy
    lookout calibrate PICTURES --board 9x6 --square-mm 24.23 -o rig.toml --simultaneous --report report
    venv/bin/python perception/tests/parity/mrcal_projection.py report 9x6 24.23 640x360 490

The arguments: report, board, side of a square in mm, size of the images, a focal length to begin with in px. Prints for each camera and distance the median, the
5th and the 95th percentile over the map of: what lookout states for independent errors of the corners over what mrcal states, both for a
corner's error of 1 px; what each takes a corner's error for. Exits with 1 if a median is off by more than 5 %.
"""

import csv
import pathlib
import subprocess
import sys
import tempfile

import mrcal
import numpy as np

report, board, square_mm, size, focal_px = sys.argv[1:]
columns, rows = board.split("x")
width, height = size.split("x")
report = pathlib.Path(report)
first, *lines = (report / "projection.csv").read_text().splitlines()
corner_px = float(first.split()[2])
cells = list(csv.DictReader(lines))

with tempfile.TemporaryDirectory() as folder:
    names = {line.split()[0] for line in (report / "corners.vnl").read_text().splitlines()[1:]}
    between = "/" if "/" in min(names) else ""
    sides = [f"{side}{between}*{pathlib.Path(min(names)).suffix}" for side in ("left", "right")]
    command = ["--corners-cache", report / "corners.vnl", "--lensmodel", "LENSMODEL_OPENCV4", "--focal", focal_px]
    command += ["--object-spacing", str(float(square_mm) / 1000), "--object-width-n", columns, "--object-height-n", rows]
    command += ["--imagersize", width, height, "--outdir", folder, *sides]
    program = pathlib.Path(sys.executable).parent / "mrcal-calibrate-cameras"
    subprocess.run([sys.executable, program, *map(str, command)], check=True, stdout=subprocess.DEVNULL)
    models = [mrcal.cameramodel(f"{folder}/camera-{k}.cameramodel") for k in range(2)]

taken_px = mrcal.model_analysis._observed_pixel_uncertainty_from_inputs(models[0].optimization_inputs())
print(f"error of a corner: lookout {corner_px:.3f} px, mrcal {taken_px:.3f} px")
medians = []
for side, model in zip(("left", "right"), models):
    for distance_m in sorted({cell["distance_m"] for cell in cells}, key=float):
        here = [cell for cell in cells if (cell["camera"], cell["distance_m"]) == (side, distance_m)]
        pixels = np.array([[float(cell["x_px"]), float(cell["y_px"])] for cell in here])
        rays = mrcal.unproject(pixels, *model.intrinsics(), normalize=True)
        is_far = distance_m == "inf"
        theirs = mrcal.projection_uncertainty(
            rays if is_far else rays * float(distance_m),
            model=model,
            atinfinity=is_far,
            what="worstdirection-stdev",
            observed_pixel_uncertainty=1.0,
        )
        ours = np.array([float(cell["independent_px"]) for cell in here]) / corner_px
        low, middle, high = np.quantile(ours / theirs, [0.05, 0.5, 0.95])
        print(f"{side}, {distance_m} m, {len(here)} cells: {middle:.2f} ({low:.2f} to {high:.2f})")
        medians.append(middle)

# What the documentation says of --simultaneous.
sys.exit(any(abs(median - 1) > 0.05 for median in medians))
