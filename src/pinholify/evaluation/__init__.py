"""The quality of a calibration: the paper's measures, held-out error, and OpenCV's models on the same corners."""
