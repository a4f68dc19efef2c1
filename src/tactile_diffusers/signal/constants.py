"""The numbers that the whole package agrees on. Each constant is written here and nowhere else."""

#: Band of a texture in Hz (paper section 2.1: below is finger motion, above is not felt).
BAND_HZ = (20.0, 1000.0)
#: Rate of delivered textures and of the recorded force, Hz (paper section 2.1).
DEVICE_RATE = 10_000
#: Samples of one segment at ``DEVICE_RATE``: 1.6384 s (paper section 2.1).
SEGMENT_SAMPLES = 2**14
SEGMENT_SECONDS = SEGMENT_SAMPLES / DEVICE_RATE
#: Shortest recording that is taken, s: its filter leaves 0.1 s at each end unused, two periods of the band's low edge.
LEAST_RECORDING = 0.25
#: Rate at which the default decoder runs, Hz: nothing above 1 kHz is felt.
WORKING_RATE = 2500
#: Normal force at which textures are recorded, N: the middle of the paper's limits (section 2.1).
REFERENCE_FORCE = 0.5
#: Exponents of a texture's amplitude on normal force and speed: medians over the 100 surfaces of HaTT (Culbertson
#: et al. 2014, with a rigid stylus; no such set of bare fingers is known to us).
FORCE_EXPONENT, SPEED_EXPONENT = 0.03, 0.41
#: Below this speed (mm/s) powers of speed, which are meant for sliding, are held.
SLOWEST_SLIDING = 10.0
#: Tangential stiffness of a sliding finger, N/mm, at the reference speed, and its rise per mm/s of speed (arXiv
#: 2505.11162: 4.04 N/m per mm/s; its intercept is not known to us, 0.75 is the middle of the virtual surfaces' range).
CONTACT_STIFFNESS, STIFFNESS_PER_SPEED = 0.75, 4.04e-3
#: Exponent of friction on normal force where stick-slip is, on smooth surfaces: the area of a Hertzian contact. So fall
#: friction coefficients of fingers on smooth surfaces with load, by about -1/3.
ADHESION_EXPONENT = 2 / 3
#: Exponents of how readily a contact sticks on normal force and speed: pressing keeps it sticking, and fast sliding is
#: steady (Rabinowicz 1958); the sizes are the virtual surfaces', an assumption.
STICKING_FORCE_EXPONENT, STICKING_SPEED_EXPONENT = 0.2, -0.2
#: No fingertip presses with more, N.
LARGEST_FORCE_N = 100.0
#: Perceptual axes in the order of every rating vector; positive = rougher, bumpier, more slippery.
RATING_AXES = ("roughness", "bumpiness", "slipperiness")
#: Attribute `source` of recordings of `tactile_diffusers.virtual`.
VIRTUAL_SOURCE = "virtual surfaces"
