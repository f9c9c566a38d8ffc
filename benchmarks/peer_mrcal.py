"""A splined model by mrcal, for ``peers.py``: run with the Python that has it (Debian's packages mrcal, python3-mrcal).

    python3 peer_mrcal.py FOLDER CASE COLUMNSxROWS WIDTHxHEIGHT FOCAL_PX MODEL RAYS.csv

reads CASE.vnl and CASE.pixels.csv from FOLDER, and writes the rays of those pixels.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import mrcal
import numpy as np

folder, name, board, size, focal, model, out = sys.argv[1:]
table, (columns, rows), (width, height) = Path(folder, f"{name}.vnl").resolve(), board.split("x"), size.split("x")
with tempfile.TemporaryDirectory() as work:
    for frame in {line.split()[0] for line in table.read_text().splitlines() if not line.startswith("#")}:
        Path(work, frame).touch()  # it wants the images to be there, but does not open them
    subprocess.run(
        ["mrcal-calibrate-cameras", "--corners-cache", str(table), "--lensmodel", model, "--focal", focal,
         "--object-spacing", "1", "--object-width-n", columns, "--object-height-n", rows,
         "--imagersize", width, height, "frame*.png"],
        cwd=work, check=True, stdout=subprocess.DEVNULL,
    )
    camera = mrcal.cameramodel(str(Path(work, "camera-0.cameramodel")))
pixels = np.ascontiguousarray(np.loadtxt(Path(folder, f"{name}.pixels.csv"), delimiter=",", skiprows=1))
np.savetxt(out, mrcal.unproject(pixels, *camera.intrinsics()), delimiter=",", header="x,y,z", comments="")
