"""What the features are called, in the order of their ids (features.py); the board itself needs no names."""

NAMES = (
    "ln_base",  # ln(Base / kPa)
    "ln_amp",  # ln(Amp / kPa), Amp at least Base / 512
    "ln_stdev",  # ln(Stdev / mm)
    "inv_curvature",  # pressure 8 mm off the middle over that at the middle, 28 mm from the lump
    "ln_d28",  # ln(D / mm), 26..30 mm from the lump
    "ln_d0",  # ln(D / mm), within 2 mm
    "ln_force",  # ln(F / (N/m)): the image's sum, mean of the stroke, all columns
    "asinh_amp",  # asinh(100 Amp / Base)
    "ln_d_far",  # ln(D / mm), 24..33 mm
    "dip_6_10",  # 1 - D / D far, 6..10 mm
    "ln_centre_share",  # ln(middle pressure / image mean), far
    "ln_misfit",  # ln(rms residual / Base + 1e-4)
    "asinh_rise",  # asinh(32 (middle pressure near / far - 1))
    "trace_7_9",  # middle pressure 7..9 mm / far - 1
    "trace_12_16",  # middle pressure 12..16 mm / far - 1
    "dip_0_2",
    "dip_3_5",
    "dip_12_16",
    "dip_17_22",
    "trace_3_5",
    "trace_17_22",
    "tilt_3_5",  # centre of pressure, mm, positive away from the lump, 3..5 mm
    "tilt_6_9",
    "tilt_10_14",
    "ln_width_far",  # ln(rms half width of the image / mm), far
    "ln_width_near",  # the same near the lump, less ln_width_far
    "edge_far",  # mean of the two outermost sensors / image mean, far
    "ln_peak",  # ln(greatest pressure of the near image / image mean)
    "tilt_15_19",
    "tilt_20_24",
    "press_d_quarter",  # of the press before the stroke (press.py): ln(D / mm) at a quarter of its force
    "press_d_half",
    "press_d_full",
    "press_width_quarter",  # ln(rms half width of the image / mm)
    "press_width_half",
    "press_width_full",
    "press_share_quarter",  # ln(middle pressure / image mean)
    "press_share_half",
    "press_share_full",
    "base_share",  # ln_base - ln_force: with moduli and forces all times the same it stays
    "press_outer_quarter",  # middle pressure of the outer columns / image mean
    "press_outer_half",
    "press_outer_full",
    "ln_bump",  # ln(rms of the next eleven before they are divided by it / mm): how much the lump changes
    "pull_3_5",  # tilt 3..5 mm / bump
    "pull_6_9",
    "pull_10_14",
    "pull_15_19",
    "pull_20_24",
    "pull_25_33",
    "lift_0_2",  # 4 mm times trace 0..2 mm / bump
    "lift_3_5",
    "lift_7_9",
    "lift_12_16",
    "lift_17_22",
    "across_3_5",  # how much of the bump the columns 3..5 mm from the best see / those within 2 mm
    "across_6_9",
    "across_10_15",
)
