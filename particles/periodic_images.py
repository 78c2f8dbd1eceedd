"""Compiled vectors of the periodic images of grains, by the table of images of `particles.periodicity`.

A grain meets the image of its partner in row s + m of the table (2 m + 1, 6), with s the shift of their pair; the table
has one row where space does not repeat. Functions of a pair of a list take the number k of its shift (of eight pairs:
eight numbers), and return what they are given where there is no image.
"""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import any_lane, from_integers
from geometry.kernels.simd_tables import gather, gather_column, gather_columns, gather_two_columns
from particles.periodicity import COS, DU, DX, DY, DZ, SIN


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def images_of_partners(images, row):
    """Images of eight partners: cosine and sine of a turn about z, translation (3) [m]."""
    c, s, dx, dy = gather_columns(images, row, COS)
    return c, s, dx, dy, gather_column(images, row, DZ)


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def place_to_image(image, x, y, z):
    """Place [m] of the image of a partner at x, y, z."""
    c, s, dx, dy, dz = image
    return c * x - s * y + dx, s * x + c * y + dy, z + dz


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def vector_to_image(image, x, y, z):
    """Vector of the image of a partner whose own vector is x, y, z."""
    c, s, _, _, _ = image
    return c * x - s * y, s * x + c * y, z


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def vector_from_image(image, x, y, z):
    """The inverse of `vector_to_image`."""
    c, s, _, _, _ = image
    return c * x + s * y, c * y - s * x, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_place_to_image(images, shift, k, x, y, z):
    """Place [m] of the image of the partner of pair k, which stands at x, y, z."""
    if images.shape[0] > 1:
        row = images.shape[0] // 2 + shift[k]
        c, s = images[row, COS], images[row, SIN]
        x, y = c * x - s * y + images[row, DX], s * x + c * y + images[row, DY]
        z += images[row, DZ]
    return x, y, z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_vector_to_image(images, shift, k, x, y):
    """Components across the axis of a vector of the partner of pair k, at its image."""
    if images.shape[0] > 1:
        row = images.shape[0] // 2 + shift[k]
        c, s = images[row, COS], images[row, SIN]
        x, y = c * x - s * y, s * x + c * y
    return x, y


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_velocity_to_image(images, shift, k, x, y):
    """`pair_vector_to_image` of a velocity [m/s]; moving images add their own."""
    if images.shape[0] > 1:
        row = images.shape[0] // 2 + shift[k]
        c, s = images[row, COS], images[row, SIN]
        x, y = c * x - s * y + images[row, DU], s * x + c * y
    return x, y


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_vector_from_image(images, shift, k, x, y):
    """The inverse of `pair_vector_to_image`."""
    if images.shape[0] > 1:
        row = images.shape[0] // 2 + shift[k]
        c, s = images[row, COS], images[row, SIN]
        x, y = c * x + s * y, c * y - s * x
    return x, y


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _rows(images, across):
    """Rows of the table of eight images by their shifts."""
    m = images.shape[0] // 2
    return (
        across[0] + m, across[1] + m, across[2] + m, across[3] + m, across[4] + m, across[5] + m, across[6] + m,
        across[7] + m,
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _any_across(across):
    number = from_integers(across)
    return any_lane(number * number > 0.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pairs_to_images(images, shift, k, ax, ay, bx, by):
    """`pair_velocity_to_image` of a and `pair_vector_to_image` of b, for the partners of eight pairs."""
    if images.shape[0] > 1:
        across = gather(shift, k)
        if _any_across(across):
            row = _rows(images, across)
            c, s = gather_two_columns(images, row, COS)
            ax, ay = c * ax - s * ay + gather_column(images, row, DU), s * ax + c * ay
            bx, by = c * bx - s * by, s * bx + c * by
    return ax, ay, bx, by


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pairs_from_images(images, shift, k, ax, ay, bx, by):
    """`pair_vector_from_image` of two vectors, for the partners of eight pairs."""
    if images.shape[0] > 1:
        across = gather(shift, k)
        if _any_across(across):
            c, s = gather_two_columns(images, _rows(images, across), COS)
            ax, ay = c * ax + s * ay, c * ay - s * ax
            bx, by = c * bx + s * by, c * by - s * bx
    return ax, ay, bx, by
