"""Reads a channel of level 0 from a brick store (docs/FORMAT.md) as one NumPy array.

Ashfall imports every format it knows into a store, so this is the only file format that is read here.
Stores are those that `ashfall import --compress none` has just written: checksums are left to
`ashfall verify`.
"""

import struct

import numpy as np

from refusal import INPUT, Refusal

HEADER = struct.Struct("<8sIIQQQQQQQ")
DESCRIPTION = struct.Struct("<8I12d4I")
CHANNEL = struct.Struct("<II2d3Q2f")
ENTRY = struct.Struct("<6sBBIfffQ")
PAGE_HEADER_BYTES, PAGE_ENTRIES = 16, 128
PAGE_BYTES = PAGE_HEADER_BYTES + PAGE_ENTRIES * ENTRY.size
MAGIC = b"\x89BRICKS\n"
FORMATS = ["u1", "<u2", "<i2", "<f4"]
ABSENT, CONSTANT, RAW = 0, 1, 2


class Volume:
    """`voxels` [z, y, x] as stored; scaled value = slope * voxel + intercept."""

    def __init__(self, voxels, world_from_voxel, slope, intercept):
        self.voxels = voxels
        self.world_from_voxel = world_from_voxel
        self.slope = slope
        self.intercept = intercept


def read_channel(path, channel):
    """Channel `channel` of the store at `path`."""
    with open(path, "rb") as file:
        header = HEADER.unpack(file.read(HEADER.size))
        magic, version, _, _, index_place, _, place, length = header[:8]
        if magic != MAGIC or version != 1:
            raise Refusal(
                INPUT, f"{path}: is no brick store of version 1: use the binary of this tool's version"
            )
        file.seek(place)
        description = file.read(length)
        numbers = DESCRIPTION.unpack_from(description)
        size, payload, channels = numbers[0:3], numbers[3:6], numbers[6]
        if channel >= channels:
            raise Refusal(INPUT, f"channel {channel} is not in the file, which has {channels}")
        told = CHANNEL.unpack_from(description, DESCRIPTION.size + channel * CHANNEL.size)
        if told[0] >= len(FORMATS):
            raise Refusal(
                INPUT, "the voxels are rgba8, which are not compared: choose a scene with scalar ones"
            )
        voxels = np.empty(size[::-1], FORMATS[told[0]])
        # Bricks are counted level by level, finest first, and within a level channel by channel.
        bricks = [-(-voxels // payload) for voxels, payload in zip(size, payload)]
        first = channel * bricks[0] * bricks[1] * bricks[2]
        for number in range(bricks[0] * bricks[1] * bricks[2]):
            x, rest = number % bricks[0], number // bricks[0]
            brick = (x, rest % bricks[1], rest // bricks[1])
            begin = [index * edge for index, edge in zip(brick, payload)]
            end = [min(at + edge, most) for at, edge, most in zip(begin, payload, size)]
            box = tuple(slice(a, b) for a, b in zip(begin[::-1], end[::-1]))
            shape = tuple(part.stop - part.start for part in box)
            voxels[box] = _brick(file, index_place, first + number, shape, voxels.dtype)
    return Volume(voxels, np.array(numbers[8:20]).reshape(3, 4), told[2], told[3])


def _brick(file, index_place, number, shape, dtype):
    """A brick's payload, or the one value that all of it has."""
    page, entry = divmod(number, PAGE_ENTRIES)
    file.seek(index_place + page * PAGE_BYTES + PAGE_HEADER_BYTES + entry * ENTRY.size)
    place, kind, *_ = ENTRY.unpack(file.read(ENTRY.size))
    if kind == ABSENT:
        return np.nan
    if kind == CONSTANT:
        return np.frombuffer(place, dtype, 1)[0]
    if kind != RAW:
        raise Refusal(INPUT, f"brick {number} of the store is compressed, though it was imported without")
    file.seek(int.from_bytes(place, "little"))
    # An apron of one voxel on every side.
    stored = [edge + 2 for edge in shape]
    values = np.frombuffer(file.read(int(np.prod(stored)) * dtype.itemsize), dtype)
    return values.reshape(stored)[1:-1, 1:-1, 1:-1]
