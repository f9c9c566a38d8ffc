"""The methods of calibration by name, and how many boards they need. Imports nothing, so that ``--help`` is instant."""

METHODS = {
    "auto": "joint with four or more boards",
    "joint": "all boards determine the map",
    "one-image": "the reference alone",
}
"""Name of each method → what it does."""

FEWEST_BOARDS = 3
"""The reference and two boards of other orientations."""
