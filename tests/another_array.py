"""The whole chain for an array that is not the reference's: python -m tests.another_array RUNTIME DIRECTORY

PALPATE_ARRAY names the array; a test starts this once for each, for it holds for a whole process. Strokes are
the committed ones of tests/firmware_py, felt by that array. Prints what was found as JSON.
"""

import palpate  # noqa: F401  # the array is chosen before the firmware is imported

# isort: split
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from firmware_py import calib, evaluator, forcemap, outputs, status
from palpate.firmware_twin.replay_core import Replay
from palpate.learn.conformal import LEVEL, Widths, conformal_quantile, fit_sigma
from palpate.learn.domain import fit_domain
from palpate.learn.probe_model import fit_polynomial, spec_of, to_link, training_hash
from palpate.learn.ridge import all_terms
from palpate.link import flash
from palpate.link.probe import Probe
from palpate.model_export.errors import ImageError
from palpate.model_export.exporter import export
from palpate.model_export.image_builder import inspect
from palpate.model_export.integers import force_map
from palpate.model_export.signing import keys
from palpate.recording import channels
from palpate.sim.probe.emulated import EmulatedProbe
from palpate.sim.probe.sensors import LEVELS, SensorModel, StrokeField
from palpate.sim.probe.stroke_field import on_the_array
from palpate.wire.events import Estimate, Frame
from palpate.wire.scale import NOMINAL
from tests.firmware_py import checked_int, pipeline_features
from tests.firmware_py.strokes import read_strokes
from tests.waiting import PATIENCE_S

FEATURES = ("ln_force", "asinh_amp", "ln_stdev", "ln_base", "ln_d_far", "dip_6_10")
DRAWS, FRAMES = 4, 50
LIFTED = 3  # frames in the air that the emulated probe puts before a stroke
REFERENCE = "16x26 at 1500 um"


def learned_force_map(pairs):
    """As for the reference, from the same strokes."""
    images, depths = ([] for _ in range(2))
    for side in (0, 1):
        images.append(np.concatenate([on_the_array(pair[side]) for pair in pairs]))
        depths.append(np.concatenate([pair[side].displacement_mm for pair in pairs]))
    return force_map.fit(images[0], depths[0], images[1], depths[1])


def worst_against_float64(fields, learned, noise):
    """Largest difference of a feature between the integers, every one watched, and float64."""
    watched, _ = checked_int.load()
    pipeline = watched.pipeline.Pipeline(calib.Calibration())
    worst = {}
    for seed, field in enumerate(fields[:3]):
        model = SensorModel(field, noise, seed)
        frames = model.stroke(FRAMES)
        pipeline.reset()
        pipeline.calibration = model.calibration()
        for k, packed in enumerate(frames.packed):
            pipeline.add_frame(packed, int(frames.positions_um[k]), int(frames.displacements_um[k]))
        assert pipeline.finish(learned and forcemap.load(force_map.blob(learned))) == status.OK
        true = pipeline_features.compute(
            frames.counts,
            frames.positions_um / 1e3,
            frames.displacements_um / 1e3,
            model.calibration(),
            learned,
        )
        for k, (name, value) in enumerate(true.features.items()):
            worst[name] = max(worst.get(name, 0.0), abs(pipeline.features[k] / 2**24 - value))
    return worst


def trained(fields, learned):
    """A linear model of what the probe's own integers say of the strokes."""
    replay = Replay(force_map.blob(learned), plain=True)
    X, Y, group = [], [], []
    for k, field in enumerate(fields):
        for draw in range(DRAWS):
            model = SensorModel(field, LEVELS["good"], 100 * k + draw)
            frames = model.stroke(FRAMES)
            assert replay.stream(frames, model.calibration()) == status.OK
            found = replay.results()["features"]
            X.append([found[name] for name in FEATURES])
            Y.append(list(frames.truth.outputs().values())[: outputs.E_FAT])
            group.append(k)
    X, Y, group = np.array(X), to_link(np.array(Y)), np.array(group)
    room = 0.5 * np.ptp(Y, axis=0)
    terms = all_terms(len(FEATURES), 1)
    model = fit_polynomial(FEATURES, X, Y, group, terms, Y.min(0) - room, Y.max(0) + room)
    predicted = model.predict(X)
    shape, size = fit_sigma(model.standard(X), predicted, Y - predicted, group)
    unit = Widths(shape, size, np.ones((Y.shape[1], 2)), LEVEL)
    scores = np.abs(Y - predicted) / unit.sigma(model.standard(X), predicted)
    quantiles = np.array([[conformal_quantile(score, LEVEL)] * 2 for score in scores.T])
    force = np.exp(Y[:, 0])
    return spec_of(
        "field",
        model,
        replace(unit, quantiles=quantiles),
        fit_domain(X, model.standard(X)),
        (0.8 * float(force.min()), 1.2 * float(force.max())),
        {"hash": training_hash(X, Y), "n": len(X)},
        force_map=learned.as_dict(),
        fat_kPa=fields[0].low.case.fat_kPa,
    )


def answer(image, public, runtime, stroke, calibration):
    """Flash the image and stroke once; the estimate, and what the probe says of itself."""
    emulated = EmulatedProbe(runtime, [stroke], public_key=public, calibration=calibration)
    with emulated, Probe.open(emulated.port) as probe:
        flash.flash(probe, image)
        probe.start_stream(strokes=1)
        found = next(e for e in probe.events(PATIENCE_S) if isinstance(e, Estimate))
        return found, probe.identity


def means(field):
    """A frame's mean pressure in kPa, as a recording has it and as it is."""
    frame = Frame(
        0, 0, 0, 0, 0, SensorModel(field, LEVELS["good"], 1).stroke(FRAMES).packed[FRAMES // 2], 0, NOMINAL
    )
    motion = dict(channels.decoded(frame))[channels.MOTION]
    return json.loads(motion)["pressure_mean_kPa"], float(frame.pressure_kPa.mean())


def main(runtime, directory):
    pairs = read_strokes()
    fields = [StrokeField(*pair) for pair in pairs[:-1]]
    said = {"means": means(fields[0])}
    learned = learned_force_map(pairs)
    said["worst"] = worst_against_float64(fields, learned, LEVELS["typical"])
    if runtime != "none":
        spec = trained(fields, learned)
        key = directory / "key"
        keys.generate(key)
        image, _ = export(spec, key)
        public = (key / "public.key").read_bytes()
        model = SensorModel(fields[1], LEVELS["good"], 7)
        stroke = model.stroke(FRAMES)
        found, identity = answer(image, public, runtime, stroke, model.calibration())
        replay = Replay(force_map.blob(learned), plain=True)
        first = found.first_seq - LIFTED  # the probe takes a stroke for one after some travel
        own = slice(first, first + found.frames)
        replay.stroke(
            stroke.packed[own], stroke.positions_um[own], stroke.displacements_um[own], model.calibration()
        )
        out = np.zeros(evaluator.OUT_SIZE, int).tolist()
        inspect(image).model.evaluate(replay.pipeline.features, out)
        said |= {
            "array": identity.array,
            "image_for": flash.made_for(image),
            "estimate": found.as_dict(),
            "replayed": list(found.values) == out[: outputs.VALUES],
            "truth": stroke.truth.outputs(),
            "refused": refusals(spec, key, public, runtime),
        }
    print(json.dumps(said))


def refusals(spec, key, public, runtime):
    """What host and probe say to a sound image for the reference's array."""
    other, _ = export(replace(spec, probe=REFERENCE), key)
    said = {}
    try:
        inspect(other, public)
    except ImageError as error:
        said["host"] = str(error)
    emulated = EmulatedProbe(runtime, public_key=public)
    with emulated, Probe.open(emulated.port) as probe:
        flash.check_image = lambda image: ""  # a host that does not look
        try:
            flash.flash(probe, other)
        except Exception as error:
            said["probe"] = str(error)
            said["status"] = getattr(error, "status", None)
    return said


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
