"""Calibration files as each program writes them, all of the same camera: OpenCV's five coefficients."""

from __future__ import annotations

SIZE = (640, 480)
CORE = (420.0, 421.5, 325.4, 234.1)
DISTORTION = (-0.21, 0.06, 0.0011, -0.0007, -0.008)
FX, FY, CX, CY = CORE

OPENCV = f"""%YAML:1.0
---
calibration_time: "Sun Nov 22 09:00:00 2026"
image_width: {SIZE[0]}
image_height: {SIZE[1]}
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {FX}, 0., {CX}, 0., {FY}, {CY}, 0., 0.,
       1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ {", ".join(map(repr, DISTORTION))} ]
avg_reprojection_error: 2.1e-01
"""

OPENCV_XML = f"""<?xml version="1.0"?>
<opencv_storage>
<image_width>{SIZE[0]}</image_width>
<image_height>{SIZE[1]}</image_height>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    {FX} 0. {CX} 0. {FY} {CY} 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    {" ".join(map(repr, DISTORTION))}</data></distortion_coefficients>
</opencv_storage>
"""

ROS = f"""image_width: {SIZE[0]}
image_height: {SIZE[1]}
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [{FX}, 0, {CX}, 0, {FY}, {CY}, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [{", ".join(map(repr, DISTORTION))}]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 320, 0, 0, 400, 240, 0, 0, 0, 1, 0]
"""

ROS_FLOW = f"""image_width: {SIZE[0]}
image_height: {SIZE[1]}
camera_name: narrow_stereo/left
camera_matrix: {{rows: 3, cols: 3, data: [{FX}, 0, {CX},
    0, {FY}, {CY}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{cols: 5, data: [{", ".join(map(repr, DISTORTION))}], rows: 1}}
rectification_matrix: {{"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{
  rows: 3, cols: 4,
  data: [400, 0, 320, 0, 0, 400, 240, 0, 0, 0, 1, 0],
}}
"""

MRCAL = f"""# generated on 2026-11-22 09:00:00 with   mrcal-calibrate-cameras
{{
    'lensmodel':  'LENSMODEL_OPENCV5',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ {", ".join(map(repr, CORE + DISTORTION))},],

    # extrinsics are rt_fromref
    'extrinsics': [ 0.1, 0, 0, 0, 0, 3,],

    'imagersize': [ {SIZE[0]}, {SIZE[1]},],

    'icam_intrinsics': 0,
    'optimization_inputs': b'P)h>@6aWAK2mnTQl~Ddr',
}}
"""

KALIBR = f"""cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [{", ".join(map(repr, DISTORTION[:4]))}]
  distortion_model: radtan
  intrinsics: [{", ".join(map(repr, CORE))}]
  resolution: [{SIZE[0]}, {SIZE[1]}]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: ds
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [-0.2, 0.55, 200.0, 201.0, 330.0, 240.0]
  resolution: [{SIZE[0]}, {SIZE[1]}]
  rostopic: /cam1/image_raw
"""

FILES = {
    "opencv.yaml": OPENCV,
    "opencv.xml": OPENCV_XML,
    "ros.yaml": ROS,
    "ros_flow.yaml": ROS_FLOW,
    "mrcal.cameramodel": MRCAL,
    "kalibr.yaml": KALIBR,
}
