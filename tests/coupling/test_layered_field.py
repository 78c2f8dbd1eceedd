"""The field of layers between steel faces: two layers in series, its mean, a sheet of dipoles and all its images."""

import numpy as np
import pytest

from coupling import LayeredField

GAP, AREA, H0 = 2e-3, 4e-6, 80e3
WIDTH = 0.1 * GAP


def layers_between(width=WIDTH):
    return LayeredField(H0, GAP, AREA, width)


def sheets(n=4000):
    """Positions (n, 3) of thin sheets that fill the gap, and the volume of each."""
    z = GAP * (np.arange(n) + 0.5) / n
    return np.outer(z, [0.0, 0.0, 1.0]), AREA * GAP / n


def settle(layers, place, moment_of, most=200, tolerance=1e-10):
    """Steps until moments and field agree."""
    for step in range(1, most + 1):
        H = layers.sample(place)[0][:, 2]
        if layers.follow(place, np.outer(moment_of(H), [0.0, 0.0, 1.0])) <= tolerance:
            return step
    raise AssertionError("field and moments do not agree")


def mean_is_kept(layers):
    return np.trapezoid(layers.strength, layers.height) == pytest.approx(H0 * GAP, rel=1e-13)


def test_even_powder_leaves_the_field():
    layers = layers_between()
    place, volume = sheets()
    assert settle(layers, place, lambda H: 3.0 * H * volume, tolerance=1e-6) <= 2
    assert layers.strength == pytest.approx(H0, rel=1e-5)
    assert layers.magnetisation == pytest.approx(3.0 * layers.strength, rel=1e-5)


@pytest.mark.parametrize("chi", [0.5, 4.0, 10.0])
def test_two_layers_of_a_linear_powder_are_in_series(chi):
    """H (1 + chi) is the same in both, and the drops of both add up to what stands between the faces."""
    layers = layers_between()
    place, volume = sheets()
    border = 0.5 * GAP
    low = place[:, 2] < border
    settle(layers, place, lambda H: np.where(low, chi, 0.0) * H * volume, tolerance=1e-6)
    flux = layers.strength * np.where(layers.height < border, 1.0 + chi, 1.0)
    away = abs(layers.height - border) > 3.0 * WIDTH
    assert flux[away] == pytest.approx(flux[0], rel=3e-3)
    # the border is as wide as the kernel, a tenth of the gap, and the drop there is not that of either layer
    assert flux[0] == pytest.approx(2.0 * H0 / (1.0 / (1.0 + chi) + 1.0), rel=0.06)
    assert mean_is_kept(layers)


def test_a_saturated_layer_takes_its_magnetisation_from_the_field():
    layers = layers_between()
    place, volume = sheets()
    M = 60e3
    settle(layers, place, lambda H: np.where(place[:, 2] < 0.5 * GAP, M, 0.0) * volume)
    z, flux = layers.height, layers.strength
    bare = z > 0.5 * GAP + 1.1 * WIDTH
    filled = (z < 0.5 * GAP - 1.1 * WIDTH) & (z > WIDTH)
    assert flux[bare] == pytest.approx(flux[-1], rel=1e-9)
    assert layers.strength[filled] == pytest.approx(flux[-1] - M, rel=1e-4)
    assert mean_is_kept(layers)


def test_the_deposit_keeps_the_moments_and_the_field_its_mean():
    """Of grains anywhere, also nearer to a face than the width, and of moments of both signs."""
    layers = layers_between()
    random = np.random.default_rng(7)
    z = GAP * np.concatenate(([0.0, 1.0, 0.01, 0.99], random.uniform(size=200)))
    moment = np.outer(random.normal(1e-6, 2e-6, len(z)), [0.0, 0.0, 1.0])
    for _ in range(3):
        layers.follow(np.outer(z, [0.0, 0.0, 1.0]), moment)
        total = AREA * np.trapezoid(layers.magnetisation, layers.height)
        assert total == pytest.approx(moment.sum(), rel=1e-12)
        assert mean_is_kept(layers)


def lattice(spacing, reach):
    """Distances in the plane of a square lattice up to `reach`, without the origin."""
    n = np.arange(-int(reach / spacing) - 1, int(reach / spacing) + 2) * spacing
    rho = np.hypot(*np.meshgrid(n, n)).ravel()
    return rho[(rho > 0.0) & (rho <= reach)]


def normal_field(rho, depth, width):
    """Normal field on normal unit moments at (rho, depth) from them, less that of their smear: K and Q of the split."""
    d2 = rho**2 + depth**2
    s = np.sqrt(d2) / width
    outside = np.where(s < 1.0, 1.0 - (35.0 * s**3 - 42.0 * s**5 + 15.0 * s**7) / 8.0, 0.0)
    kernel = np.where(s < 1.0, 105.0 / (32.0 * np.pi * width**3) * (1.0 - s**2) ** 2, 0.0)
    cos2 = depth**2 / d2
    return outside * (3.0 * cos2 - 1.0) / (4.0 * np.pi * d2**1.5) + kernel * cos2


@pytest.mark.parametrize("share", [1.0, 0.3, 0.15])
def test_a_sheet_of_dipoles_has_the_field_of_all_its_images(share):
    """Own sheet, -9.0336 m/(4 pi s^3) (Topping 1927), its images and the fixed drop, m/(s^2 gap) - whatever the width.

    At a height of 0.3 and 0.15 widths over a face the image is in reach. Layers that far away count as even sheets,
    whose field outside is 0: exp(-2 pi D/s).
    """
    width, spacing = 0.25 * GAP, 0.1 * GAP
    layers = layers_between(width)
    h, area = share * width, spacing**2
    m = 0.02 * H0 * area * GAP
    place = np.array([[0.0, 0.0, h]])
    settle(layers, place, lambda H: np.full(1, m * AREA / area))
    rho = lattice(spacing, width)
    near = 35.0 / (32.0 * np.pi * width**3) + normal_field(rho, 0.0, width).sum()
    near += normal_field(np.concatenate(([0.0], rho)), 2.0 * h, width).sum()
    result = layers.sample(place)[0][0, 2] - H0 + m * near

    far = 60.0 * spacing
    rho = np.concatenate(([0.0], lattice(spacing, far)))
    d2 = rho**2 + 4.0 * h**2
    image = ((12.0 * h**2 / d2 - 1.0) / (4.0 * np.pi * d2**1.5)).sum() - 0.5 / (area * far)  # the sheet's rest
    truth = m * (1.0 / (area * GAP) - 9.0336 / (4.0 * np.pi * spacing**3) + image)
    assert result == pytest.approx(truth, rel=2e-3)


def test_the_gradient_is_that_of_the_field():
    layers = layers_between()
    random = np.random.default_rng(3)
    place, volume = sheets(500)
    low = place[:, 2] < 0.5 * GAP
    settle(layers, place, lambda H: random.uniform(0.5, 1.0) * np.minimum(2.0 * H, 90e3) * low * volume, 3, 1.0)
    points = place[40:-40:37]
    result = layers.sample(points)[1]
    step = 1e-7
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = (layers.sample(points + shift)[0] - layers.sample(points - shift)[0]) / (2.0 * step)
        assert result[:, :, axis] == pytest.approx(slope, abs=1e-5 * np.abs(result).max())


def test_without_a_field_there_is_none():
    layers = LayeredField(0.0, GAP, AREA, WIDTH)
    place, _ = sheets(10)
    assert layers.follow(place, np.zeros((10, 3))) == 0.0
    assert not layers.sample(place)[0].any()


@pytest.mark.parametrize("width", [0.0, 1.01 * GAP])
def test_a_width_that_folds_twice_is_refused(width):
    with pytest.raises(ValueError, match="at most the gap"):
        layers_between(width)
