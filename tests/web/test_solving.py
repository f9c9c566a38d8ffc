"""Results as pages receive them."""

from __future__ import annotations

from pinholify.web.solving import GRID, std_grid


class Ramp:
    """A camera whose standard deviation is the column of the pixel."""

    image_size = (2 * GRID[0], 2 * GRID[1])

    def shape_std(self, uv):
        return uv[:, 0]


def test_the_map_of_standard_deviations_is_sampled_at_the_centres_of_its_cells():
    grid = std_grid(Ramp())
    assert (grid["columns"], grid["rows"]) == GRID
    assert grid["values"][: GRID[0]] == [2 * column + 0.5 for column in range(GRID[0])]
