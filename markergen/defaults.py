"""Defaults that stand in several places: in options and their help, in signatures, and in what counts on them."""
# tests: tests/studio/test_look.py tests/api/test_validate.py

PRINT_SIGMA = 1e-4
"""Standard deviation in m of a printed dot's position along each axis, unless another one is given."""

PRINT_SIGMA_TEXT = f"{1e3 * PRINT_SIGMA:g}mm"
"""`PRINT_SIGMA` as options show it."""

MEASURED_SIGMA = 1e-5
"""The same in m once twenty photographs have measured the print: the simulated prints of docs/calibrate.md then err by
0.021 deg, as ones good to 9 um would, and by 0.026 where the camera is calibrated in the same go."""

BLUR_PX = 0.7
"""Standard deviation in px of the Gaussian blur of an image in focus, at which the sizes that detection wants were
measured."""

NOISE_GREY = 2.0
"""Standard deviation of the noise of a grey level, before rounding."""

DARK, LIGHT = 30, 225
"""Grey levels of ink and of its ground."""

NOISE_PX = 0.2
"""Standard deviation in px of the noise on image coordinates in trials."""

RUNS = 200
"""Noisy trials of a pose: over 400 poses they give RMS errors to 0.3 %, over the 80 of a tilt to 0.6 % (1 / sqrt(2 N)
of Gaussian ones); 1000, as in the paper, take 110 s of a processor instead of 30."""

VIEWS = 100
"""Synthetic views of a validation."""

COMPARED_VIEWS = 200
"""Synthetic views of a comparison, of each contestant."""

RULER_SIGMA = 2e-4
"""Standard deviation in m of a length measured with a ruler."""
