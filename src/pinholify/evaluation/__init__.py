"""How good a calibration is: the paper's measures, held-out error, and OpenCV's models on the same corners."""
