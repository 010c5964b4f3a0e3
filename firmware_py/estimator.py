"""From a stroke's frames to its estimate: calibration, pipeline and the live model, and their commands."""

from array import array

from firmware_py import (
    calib,
    evaluator,
    features,
    memory,
    messages,
    outputs,
    pipeline,
    safe_record,
    status,
)

_VALUES = outputs.VALUES
_FIRST_MM = -(pipeline.HALF_UM // 1000)


def _never():
    return False


def answer(code, model, found, out):
    """What the probe says of a stroke, and a replay must: status, flags, level, distance (permille), values.

    code: the pipeline's status, or why there is no model; model: model_image.Model, or None; found: the
    features; out: working space of evaluator.OUT_SIZE numbers.
    """
    if model is None or (code != status.OK and code != status.NO_FIT):
        return code, outputs.INVALID, 0, 0, out[:0]
    code = model.evaluate(found, out)
    distance = min(out[evaluator.DISTANCE], 0xFFFF)
    return code, out[evaluator.FLAGS], out[evaluator.LEVEL], distance, out[:_VALUES]


class Estimator:
    """Calibration and models of the probe.

    Parameters
    store: see firmware_py/store.py
    flash: flash.Flash, the model's slots and commands; None for a build that cannot be flashed
    """

    def __init__(self, store, flash=None):
        self.calibration = calib.Calibration()
        self._record = safe_record.Record(store, "cal")
        stored = self._record.restore()
        # OK, REPAIRED, or why the cells' nominal values stand in for what was calibrated
        self.calibration_status = self._record.state
        if stored:
            code = self.calibration.load(stored)
            if code != status.OK:
                self.calibration_status = code
        memory.tidy()
        self.pipeline = pipeline.Pipeline(self.calibration, once=True)
        self.flash = flash
        self.model = None
        self.model_status = status.NO_MODEL
        self._force_map = None
        self._out = array("i", bytes(4 * evaluator.OUT_SIZE))
        self._calibrator = None
        self._begin_measuring = _never
        if flash:
            self.take_model()

    def take_model(self):
        """Use the live model from here on."""
        self.model, self.model_status = self.flash.live()
        self._force_map = self.model.force_map if self.model else None

    def model_id(self):
        """The live model's 8 bytes, or zeros."""
        return self.model.model_id if self.model else bytes(8)

    def damage(self):
        """What was found damaged of calibration and models, as bits messages.DAMAGED_..."""
        bits = 0
        found = self.flash.slots.health if self.flash else status.OK
        if self.calibration_lost():
            bits |= messages.DAMAGED_CALIBRATION
        if found == status.ROTTEN:
            bits |= messages.DAMAGED_MODEL
        if found == status.TRIAL_HUNG:
            bits |= messages.DAMAGE_TRIAL_HUNG
        if status.REPAIRED in (found, self.calibration_status):
            bits |= messages.DAMAGE_REPAIRED
        return bits

    def describe(self):
        """For identify: capabilities, version of the features, the model's status and id."""
        can = messages.CAN_CALIBRATE | (messages.CAN_FLASH if self.flash else 0)
        if self.model and self.model.first and self.model.first.refers:
            can |= messages.TAKES_REFERENCE | (messages.HOLDS_REFERENCE if self.model.first.held else 0)
        return can, features.FEATURES_VERSION, self.model_status, self.model_id()

    def calibration_lost(self):
        """True where a calibration was kept and cannot be read any more."""
        return self.calibration_status not in (status.OK, status.REPAIRED)

    def health(self):
        """OK, or the worst that was found in the store at the start (status.py)."""
        found = self.flash.slots.health if self.flash else status.OK
        if self.calibration_lost():
            return self.calibration_status
        return found if found != status.OK else self.calibration_status

    def zero_counts(self):
        """Sum of all cells' zeros, in counts."""
        total = 0
        for offset in self.calibration.offset:
            total += offset
        return total >> 3

    # ---- a stroke

    def begin_press(self):
        """The probe has touched the skin."""
        self.pipeline.begin_press()

    def add_press(self, counts, displacement_um):
        """Add one frame of the press, until the stroke starts. Allocates nothing."""
        return self.pipeline.add_press(counts, displacement_um)

    def begin(self):
        """A stroke starts."""
        self.pipeline.reset()

    def add_frame(self, counts, position_um, displacement_um):
        """Add one frame of the stroke. Allocates nothing."""
        return self.pipeline.add_frame(counts, position_um, displacement_um)

    def finish(self, results, place, damage):
        """Evaluate the stroke: put its map, features and estimate into `results`.

        place: frames, first_seq, last_seq, overrun, time_us of the stroke; damage: as in identify.
        """
        p = self.pipeline
        code = p.finish(self._force_map)
        fit = p.fit
        results.put(
            0,
            (code, p.span[0], p.span[1], pipeline.POINTS, _FIRST_MM, p.place_um)
            + (self.calibration.count_mpa, fit[0], fit[1], fit[2], fit[3]),
            p.map,
        )
        results.put(1, (code, features.FEATURES_VERSION), p.features)
        if self.model is None:
            code = self.model_status
        code, flags, level, distance, values = answer(code, self.model, p.features, self._out)
        results.put(2, (code, flags, damage, level, distance, self.model_id()) + place, values)

    # ---- commands

    def add_handlers(self, table, begin_measuring):
        """Add this part's commands to the probe's table.

        begin_measuring: starts the frames for `measure`; returns False if that cannot be now.
        """
        self._begin_measuring = begin_measuring
        table[messages.TYPE["calibrate"]] = self._calibrate
        table[messages.TYPE["read_back"]] = self._read_back
        table[messages.TYPE["reference"]] = self._reference
        if self.flash:
            self.flash.add_handlers(table, self.take_model)

    def _calibrate(self, fields):
        kind, frames, pressure_pa = fields
        if kind > messages.CALIBRATE_CLEAR or pressure_pa < 0 or pressure_pa > 1000000:
            return status.BAD_VALUE, (), b""
        if kind == messages.CALIBRATE_CLEAR:
            return self._keep(calib.Calibration(), kind, 0, 0)
        if not frames:
            return status.BAD_VALUE, (), b""
        if not self._begin_measuring():
            return status.BUSY, (), b""
        from firmware_py import calibrate  # a board has no room for it at other times

        fresh = calib.Calibration()
        fresh.load(self.calibration.to_bytes())
        self._calibrator = calibrate.Calibrator(fresh, kind, frames, pressure_pa)
        return None

    def _reference(self, fields):
        """The reference press of a visit (reference.py): until another, or the power goes."""
        from firmware_py import reference

        first = self.model.first if self.model else None
        kind = fields[0]
        answer = status.BAD_VALUE, (), b""
        if kind == messages.REFERENCE_TAKE:
            if not reference.takes(self.model):
                answer = status.NO_STAGE, (), b""
            elif self._begin_measuring():
                self._calibrator = reference.Taking(self.pipeline, first)
                return None
            else:
                answer = status.BUSY, (), b""
        elif kind <= messages.REFERENCE_TELL:
            if first and kind == messages.REFERENCE_CLEAR:
                first.held = False
            answer = reference.answer(kind, first)
        memory.forget(memory.CALIBRATING)
        return answer

    def measure(self, counts, in_contact, position_um=0, displacement_um=0):
        """Take a frame for the calibration, or the reference, that is under way; the zero is of the air only.

        The command's answer when it is done, or None.
        """
        c = self._calibrator
        if c is None:
            return None
        if hasattr(c, "take_reference"):
            return self._press(c, c.take_reference(counts, in_contact, position_um, displacement_um))
        if in_contact and c.kind == messages.CALIBRATE_ZERO:
            self._calibrator = None
            code = status.IN_CONTACT
        elif not c.take(counts):
            return None
        else:
            self._calibrator = None
            code = c.finish()
        memory.forget(memory.CALIBRATING)
        if code != status.OK:
            return code, (), b""
        return self._keep(c.calibration, c.kind, c.taken, c.noise_millicounts())

    def _press(self, taking, code):
        """What to answer when a reference press is at this status; None while it is on."""
        if code is None:
            return None
        self._calibrator = None
        answer = taking.answer(code)
        memory.forget(memory.CALIBRATING)
        return answer

    def _keep(self, calibration, kind, frames, noise):
        blob = calibration.to_bytes()
        code = self._record.save(blob)
        if code != status.OK:
            return code, (), b""
        self.calibration.load(blob)
        self.calibration_status = status.OK
        if self.model and self.model.first:
            self.model.first.held = False  # it was felt with other zeros and gains
        return status.OK, (kind, frames, calibration.dead_cells(), noise), b""

    def _read_back(self, fields):
        what, offset = fields
        if what == messages.READ_CALIBRATION:
            blob = self.calibration.to_bytes()
            offset = min(offset, len(blob))
            piece = blob[offset : offset + messages.READ_PIECE]
            return status.OK, (what, offset, len(blob)), piece
        if what == messages.READ_MODEL and self.flash:
            size, piece = self.flash.read_live(offset, messages.READ_PIECE)
            if size < 0:
                return status.NO_MODEL, (), b""
            return status.OK, (what, offset, size), piece
        return status.BAD_VALUE, (), b""
