"""Pictures against the truth, and to look at."""

import math

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkPNGWriter


def psnr_db(picture, truth):
    """Over linear rgb with peak 1; infinite for equal pictures."""
    mean_square = float(((picture - truth) ** 2).mean())
    return math.inf if mean_square == 0 else -10 * math.log10(mean_square)


def write_png(path, picture):
    """8 bit sRGB of linear rgb, row 0 on top."""
    linear = np.clip(picture, 0, 1)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    codes = np.round(srgb * 255).astype(np.uint8)[::-1]
    image = vtkImageData()
    image.SetDimensions(codes.shape[1], codes.shape[0], 1)
    image.GetPointData().SetScalars(numpy_to_vtk(codes.reshape(-1, 3), deep=True))
    writer = vtkPNGWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    writer.Write()
