"""The paper's calibration, and what it shares with the joint refinement.

In reading order:

- ``methods``: their names
- ``reference``: which board becomes the virtual plane
- ``numbering``: boards numbered with the wrong handedness are found and renumbered
- ``condensing``: dense boards reduced to fewer, better points
- ``one_image``: the method itself, a map from one board and K from the others
- ``observation``: a camera's view of each board: which corners count, homography, pose
- ``zhang``: K from homographies in closed form (paper, appendix B)
- ``poses``: poses, and K with poses, by least squares
- ``intrinsics``: K with its error bars, from the two modules before
- ``turning``: boards that look the same after half a turn, numbered alike by the board's own shape
- ``circles``: centroids of a circle grid's discs corrected to the images of their centres
- ``findings``: what else was found, such as the board's shape and wrong corners
- ``result``: the finished calibration, by whichever method
"""
