"""A scene as VTK can draw it: one channel on an axis-parallel grid, and a camera in the grid's frame.

# Units
Lengths are world units. The grid's frame is the world turned (and mirrored) so that voxels lie along the
axes and the volume's corner is the origin: lengths, and so extinctions, stay what they are.
"""

import tomllib
from pathlib import Path

import numpy as np

from refusal import ARGUMENTS, INPUT, Refusal

# A grid whose axes are turned against each other by more than this many radians is sheared.
SHEAR_MAX = 1e-5


class Scene:
    """What the file says, checked for what VTK cannot draw; `ashfall` has checked the rest."""

    def __init__(self, path, view, size):
        self.path = Path(path)
        with open(path, "rb") as file:
            told = tomllib.load(file)
        volumes, views = told["volume"], told["view"]
        channels = volumes[0]["channel"]
        for what, count in (("volumes", len(volumes)), ("channels", len(channels))):
            if count != 1:
                raise self._refusal(
                    f"shows {count} {what}, and VTK is compared on one: choose a scene with one"
                )
        self.volume, self.channel = volumes[0], channels[0]
        source = self.volume["source"]
        if not isinstance(source, str):
            why = f'computes "{source["computed"]}", and VTK needs voxels'
            raise self._refusal(f"{why}: choose a scene whose source is a file")
        self.source = self.path.parent / source
        names = [one.get("name", f"view{index}") for index, one in enumerate(views)]
        if view is not None and view not in names:
            known = ", ".join(f'"{name}"' for name in names)
            raise Refusal(ARGUMENTS, f'--view: "{view}" is not in the scene, which has {known}')
        self.view_name = names[0] if view is None else view
        self.view = views[names.index(self.view_name)]
        if "frustum" in self.view:
            raise self._refusal(
                f'view "{self.view_name}" has a frustum: choose one with fov_degrees or height'
            )
        picture = told.get("picture", {})
        self.size = size or picture.get("size", [512, 512])
        self.background = picture.get("background", [0.0, 0.0, 0.0])

    def import_flags(self):
        """Flags of `ashfall import` that say how the source is read."""
        raw = self.volume.get("raw")
        if raw is None:
            return []
        size = "x".join(str(edge) for edge in raw["size"])
        return ["--raw-size", size, "--raw-type", raw["type"], "--raw-endian", raw.get("endian", "little")]

    def world_from_voxel(self, of_file):
        """The 3 x 4 matrix from voxels (corner origin), of the scene or else of the file."""
        if "spacing" in self.volume:
            return np.hstack([np.diag(self.volume["spacing"]), np.zeros((3, 1))])
        return np.array(self.volume.get("transform", of_file), float)

    def grid(self, volume):
        """The volume on its grid, and the camera in the grid's frame."""
        matrix = self.world_from_voxel(volume.world_from_voxel)
        linear, corner = matrix[:, :3], matrix[:, 3]
        spacing = np.linalg.norm(linear, axis=0)
        world_from_grid = linear / spacing
        voxels = volume.voxels
        if np.linalg.det(world_from_grid) < 0:
            # A mirrored grid: x runs the other way from the other end, so that the rest is a rotation.
            corner = corner + linear[:, 0] * voxels.shape[2]
            world_from_grid = world_from_grid * [-1, 1, 1]
            voxels = voxels[:, :, ::-1]
        if np.abs(world_from_grid.T @ world_from_grid - np.eye(3)).max() > SHEAR_MAX:
            raise self._refusal("its volume is sheared, which VTK does not draw: choose one that is not")
        if voxels.dtype.kind == "f" and np.isnan(voxels).any():
            raise self._refusal(
                "has voxels that are NaN or absent, which VTK does not leave out: choose another"
            )
        grid = Grid(np.ascontiguousarray(voxels), spacing, self._points(volume))
        return grid, self._camera(world_from_grid, corner)

    def _points(self, volume):
        """The transfer function in stored values: (value, rgb, extinction), values rising."""
        low, high = self.channel["window"]
        slope, intercept = volume.slope, volume.intercept
        if slope == 0:
            raise self._refusal("its file has slope 0, so that all voxels are one value: choose another")
        points = [
            ((low + point["at"] * (high - low) - intercept) / slope, point["color"], point["extinction"])
            for point in self.channel["transfer"]
        ]
        return points if slope > 0 else points[::-1]

    def _camera(self, world_from_grid, corner):
        eye, target = (world_from_grid.T @ (np.array(self.view[key]) - corner) for key in ("eye", "target"))
        up = world_from_grid.T @ np.array(self.view["up"], float)
        return Camera(eye, target, up, self.view.get("fov_degrees"), self.view.get("height"))

    def _refusal(self, why):
        return Refusal(INPUT, f"{self.path}: {why}")


class Grid:
    """Voxels [z, y, x] that lie `spacing` apart from the origin on, each in the middle of its box."""

    def __init__(self, voxels, spacing, points):
        self.voxels = voxels
        self.spacing = spacing
        self.points = points
        self.size = np.array(voxels.shape[::-1])
        # The step that is called 1.
        self.unit = float(spacing.min())

    def extinction(self, values):
        """Of stored values."""
        at = [point[0] for point in self.points]
        return np.interp(values, at, [point[2] for point in self.points])

    def border_shows(self):
        """Whether an outermost voxel shows something, so that the half voxel outside its centre counts."""
        faces = [np.take(self.voxels, [0, -1], axis) for axis in range(3)]
        return any(self.extinction(np.unique(face)).max() > 0 for face in faces)


class Camera:
    """In the grid's frame. One of `fov_degrees` (vertical) and `height` (of a parallel picture) is there."""

    def __init__(self, eye, target, up, fov_degrees, height):
        self.eye = eye
        self.target = target
        self.up = up
        self.fov_degrees = fov_degrees
        self.height = height
