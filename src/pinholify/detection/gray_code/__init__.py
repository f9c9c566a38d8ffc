"""Gray codes and waves on a screen: pictures to show, and their captures to thousands of correspondences.

:class:`Sequence` describes the pictures, :func:`write_patterns` writes them, and :func:`decode_folders` decodes
captures into nodes of the screen.
"""

from pinholify.detection.gray_code.captures import read_manifest, write_patterns
from pinholify.detection.gray_code.decode import Decoded, decode_captures, decode_folders
from pinholify.detection.gray_code.patterns import Pattern, Sequence
from pinholify.detection.gray_code.screen_map import ScreenMap

__all__ = [
    "Decoded",
    "Pattern",
    "ScreenMap",
    "Sequence",
    "decode_captures",
    "decode_folders",
    "read_manifest",
    "write_patterns",
]
