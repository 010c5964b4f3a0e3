"""Status codes that cross module borders and the wire; numbers are stable, new ones are added at the end."""

OK = 0
BAD_CRC = -1  # a frame whose checksum does not fit its bytes
BAD_LENGTH = -2  # shorter or longer than its type allows
BAD_TYPE = -3  # a message type this firmware does not know
BAD_VALUE = -4  # a field outside its range
BAD_STATE = -5  # right message, wrong moment (data before begin, confirm before verify)
BUSY = -6  # the probe is in the middle of something that excludes this
NO_MODEL = -7  # no confirmed model in either slot
NO_LUMP = -8  # the stroke shows no lump
TOO_SHORT = -9  # the stroke did not cover what the features need
FORCE_RANGE = -10  # mean force outside the model's range
NO_FIT = -11  # the Gaussian fit found nothing to fit
BAD_MAGIC = -12  # not a model image
BAD_VERSION = -13  # a format, or feature list, that this firmware does not know
BAD_SIGNATURE = -14  # the signature does not verify with this probe's public key
BAD_PROBE = -15  # made for another probe's geometry or sensor
MISSING_FEATURE = -16  # the model needs a feature that this build does not compute
TOO_OLD = -17  # security counter below the one already seen, and not signed as a rollback
SELF_TEST = -18  # the image's own vectors did not give the stated integers
NO_SPACE = -19  # the image does not fit into a slot, or the store is full
STORE_ERROR = -20  # the store could not be read or written
OVERFLOW = -21  # an intermediate left +-2^30
NOT_SUPPORTED = -22  # this build leaves the function out (for example flashing without SHA-256)
FULL = -23  # a buffer or queue is full; nothing was stored
NOT_KNOWN = -24  # a stream or stroke that the probe does not know, or no longer
IN_CONTACT = -25  # zeroing while something presses on the cells
BAD_CALIBRATION = -26  # a quarter of the cells or more do not read what the calibration needs
REPAIRED = -27  # a stored copy was damaged; the other one was whole
ROTTEN = -28  # what was stored is damaged beyond repair
BAD_MODEL = -29  # a model image with a number that no model can have
TRIAL_HUNG = -30  # the probe restarted while it tried a model
NO_KEY = -31  # the probe was given no public key: there is no model that it would believe
UNEVEN = -32  # the hand's force changed so much that frames cannot be moved to one force
TOO_SPARSE = -33  # the frames of a stroke lie too far apart
NO_PRESS = -34  # a reference was asked for, and nobody pressed
BAD_PRESS = -35  # too light, too quick or never let up: its frames do not tell how depth goes with force
MOVED = -36  # along the skin, where it should have been pressed alone
NO_STAGE = -37  # the model takes no reference: it is for one tissue, which it was told
SATURATED = -38  # cells over the lump read full scale: how high the bump is cannot be known

# One clear sentence for each, for the host's errors and the probe's log; kept beside the numbers.
TEXT = {
    OK: "ok",
    BAD_CRC: "the checksum does not fit the bytes",
    BAD_LENGTH: "the message has a wrong length",
    BAD_TYPE: "the probe does not know this message",
    BAD_VALUE: "a field is outside its range",
    BAD_STATE: "the probe is not in the state for this message",
    BUSY: "the probe is busy",
    NO_MODEL: "the probe holds no confirmed model",
    NO_LUMP: "no lump found",
    TOO_SHORT: "the stroke is too short: stroke on, 24 mm to either side of the lump",
    FORCE_RANGE: "the mean force is outside the model's range",
    NO_FIT: "the tactile map has no bump to fit",
    BAD_MAGIC: "this is not a model image",
    BAD_VERSION: "the probe does not know this version",
    BAD_SIGNATURE: "the signature does not fit the probe's key",
    BAD_PROBE: "the model was made for another probe",
    MISSING_FEATURE: "the model needs a feature that this firmware does not compute",
    TOO_OLD: "the model is older than one the probe has already accepted",
    SELF_TEST: "the model failed its self-test",
    NO_SPACE: "there is no room for it on the probe",
    STORE_ERROR: "the probe's store could not be read or written",
    OVERFLOW: "a number left the integer range",
    NOT_SUPPORTED: "this firmware is built without that function",
    FULL: "the buffer is full",
    NOT_KNOWN: "the probe does not know this stream or stroke, or no longer",
    IN_CONTACT: "the probe is in contact: lift it off, or raise contact_threshold above the cells' zero",
    BAD_CALIBRATION: "too many cells do not read what the calibration needs: check pressure and cable",
    REPAIRED: "what the probe had stored was damaged and could be repaired",
    ROTTEN: "what the probe had stored is damaged beyond repair",
    BAD_MODEL: "the model image holds a number that no model can have",
    TRIAL_HUNG: "the probe restarted while it tried a model; the one it had stays",
    NO_KEY: "no public key: the probe holds no key.pub, so it takes no model",
    UNEVEN: "the force changed by more than 30 % to either side: press evenly",
    NO_PRESS: "nobody pressed: press the probe straight down beside the lump, then lift it",
    BAD_PRESS: "the press was too light or quick: press for a second, then hold the probe in the air for one",
    MOVED: "the probe moved along the skin: press it straight down, then lift it",
    NO_STAGE: "the model takes no reference press: it was told its tissue",
    TOO_SPARSE: "frames lie more than 4.5 mm apart: stroke more slowly",
    SATURATED: "cells read full scale: press more lightly",
}
