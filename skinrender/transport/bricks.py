"""Bricks: the columns of a voxel plane in squares, each uniform or not."""

BRICK_BITS = 4
BRICK = 1 << BRICK_BITS  # columns along a side
