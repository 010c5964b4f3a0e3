"""A recording as tables: how well do repeated strokes agree, and is the hand steady?

    python recording_in_pandas.py [RECORDING]

The recording is one of `palpate stream --record` or of talk_to_a_probe.py, which writes the default one.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

from palpate.recording.convert import convert

recording = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples/visit.mcap")
table = recording.with_suffix(".parquet")

written = convert(recording, table, overwrite=True)
frames = pd.read_parquet(table)
estimates = pd.read_parquet(written.files[1])
print(f"{len(frames)} frames, {len(estimates)} strokes, {written.lost} frames lost")

# Frames of one stroke: those between its first and last sequence number, while the probe touches.
strokes = pd.IntervalIndex.from_arrays(estimates["first_seq"], estimates["last_seq"], closed="both")
frames["stroke"] = strokes.get_indexer(frames["seq"])
felt = frames[(frames["stroke"] >= 0) & (frames["displacement_mm"] > 0)].copy()

# The force per metre: mean pressure of a sensor row times its pitch, summed over the 16 rows.
pressures = np.stack(felt["pressure_kPa"]).reshape(-1, 16, 26)
felt["F_N_per_m"] = pressures.mean(axis=2).sum(axis=1) * 1.5
hand = felt.groupby("stroke").agg(
    frames=("seq", "size"),
    F_N_per_m=("F_N_per_m", "mean"),
    F_spread_percent=("F_N_per_m", lambda F: 100 * F.std() / F.mean()),
    deepest_mm=("displacement_mm", "max"),
    shallowest_mm=("displacement_mm", "min"),
    speed_mm_per_s=("position_mm", lambda x: np.abs(np.ptp(x))),
)
hand["speed_mm_per_s"] /= felt.groupby("stroke")["time_us"].agg(np.ptp) / 1e6
print(hand.round(2).to_string())

# Repeatability: the spread of the same lump's diameter over strokes, beside the interval that the probe gave.
values = estimates[["d_mm", "t_mm", "h", "F_N_per_m"]]
print(pd.DataFrame({"mean": values.mean(), "spread": values.std()}).round(3).to_string())
half = (estimates["d_mm_high"] - estimates["d_mm_low"]).mean() / 2
print(f"d_mm: spread of {values['d_mm'].std():.2f} mm over strokes, interval of +-{half:.2f} mm on each")
