"""Draws a grid with VTK's volume mappers, and takes the time.

How VTK comes to draw the same integral: the image's origin is the centre of the first voxel; the opacity
of a transfer point is 1 - exp(-extinction * unit) with unit as ScalarOpacityUnitDistance, and points are
added between those of the scene, since VTK interpolates opacity and not extinction; values are
interpolated linearly; shading, jitter and automatic distances are off. A float frame buffer comes from a
vtkFramebufferPass. VTK ends an image at the centres of its outermost voxels: where these show something,
one more voxel is repeated around it, and clipping planes cut it at the box of the voxels.

The fixed-point mapper's picture is read where it is cast, 15 bits a component. What VTK shows of it on a
screen is stretched by half a pixel towards the edges, some 36 dB from itself.
"""

import ctypes
import os
import time
from itertools import pairwise

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_FLOAT, vtkOutputWindow, vtkUnsignedCharArray, vtkVersion
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction, vtkPlane, vtkPlaneCollection
from vtkmodules.vtkRenderingCore import (
    vtkColorTransferFunction,
    vtkRenderer,
    vtkRenderWindow,
    vtkVolume,
    vtkVolumeProperty,
)
from vtkmodules.vtkRenderingOpenGL2 import vtkFramebufferPass, vtkRenderStepsPass, vtkTextureObject
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper
from vtkmodules.vtkRenderingVolumeOpenGL2 import vtkOpenGLGPUVolumeRayCastMapper

from refusal import MACHINE, Refusal

# Points within every segment of a transfer function.
POINTS_BETWEEN = 256
# How far before a jump its lower end stands, in parts of the function's width: VTK has one point a place.
JUMP_PART = 1e-4
# Nearest near plane, in parts of the far one, for an eye in the volume. Nearer ones cost VTK's fixed-point
# mapper its digits: 1e-4 and 1e-5 leave 44 and 30 dB of what is 56 dB here.
NEAR_PART = 1e-3


def version():
    """VTK's own."""
    return vtkVersion.GetVTKVersion()


class Canvas:
    """A window that no screen shows, with one volume in it."""

    def __init__(self, grid, camera, size, background, mapper_name, as_f32):
        self.size = size
        self.window = vtkRenderWindow()
        wanted = os.environ.get("VTK_DEFAULT_OPENGL_WINDOW", self.window.GetClassName())
        if self.window.GetClassName() != wanted:
            raise Refusal(MACHINE, f"VTK cannot make a {wanted}: install EGL and Mesa's drivers, or name another")
        self.window.SetOffScreenRendering(True)
        self.window.SetMultiSamples(0)
        self.window.SetSize(*size)
        self.renderer = vtkRenderer()
        self.renderer.SetBackground(*background)
        self.window.AddRenderer(self.renderer)
        self.unit = grid.unit
        self.background = np.array(background)
        self.mapper_name = mapper_name
        self.mapper = MAPPERS[mapper_name]()
        self.image, planes = image_of(grid, as_f32)
        self.mapper.SetInputData(self.image)
        if planes is not None:
            self.mapper.SetClippingPlanes(planes)
        self.mapper.SetAutoAdjustSampleDistances(False)
        self.mapper.SetLockSampleDistanceToInputSpacing(False)
        self.mapper.SetImageSampleDistance(1.0)
        volume = vtkVolume()
        volume.SetMapper(self.mapper)
        volume.SetProperty(property_of(grid))
        self.renderer.AddVolume(volume)
        place_camera(self.renderer.GetActiveCamera(), camera, grid)
        self.float_pass = None
        if as_f32 and mapper_name == GPU:
            self.float_pass = vtkFramebufferPass()
            self.float_pass.SetDelegatePass(vtkRenderStepsPass())
            self.float_pass.SetColorFormat(vtkTextureObject.Float32)
            # The depth format that it has unless told makes the picture black.
            self.float_pass.SetDepthFormat(vtkTextureObject.Fixed32)
            self.renderer.SetPass(self.float_pass)

    def draw(self, step):
        """One frame with samples `step` units apart: (processor ms, wall ms)."""
        self.mapper.SetSampleDistance(step * self.unit)
        if hasattr(self.mapper, "SetInteractiveSampleDistance"):
            self.mapper.SetInteractiveSampleDistance(step * self.unit)
        self.window.WaitForCompletion()
        processor, wall = time.process_time(), time.perf_counter()
        self.window.Render()
        self.window.WaitForCompletion()
        return (time.process_time() - processor) * 1e3, (time.perf_counter() - wall) * 1e3

    def picture(self):
        """What the last frame shows: [row from the top, column, rgb], linear."""
        width, height = self.size
        if self.float_pass is not None:
            rgba = np.empty((height, width, 4), np.float32)
            pixels = self.float_pass.GetColorTexture().Download()
            if not pixels.Download2D(VTK_FLOAT, rgba, [width, height], 4, [0, 0]):
                raise Refusal(MACHINE, "VTK's float frame buffer cannot be read from this driver")
            return rgba[::-1, :, :3].astype(float)
        if self.mapper_name == FIXED_POINT:
            return self._cast_picture()
        pixels = vtkUnsignedCharArray()
        self.window.GetRGBACharPixelData(0, 0, width - 1, height - 1, False, pixels)
        return vtk_to_numpy(pixels).reshape(height, width, 4)[::-1, :, :3] / 255.0

    def _cast_picture(self):
        """The fixed-point mapper's own picture over the background."""
        image = self.mapper.GetRayCastImage()
        # Python is given the address as text, "_0123abcd_p_void".
        address = ctypes.cast(int(image.GetImage().split("_")[1], 16), ctypes.POINTER(ctypes.c_uint16))
        (columns, rows), (left, bottom) = image.GetImageInUseSize(), image.GetImageOrigin()
        memory_columns, memory_rows = image.GetImageMemorySize()
        cast = np.ctypeslib.as_array(address, (memory_rows, memory_columns, 4))[:rows, :columns]
        width, height = self.size
        rgba = np.zeros((height, width, 4))
        rgba[bottom : bottom + rows, left : left + columns] = cast / FIXED_POINT_ONE
        over = rgba[:, :, :3] + (1 - rgba[:, :, 3:]) * self.background
        return over[::-1]

    def close(self):
        """Gives the window's memory back."""
        self.renderer.SetPass(None)
        if self.float_pass is not None:
            self.float_pass.ReleaseGraphicsResources(self.window)
        self.window.Finalize()


GPU, FIXED_POINT = "GPU", "fixed-point"
FIXED_POINT_ONE = 32767


def _gpu_mapper():
    mapper = vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetUseJittering(False)
    return mapper


MAPPERS = {GPU: _gpu_mapper, FIXED_POINT: vtkFixedPointVolumeRayCastMapper}


def machine(canvas):
    """Window class and driver, once something is drawn."""
    lines = canvas.window.ReportCapabilities().splitlines()
    told = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    driver = told.get("OpenGL renderer string", "unknown"), told.get("OpenGL version string", "unknown")
    return canvas.window.GetClassName(), f"{driver[0]}, OpenGL {driver[1]}"


def image_of(grid, as_f32):
    """The image, and the planes that cut it where it is padded."""
    voxels, margin, planes = grid.voxels, 0, None
    if grid.border_shows():
        voxels, margin = np.pad(voxels, 1, mode="edge"), 1
        planes = vtkPlaneCollection()
        box = grid.size * grid.spacing
        for axis in range(3):
            for place, sense in ((0.0, 1.0), (box[axis], -1.0)):
                plane = vtkPlane()
                plane.SetOrigin(*(place * (np.arange(3) == axis)))
                plane.SetNormal(*(sense * (np.arange(3) == axis)))
                planes.AddItem(plane)
    if as_f32:
        voxels = voxels.astype(np.float32)
    image = vtkImageData()
    image.SetDimensions(*voxels.shape[::-1])
    image.SetSpacing(*grid.spacing)
    image.SetOrigin(*(grid.spacing * (0.5 - margin)))
    values = numpy_to_vtk(np.ascontiguousarray(voxels).ravel(), deep=True)
    image.GetPointData().SetScalars(values)
    return image, planes


def property_of(grid):
    """Colours and opacities."""
    colours, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
    colours.SetColorSpaceToRGB()
    points = apart(grid.points)
    for value, rgb, _ in points:
        colours.AddRGBPoint(value, *rgb)
    for (value, _, extinction), (next_value, _, next_extinction) in pairwise(points):
        for part in np.arange(POINTS_BETWEEN) / POINTS_BETWEEN:
            here = extinction + part * (next_extinction - extinction)
            opacities.AddPoint(value + part * (next_value - value), opacity(here, grid.unit))
    opacities.AddPoint(points[-1][0], opacity(points[-1][2], grid.unit))
    look = vtkVolumeProperty()
    look.SetColor(colours)
    look.SetScalarOpacity(opacities)
    look.SetScalarOpacityUnitDistance(grid.unit)
    look.SetInterpolationTypeToLinear()
    look.ShadeOff()
    return look


def opacity(extinction, distance):
    """Of a way through what is even."""
    return -np.expm1(-extinction * distance)


def apart(points):
    """The points, those that stand at one place moved apart."""
    width = points[-1][0] - points[0][0] or 1.0
    kept = list(points)
    for index in range(len(kept) - 2, -1, -1):
        before = kept[index + 1][0] - JUMP_PART * width
        if kept[index][0] >= kept[index + 1][0]:
            kept[index] = (before, *kept[index][1:])
    return kept


def place_camera(vtk_camera, camera, grid):
    """The scene's camera, its planes around the volume."""
    vtk_camera.SetPosition(*camera.eye)
    vtk_camera.SetFocalPoint(*camera.target)
    vtk_camera.SetViewUp(*camera.up)
    if camera.height is not None:
        vtk_camera.ParallelProjectionOn()
        vtk_camera.SetParallelScale(camera.height / 2)
    else:
        vtk_camera.SetViewAngle(camera.fov_degrees)
    forward = (camera.target - camera.eye) / np.linalg.norm(camera.target - camera.eye)
    corners = np.array(np.meshgrid(*([0.0, edge] for edge in grid.size * grid.spacing))).reshape(3, -1)
    depths = forward @ (corners - camera.eye[:, None])
    far = max(depths.max() * 1.01, grid.unit)
    vtk_camera.SetClippingRange(max(depths.min() * 0.99, far * NEAR_PART), far)


def be_quiet():
    """VTK's warnings would stand between the lines of progress."""
    vtkOutputWindow.GetInstance().SetDisplayModeToNever()
