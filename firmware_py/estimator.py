"""From a stroke's frames to its estimate: calibration, pipeline and the live model, and their commands."""

from array import array

from firmware_py import calib, calibrate, evaluator, features, forcemap, messages, pipeline, record, status

_VALUES = 3 * evaluator.OUTPUTS
_FIRST_MM = -(pipeline.HALF_UM // 1000)


def _never():
    return False


def _pipeline(calibration, columns):
    if columns is None:
        return pipeline.Pipeline(calibration)
    from firmware_py import rowpipeline

    return rowpipeline.RowPipeline(calibration, columns[0], columns[1])


class Estimator:
    """What the probe knows: its calibration and its models.

    Parameters
    store: see firmware_py/store.py
    flash: flash.Flash, the model's slots and commands; None for a build that cannot be flashed
    columns: first, last: a small build, which works on the columns first..last-1 (rowpipeline.RowPipeline)
    """

    def __init__(self, store, flash=None, columns=None):
        self.calibration = calib.Calibration()
        self._record = record.Record(store, "cal")
        stored = self._record.load()
        self.calibration_status = self.calibration.load(stored) if stored else status.OK
        self._fixed = columns is not None
        self.pipeline = _pipeline(self.calibration, columns)
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
        blob = self.model.force_map if self.model else None
        self._force_map = forcemap.load(blob) if blob else None

    def model_id(self):
        """The live model's 8 bytes, or zeros."""
        return self.model.model_id if self.model else bytes(8)

    def describe(self):
        """For identify: capabilities, version of the features, the model's status and id."""
        can = messages.CAN_CALIBRATE | (messages.CAN_FLASH if self.flash else 0)
        if self._fixed:
            can |= messages.FIXED_COLUMNS
        return can, features.FEATURES_VERSION, self.model_status, self.model_id()

    def zero_counts(self):
        """Sum of all cells' zeros, in counts."""
        total = 0
        for offset in self.calibration.offset:
            total += offset
        return total >> 3

    # ---- a stroke

    def begin(self):
        """A stroke starts."""
        self.pipeline.reset()

    def add_frame(self, counts, position_um, displacement_um):
        """Add one frame of the stroke. Allocates nothing."""
        return self.pipeline.add_frame(counts, position_um, displacement_um)

    def finish(self, results, result, place):
        """Work out the stroke and put its map, features and estimate into `result`.

        place: frames, first_seq, last_seq, overrun, time_us of the stroke.
        """
        p = self.pipeline
        code = p.finish(self._force_map)
        fit = p.fit
        results.put(
            result,
            0,
            (result.stroke, code, p.span[0], p.span[1], pipeline.POINTS, _FIRST_MM, p.place_um)
            + (self.calibration.count_mpa, fit[0], fit[1], fit[2], fit[3]),
            p.map,
        )
        results.put(result, 1, (result.stroke, code, features.FEATURES_VERSION), p.features)
        out = self._out
        head = (messages.FLAG_INVALID, 0, 0)
        values = out[:0]
        if self.model is None:
            code = self.model_status
        elif code == status.OK or code == status.NO_FIT:
            code = self.model.evaluate(p.features, out)
            head = (out[evaluator.FLAGS], out[evaluator.LEVEL], min(out[evaluator.DISTANCE], 0xFFFF))
            values = out[:_VALUES]
        results.put(result, 2, (result.stroke, code) + head + (self.model_id(),) + place, values)

    # ---- commands

    def add_handlers(self, table, begin_measuring):
        """Add this part's commands to the probe's table.

        begin_measuring: starts the frames for `measure`; returns False if that cannot be now.
        """
        self._begin_measuring = begin_measuring
        table[messages.TYPE["calibrate"]] = self._calibrate
        table[messages.TYPE["read_back"]] = self._read_back
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
        fresh = calib.Calibration()
        fresh.load(self.calibration.to_bytes())
        self._calibrator = calibrate.Calibrator(fresh, kind, frames, pressure_pa)
        return None

    def measure(self, counts):
        """Take a frame for the calibration that is under way.

        The command's answer when it is done, or None.
        """
        c = self._calibrator
        if c is None or not c.take(counts):
            return None
        self._calibrator = None
        code = c.finish()
        if code != status.OK:
            return code, (), b""
        return self._keep(c.calibration, c.kind, c.taken, c.noise_millicounts())

    def _keep(self, calibration, kind, frames, noise):
        blob = calibration.to_bytes()
        code = self._record.save(blob)
        if code != status.OK:
            return code, (), b""
        self.calibration.load(blob)
        return status.OK, (kind, frames, calibrate.dead_cells(calibration), noise), b""

    def _read_back(self, fields):
        what, offset = fields
        if what == messages.READ_CALIBRATION:
            blob = self.calibration.to_bytes()
            piece = blob[offset : offset + messages.READ_PIECE]
            return status.OK, (what, offset, len(blob)), piece
        if what == messages.READ_MODEL and self.flash:
            size, piece = self.flash.read_live(offset, messages.READ_PIECE)
            if size < 0:
                return status.NO_MODEL, (), b""
            return status.OK, (what, offset, size), piece
        return status.BAD_VALUE, (), b""
