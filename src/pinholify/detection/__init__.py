"""From images to the corners of a board: ``detect_board`` for one image, ``detect_files`` for many."""

from pinholify.detection.checkerboard import detect_size
from pinholify.detection.detect import detect_board
from pinholify.detection.files import detect_files, detect_size_in_files, look_again_in_files
from pinholify.detection.second_look import look_again

__all__ = [
    "detect_board",
    "detect_files",
    "detect_size",
    "detect_size_in_files",
    "look_again",
    "look_again_in_files",
]
