import numpy as np

from scene4d.perception._planes import fill_planes


def test_channels_lie_apart_scaled_and_shifted():
    rng = np.random.default_rng(0)
    image = rng.integers(0, 256, (7, 5, 3)).astype(np.uint8)
    gain, offset = np.array([0.5, 2.0, 1.5]), np.array([1.0, 0.0, 3.0])
    for swapped in (False, True):
        out = np.empty((3, 7, 5), np.float32)
        fill_planes(out, image, gain, offset, swapped=swapped)
        seen = image[..., ::-1] if swapped else image
        assert np.allclose(out, (seen * gain - offset).transpose(2, 0, 1), atol=1e-4)
        fill_planes(out, image, 1 / 255, swapped=swapped)
        assert np.allclose(out, seen.transpose(2, 0, 1) / 255, atol=1e-6)
