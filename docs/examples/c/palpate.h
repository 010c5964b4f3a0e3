/* The wire of a Palpate probe, made from firmware_py/tables.py by
   python -m tests.firmware_py.protocol_files; docs/protocol.md explains it.

   palpate_get_NAME takes a body (type byte first, without CRC) apart: 1, or 0 if it is too short.
   palpate_put_NAME writes a command's body (57 bytes at most) and returns its length.
   A message's `tail` points into the body. */
#ifndef PALPATE_H
#define PALPATE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

static inline uint32_t palpate_u32(const uint8_t *p) {
    return p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static inline int32_t palpate_i32(const uint8_t *p) { return (int32_t)palpate_u32(p); }
static inline uint16_t palpate_u16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }
static inline void palpate_put(uint8_t *p, uint32_t value, int n) {
    for (int i = 0; i < n; i++) p[i] = (uint8_t)(value >> 8 * i);
}
static inline uint16_t palpate_id(const uint8_t *body) { return palpate_u16(body + 1); }
static inline int8_t palpate_status(const uint8_t *body) { return (int8_t)body[3]; }

#define PALPATE_PROTOCOL 2
#define PALPATE_SCHEMA 0x28494A09u
#define PALPATE_CONTENT_FRAMES 1
#define PALPATE_CONTENT_STROKES 2
#define PALPATE_CAN_FLASH 1
#define PALPATE_CAN_CALIBRATE 2
#define PALPATE_CALIBRATE_ZERO 0
#define PALPATE_CALIBRATE_GAIN 1
#define PALPATE_CALIBRATE_CLEAR 2
#define PALPATE_STATE_CONTACT 1
#define PALPATE_STATE_STARTED 2
#define PALPATE_STATE_LUMP_PASSED 3
#define PALPATE_STATE_ENDED 4
#define PALPATE_STATE_FORCE_LOW 5
#define PALPATE_STATE_FORCE_HIGH 6
#define PALPATE_STATE_TOO_FAST 7
#define PALPATE_STATE_LIFTED 8
#define PALPATE_END_STROKES 1
#define PALPATE_END_LEASE 2
#define PALPATE_HAVE_MAP 1
#define PALPATE_HAVE_FEATURES 2
#define PALPATE_HAVE_ESTIMATE 4
#define PALPATE_HAVE_ALL 7
#define PALPATE_READ_CALIBRATION 0
#define PALPATE_READ_MODEL 1
#define PALPATE_READ_PIECE 200
#define PALPATE_LOG_INFO 0
#define PALPATE_LOG_WARNING 1
#define PALPATE_LOG_ERROR 2
#define PALPATE_DAMAGED_CALIBRATION 1
#define PALPATE_DAMAGED_MODEL 2
#define PALPATE_DAMAGED_SETTINGS 4
#define PALPATE_DAMAGE_REPAIRED 8
#define PALPATE_DAMAGE_TRIAL_HUNG 16
#define PALPATE_LEASE_MS 10000
#define PALPATE_LEASE_LEAST_MS 500
#define PALPATE_LEASE_MOST_MS 300000
#define PALPATE_FLASH_PIECE 48
#define PALPATE_WRAP 1073741824
#define PALPATE_FLAG_LUMP 1
#define PALPATE_FLAG_IN_DOMAIN 2
#define PALPATE_FLAG_SOFT 4
#define PALPATE_FLAG_HARD 8
#define PALPATE_FLAG_FORCE_OUT 16
#define PALPATE_FLAG_INVALID 32

#define PALPATE_OK (0) /* ok */
#define PALPATE_BAD_CRC (-1) /* the checksum does not fit the bytes */
#define PALPATE_BAD_LENGTH (-2) /* the message has a wrong length */
#define PALPATE_BAD_TYPE (-3) /* the probe does not know this message */
#define PALPATE_BAD_VALUE (-4) /* a field is outside its range */
#define PALPATE_BAD_STATE (-5) /* the probe is not in the state for this message */
#define PALPATE_BUSY (-6) /* the probe is busy */
#define PALPATE_NO_MODEL (-7) /* the probe holds no confirmed model */
#define PALPATE_NO_LUMP (-8) /* no lump found */
#define PALPATE_TOO_SHORT (-9) /* the stroke is too short: stroke on, 24 mm to either side of the lump */
#define PALPATE_FORCE_RANGE (-10) /* the mean force is outside the model's range */
#define PALPATE_NO_FIT (-11) /* the tactile map has no bump to fit */
#define PALPATE_BAD_MAGIC (-12) /* this is not a model image */
#define PALPATE_BAD_VERSION (-13) /* the probe does not know this version */
#define PALPATE_BAD_SIGNATURE (-14) /* the signature does not fit the probe's key */
#define PALPATE_BAD_PROBE (-15) /* the model was made for another probe */
#define PALPATE_MISSING_FEATURE (-16) /* the model needs a feature that this firmware does not compute */
#define PALPATE_TOO_OLD (-17) /* the model is older than one the probe has already accepted */
#define PALPATE_SELF_TEST (-18) /* the model failed its self-test */
#define PALPATE_NO_SPACE (-19) /* there is no room for it on the probe */
#define PALPATE_STORE_ERROR (-20) /* the probe's store could not be read or written */
#define PALPATE_OVERFLOW (-21) /* a number left the integer range */
#define PALPATE_NOT_SUPPORTED (-22) /* this firmware is built without that function */
#define PALPATE_FULL (-23) /* the buffer is full */
#define PALPATE_NOT_KNOWN (-24) /* the probe does not know this stream or stroke, or no longer */
#define PALPATE_IN_CONTACT (-25) /* the probe is in contact: lift it off, or raise contact_threshold above the cells' zero */
#define PALPATE_BAD_CALIBRATION (-26) /* too many cells do not read what the calibration needs: check pressure and cable */
#define PALPATE_REPAIRED (-27) /* what the probe had stored was damaged and could be repaired */
#define PALPATE_ROTTEN (-28) /* what the probe had stored is damaged beyond repair */
#define PALPATE_BAD_MODEL (-29) /* the model image holds a number that no model can have */
#define PALPATE_TRIAL_HUNG (-30) /* the probe restarted while it tried a model; the one it had stays */
#define PALPATE_NO_KEY (-31) /* no public key: the probe holds no key.pub, so it takes no model */
#define PALPATE_UNEVEN (-32) /* the force changed by more than 30 % to either side: press evenly */
#define PALPATE_TOO_SPARSE (-33) /* frames lie more than 4.5 mm apart: stroke more slowly */
#define PALPATE_NO_PRESS (-34) /* nobody pressed: press the probe straight down beside the lump, then lift it */
#define PALPATE_BAD_PRESS (-35) /* the press was too light or quick: press for a second, then hold the probe in the air for one */
#define PALPATE_MOVED (-36) /* the probe moved along the skin: press it straight down, then lift it */
#define PALPATE_NO_STAGE (-37) /* the model takes no reference press: it was told its tissue */
#define PALPATE_SATURATED (-38) /* cells read full scale: press more lightly */

#define PALPATE_SETTING_FRAME_RATE 0 /* mHz, 100 to 10000000, usually 50000 */
#define PALPATE_SETTING_CONTACT_THRESHOLD 1 /* Pa, 10 to 20000, usually 300 */
#define PALPATE_SETTING_FORCE_LOW 2 /* mN/m, 0 to 1000000, usually 15000 */
#define PALPATE_SETTING_FORCE_HIGH 3 /* mN/m, 1000 to 10000000, usually 150000 */
#define PALPATE_SETTING_SPEED_LIMIT 4 /* um/s, 1000 to 1000000, usually 100000 */
#define PALPATE_SETTING_STROKE_START 5 /* um, 0 to 50000, usually 500 */
#define PALPATE_SETTING_STROKE_PAUSE 6 /* ms, 50 to 60000, usually 1000 */
#define PALPATE_SETTING_RESEND_RESULTS 7 /* ms, 50 to 60000, usually 500 */

#define PALPATE_COUNTER_UPTIME_MS 0
#define PALPATE_COUNTER_FRAMES_ACQUIRED 1
#define PALPATE_COUNTER_FRAMES_SENT 2
#define PALPATE_COUNTER_FRAMES_DROPPED 3
#define PALPATE_COUNTER_FRAMES_OVERRUN 4
#define PALPATE_COUNTER_MESSAGES_SENT 5
#define PALPATE_COUNTER_RESULTS_RESENT 6
#define PALPATE_COUNTER_COMMANDS 7
#define PALPATE_COUNTER_COMMANDS_DUPLICATE 8
#define PALPATE_COUNTER_COMMANDS_REFUSED 9
#define PALPATE_COUNTER_PACKETS_BAD_CRC 10
#define PALPATE_COUNTER_PACKETS_BAD_FRAME 11
#define PALPATE_COUNTER_PACKETS_OVERSIZE 12
#define PALPATE_COUNTER_BYTES_RECEIVED 13
#define PALPATE_COUNTER_BYTES_SENT 14
#define PALPATE_COUNTER_STROKES 15
#define PALPATE_COUNTER_ESTIMATES 16
#define PALPATE_COUNTER_FREE_BYTES 17
#define PALPATE_COUNTER_EVENTS_DROPPED 18
#define PALPATE_COUNTER_ESTIMATES_ACKNOWLEDGED 19
#define PALPATE_COUNTER_ESTIMATES_GIVEN_UP 20
#define PALPATE_COUNTER_ESTIMATES_WAITING 21
#define PALPATE_COUNTER_MAPS_GIVEN_UP 22
#define PALPATE_COUNTER_LEASES_EXPIRED 23

#define PALPATE_COMMAND_IDENTIFY 0x01
#define PALPATE_COMMAND_GET_SETTING 0x02
#define PALPATE_COMMAND_SET_SETTING 0x03
#define PALPATE_COMMAND_CALIBRATE 0x04
#define PALPATE_COMMAND_STREAM_START 0x05
#define PALPATE_COMMAND_STREAM_STOP 0x06
#define PALPATE_COMMAND_STATISTICS 0x07
#define PALPATE_COMMAND_TIME_SYNC 0x08
#define PALPATE_COMMAND_STROKE_ACK 0x09
#define PALPATE_COMMAND_FLASH_BEGIN 0x0A
#define PALPATE_COMMAND_FLASH_DATA 0x0B
#define PALPATE_COMMAND_FLASH_VERIFY 0x0C
#define PALPATE_COMMAND_FLASH_CONFIRM 0x0D
#define PALPATE_COMMAND_FLASH_ABORT 0x0E
#define PALPATE_COMMAND_READ_BACK 0x0F
#define PALPATE_COMMAND_STREAM_RENEW 0x10
#define PALPATE_COMMAND_RESULTS 0x11
#define PALPATE_COMMAND_REFERENCE 0x12
#define PALPATE_ANSWER_IDENTIFY 0x81
#define PALPATE_ANSWER_GET_SETTING 0x82
#define PALPATE_ANSWER_SET_SETTING 0x83
#define PALPATE_ANSWER_CALIBRATE 0x84
#define PALPATE_ANSWER_STREAM_START 0x85
#define PALPATE_ANSWER_STREAM_STOP 0x86
#define PALPATE_ANSWER_STATISTICS 0x87
#define PALPATE_ANSWER_TIME_SYNC 0x88
#define PALPATE_ANSWER_STROKE_ACK 0x89
#define PALPATE_ANSWER_FLASH_BEGIN 0x8A
#define PALPATE_ANSWER_FLASH_DATA 0x8B
#define PALPATE_ANSWER_FLASH_VERIFY 0x8C
#define PALPATE_ANSWER_FLASH_CONFIRM 0x8D
#define PALPATE_ANSWER_FLASH_ABORT 0x8E
#define PALPATE_ANSWER_READ_BACK 0x8F
#define PALPATE_ANSWER_STREAM_RENEW 0x90
#define PALPATE_ANSWER_RESULTS 0x91
#define PALPATE_ANSWER_REFERENCE 0x92
#define PALPATE_ANSWER_UNKNOWN 0xFF
#define PALPATE_FRAME 0x40
#define PALPATE_STROKE_STATE 0x42
#define PALPATE_MAP 0x43
#define PALPATE_ESTIMATE 0x44
#define PALPATE_LOG 0x45
#define PALPATE_BOOT 0x46
#define PALPATE_FEATURES 0x47
#define PALPATE_STREAM_END 0x48

struct palpate_identify {
    uint32_t nonce; /* any number; comes back in the answer */
};
static inline size_t palpate_put_identify(uint8_t *body, uint16_t id, const struct palpate_identify *m) {
    body[0] = 0x01;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->nonce, 4);
    return 7;
}

struct palpate_get_setting {
    uint8_t key; /* of the table of settings */
};
static inline size_t palpate_put_get_setting(uint8_t *body, uint16_t id, const struct palpate_get_setting *m) {
    body[0] = 0x02;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->key, 1);
    return 4;
}

struct palpate_set_setting {
    uint8_t key; /* of the table of settings */
    int32_t value; /* the setting's: the new value */
};
static inline size_t palpate_put_set_setting(uint8_t *body, uint16_t id, const struct palpate_set_setting *m) {
    body[0] = 0x03;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->key, 1);
    palpate_put(body + 4, (uint32_t)m->value, 4);
    return 8;
}

struct palpate_calibrate {
    uint8_t kind; /* 0 zero, in the air; 1 gain, under a uniform pressure; 2 forget both */
    uint8_t frames; /* how many to average, 1 to 255 */
    int32_t pressure_pa; /* Pa: kind 1: what presses on every cell */
};
static inline size_t palpate_put_calibrate(uint8_t *body, uint16_t id, const struct palpate_calibrate *m) {
    body[0] = 0x04;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->kind, 1);
    palpate_put(body + 4, (uint32_t)m->frames, 1);
    palpate_put(body + 5, (uint32_t)m->pressure_pa, 4);
    return 9;
}

struct palpate_stream_start {
    uint8_t content; /* bits: 1 frames, 2 stroke states, maps, features and estimates */
    uint8_t every; /* send each n-th frame (0 and 1: all); seq still counts all */
    uint16_t strokes; /* end after so many strokes; 0: never */
    uint32_t lease_ms; /* ms: end when no command came for so long: 500 to 300000; 0: 10000 */
};
static inline size_t palpate_put_stream_start(uint8_t *body, uint16_t id, const struct palpate_stream_start *m) {
    body[0] = 0x05;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->content, 1);
    palpate_put(body + 4, (uint32_t)m->every, 1);
    palpate_put(body + 5, (uint32_t)m->strokes, 2);
    palpate_put(body + 7, (uint32_t)m->lease_ms, 4);
    return 11;
}

static inline size_t palpate_put_stream_stop(uint8_t *body, uint16_t id) {
    body[0] = 0x06;
    palpate_put(body + 1, id, 2);
    return 3;
}

static inline size_t palpate_put_statistics(uint8_t *body, uint16_t id) {
    body[0] = 0x07;
    palpate_put(body + 1, id, 2);
    return 3;
}

static inline size_t palpate_put_time_sync(uint8_t *body, uint16_t id) {
    body[0] = 0x08;
    palpate_put(body + 1, id, 2);
    return 3;
}

struct palpate_stroke_ack {
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    uint8_t have; /* what has arrived; bits: 1 map, 2 features, 4 estimate; at least one */
};
static inline size_t palpate_put_stroke_ack(uint8_t *body, uint16_t id, const struct palpate_stroke_ack *m) {
    body[0] = 0x09;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->stream, 4);
    palpate_put(body + 7, (uint32_t)m->stroke, 4);
    palpate_put(body + 11, (uint32_t)m->have, 1);
    return 12;
}

struct palpate_flash_begin {
    uint32_t size; /* bytes: of the image, signature included */
    uint8_t name[8]; /* any 8 bytes that name this image and no other, such as a hash of it */
};
static inline size_t palpate_put_flash_begin(uint8_t *body, uint16_t id, const struct palpate_flash_begin *m) {
    body[0] = 0x0A;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->size, 4);
    memcpy(body + 7, m->name, 8);
    return 15;
}

struct palpate_flash_data {
    uint32_t offset; /* bytes: where the piece begins */
    const uint8_t *tail; /* the piece, 48 bytes at most */
    size_t tail_n; /* bytes */
};
static inline size_t palpate_put_flash_data(uint8_t *body, uint16_t id, const struct palpate_flash_data *m) {
    body[0] = 0x0B;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->offset, 4);
    memcpy(body + 7, m->tail, m->tail_n);
    return 7 + m->tail_n;
}

struct palpate_flash_verify {
    uint8_t name[8]; /* as in flash_begin */
};
static inline size_t palpate_put_flash_verify(uint8_t *body, uint16_t id, const struct palpate_flash_verify *m) {
    body[0] = 0x0C;
    palpate_put(body + 1, id, 2);
    memcpy(body + 3, m->name, 8);
    return 11;
}

struct palpate_flash_confirm {
    uint8_t model_id[8]; /* of the model to make live; in the answer, of the one that is */
};
static inline size_t palpate_put_flash_confirm(uint8_t *body, uint16_t id, const struct palpate_flash_confirm *m) {
    body[0] = 0x0D;
    palpate_put(body + 1, id, 2);
    memcpy(body + 3, m->model_id, 8);
    return 11;
}

static inline size_t palpate_put_flash_abort(uint8_t *body, uint16_t id) {
    body[0] = 0x0E;
    palpate_put(body + 1, id, 2);
    return 3;
}

struct palpate_read_back {
    uint8_t what; /* 0 the calibration, 1 the live model image */
    uint32_t offset; /* bytes: from where; behind the end the piece is empty */
};
static inline size_t palpate_put_read_back(uint8_t *body, uint16_t id, const struct palpate_read_back *m) {
    body[0] = 0x0F;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->what, 1);
    palpate_put(body + 4, (uint32_t)m->offset, 4);
    return 8;
}

struct palpate_stream_renew {
    uint32_t stream; /* the stream to go on with, and that goes on */
};
static inline size_t palpate_put_stream_renew(uint8_t *body, uint16_t id, const struct palpate_stream_renew *m) {
    body[0] = 0x10;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->stream, 4);
    return 7;
}

struct palpate_results {
    uint32_t stream; /* whose results are to be sent again; 0: none, only list */
};
static inline size_t palpate_put_results(uint8_t *body, uint16_t id, const struct palpate_results *m) {
    body[0] = 0x11;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->stream, 4);
    return 7;
}

struct palpate_reference {
    uint8_t kind; /* 0 take one: answered when the press is over; 1 forget it; 2 tell */
};
static inline size_t palpate_put_reference(uint8_t *body, uint16_t id, const struct palpate_reference *m) {
    body[0] = 0x12;
    palpate_put(body + 1, id, 2);
    palpate_put(body + 3, (uint32_t)m->kind, 1);
    return 4;
}

struct palpate_identify_answer {
    uint32_t nonce; /* any number; comes back in the answer */
    uint8_t protocol; /* version of the protocol: 2; another one is not spoken to */
    uint32_t schema; /* CRC-32 of the message tables' text; differs where one end knows more */
    uint8_t firmware[3]; /* major, minor, patch */
    uint8_t serial[8]; /* the board's serial number */
    uint8_t rows; /* sensors along the stroke */
    uint8_t columns; /* sensors across it */
    uint16_t pitch_um; /* um: from one sensor to the next */
    uint8_t bits; /* of a count */
    uint16_t capabilities; /* bits: 1 flash, 2 calibrate, 4 none, 8 the live model takes a reference, 16 there is one */
    uint8_t features_version; /* of the feature list; 0: a probe that makes no estimates */
    int8_t model_status; /* 0: a model is live; else why none is (Status) */
    uint8_t model_id[8]; /* first 8 bytes of the SHA-256 of the model image's signed part; zeros: none */
    uint32_t boots; /* how often the probe has started */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
    uint8_t damage; /* bits: what was damaged in the store (Damage) */
    uint32_t stream; /* the stream that runs, 0: none */
};
static inline int palpate_get_identify_answer(const uint8_t *body, size_t n, struct palpate_identify_answer *m) {
    if (n < 54 || body[0] != 0x81) return 0;
    m->nonce = (uint32_t)palpate_u32(body + 4);
    m->protocol = (uint8_t)body[8];
    m->schema = (uint32_t)palpate_u32(body + 9);
    memcpy(m->firmware, body + 13, 3);
    memcpy(m->serial, body + 16, 8);
    m->rows = (uint8_t)body[24];
    m->columns = (uint8_t)body[25];
    m->pitch_um = (uint16_t)palpate_u16(body + 26);
    m->bits = (uint8_t)body[28];
    m->capabilities = (uint16_t)palpate_u16(body + 29);
    m->features_version = (uint8_t)body[31];
    m->model_status = (int8_t)body[32];
    memcpy(m->model_id, body + 33, 8);
    m->boots = (uint32_t)palpate_u32(body + 41);
    m->time_us = (uint32_t)palpate_u32(body + 45);
    m->damage = (uint8_t)body[49];
    m->stream = (uint32_t)palpate_u32(body + 50);
    return 1;
}

struct palpate_get_setting_answer {
    uint8_t key; /* of the table of settings */
    int32_t value; /* the setting's: its value */
    int32_t low; /* the setting's: lowest value that it takes now */
    int32_t high; /* the setting's: highest value that it takes now */
};
static inline int palpate_get_get_setting_answer(const uint8_t *body, size_t n, struct palpate_get_setting_answer *m) {
    if (n < 17 || body[0] != 0x82) return 0;
    m->key = (uint8_t)body[4];
    m->value = (int32_t)palpate_u32(body + 5);
    m->low = (int32_t)palpate_u32(body + 9);
    m->high = (int32_t)palpate_u32(body + 13);
    return 1;
}

struct palpate_set_setting_answer {
    uint8_t key; /* of the table of settings */
    int32_t value; /* the setting's: the new value */
};
static inline int palpate_get_set_setting_answer(const uint8_t *body, size_t n, struct palpate_set_setting_answer *m) {
    if (n < 9 || body[0] != 0x83) return 0;
    m->key = (uint8_t)body[4];
    m->value = (int32_t)palpate_u32(body + 5);
    return 1;
}

struct palpate_calibrate_answer {
    uint8_t kind; /* 0 zero, in the air; 1 gain, under a uniform pressure; 2 forget both */
    uint8_t frames; /* how many to average, 1 to 255 */
    uint16_t dead_cells; /* cells marked dead, all in all */
    int32_t noise_millicounts; /* 1/1000 count: standard deviation over the frames, mean of the cells */
};
static inline int palpate_get_calibrate_answer(const uint8_t *body, size_t n, struct palpate_calibrate_answer *m) {
    if (n < 12 || body[0] != 0x84) return 0;
    m->kind = (uint8_t)body[4];
    m->frames = (uint8_t)body[5];
    m->dead_cells = (uint16_t)palpate_u16(body + 6);
    m->noise_millicounts = (int32_t)palpate_u32(body + 8);
    return 1;
}

struct palpate_stream_start_answer {
    uint32_t stream; /* the stream's number, which no other stream of this probe has; never 0 */
    uint32_t next_seq; /* number of the frame that comes next */
    uint32_t next_stroke; /* number that the next stroke will have */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
    uint32_t lease_ms; /* ms: end when no command came for so long: 500 to 300000; 0: 10000 */
};
static inline int palpate_get_stream_start_answer(const uint8_t *body, size_t n, struct palpate_stream_start_answer *m) {
    if (n < 24 || body[0] != 0x85) return 0;
    m->stream = (uint32_t)palpate_u32(body + 4);
    m->next_seq = (uint32_t)palpate_u32(body + 8);
    m->next_stroke = (uint32_t)palpate_u32(body + 12);
    m->time_us = (uint32_t)palpate_u32(body + 16);
    m->lease_ms = (uint32_t)palpate_u32(body + 20);
    return 1;
}

struct palpate_stream_stop_answer {
    uint32_t stream; /* the stream that was stopped; 0: none ran */
    uint32_t next_seq; /* number of the frame that would have come next */
    uint32_t next_stroke; /* number that the next stroke will have */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
};
static inline int palpate_get_stream_stop_answer(const uint8_t *body, size_t n, struct palpate_stream_stop_answer *m) {
    if (n < 20 || body[0] != 0x86) return 0;
    m->stream = (uint32_t)palpate_u32(body + 4);
    m->next_seq = (uint32_t)palpate_u32(body + 8);
    m->next_stroke = (uint32_t)palpate_u32(body + 12);
    m->time_us = (uint32_t)palpate_u32(body + 16);
    return 1;
}

struct palpate_statistics_answer {
    const uint8_t *tail; /* the counters, in their order */
    size_t tail_n; /* 32-bit numbers, for palpate_i32(tail + 4 * k) */
};
static inline int palpate_get_statistics_answer(const uint8_t *body, size_t n, struct palpate_statistics_answer *m) {
    if (n < 4 || body[0] != 0x87) return 0;
    m->tail = body + 4;
    m->tail_n = (n - 4) / 4;
    return 1;
}

struct palpate_time_sync_answer {
    uint32_t received_us; /* us: the probe's clock when the command's last byte was taken */
    uint32_t sent_us; /* us: and when the answer was made */
};
static inline int palpate_get_time_sync_answer(const uint8_t *body, size_t n, struct palpate_time_sync_answer *m) {
    if (n < 12 || body[0] != 0x88) return 0;
    m->received_us = (uint32_t)palpate_u32(body + 4);
    m->sent_us = (uint32_t)palpate_u32(body + 8);
    return 1;
}

struct palpate_stroke_ack_answer {
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    uint8_t missing; /* what the probe still waits to hear of; bits: 1 map, 2 features, 4 estimate */
};
static inline int palpate_get_stroke_ack_answer(const uint8_t *body, size_t n, struct palpate_stroke_ack_answer *m) {
    if (n < 13 || body[0] != 0x89) return 0;
    m->stream = (uint32_t)palpate_u32(body + 4);
    m->stroke = (uint32_t)palpate_u32(body + 8);
    m->missing = (uint8_t)body[12];
    return 1;
}

struct palpate_flash_begin_answer {
    uint32_t received; /* bytes: how many the probe has: send from there on */
};
static inline int palpate_get_flash_begin_answer(const uint8_t *body, size_t n, struct palpate_flash_begin_answer *m) {
    if (n < 8 || body[0] != 0x8A) return 0;
    m->received = (uint32_t)palpate_u32(body + 4);
    return 1;
}

struct palpate_flash_data_answer {
    uint32_t received; /* bytes: how many the probe has now */
};
static inline int palpate_get_flash_data_answer(const uint8_t *body, size_t n, struct palpate_flash_data_answer *m) {
    if (n < 8 || body[0] != 0x8B) return 0;
    m->received = (uint32_t)palpate_u32(body + 4);
    return 1;
}

struct palpate_flash_verify_answer {
    uint8_t model_id[8]; /* of the model that is ready to be confirmed */
};
static inline int palpate_get_flash_verify_answer(const uint8_t *body, size_t n, struct palpate_flash_verify_answer *m) {
    if (n < 12 || body[0] != 0x8C) return 0;
    memcpy(m->model_id, body + 4, 8);
    return 1;
}

struct palpate_flash_confirm_answer {
    uint8_t model_id[8]; /* of the model to make live; in the answer, of the one that is */
};
static inline int palpate_get_flash_confirm_answer(const uint8_t *body, size_t n, struct palpate_flash_confirm_answer *m) {
    if (n < 12 || body[0] != 0x8D) return 0;
    memcpy(m->model_id, body + 4, 8);
    return 1;
}

struct palpate_flash_abort_answer {
    uint8_t model_id[8]; /* of the live model; zeros: none */
};
static inline int palpate_get_flash_abort_answer(const uint8_t *body, size_t n, struct palpate_flash_abort_answer *m) {
    if (n < 12 || body[0] != 0x8E) return 0;
    memcpy(m->model_id, body + 4, 8);
    return 1;
}

struct palpate_read_back_answer {
    uint8_t what; /* 0 the calibration, 1 the live model image */
    uint32_t offset; /* bytes: from where; behind the end the piece is empty */
    uint32_t size; /* bytes: of the whole */
    const uint8_t *tail; /* 200 bytes from there on, or what is left */
    size_t tail_n; /* bytes */
};
static inline int palpate_get_read_back_answer(const uint8_t *body, size_t n, struct palpate_read_back_answer *m) {
    if (n < 13 || body[0] != 0x8F) return 0;
    m->what = (uint8_t)body[4];
    m->offset = (uint32_t)palpate_u32(body + 5);
    m->size = (uint32_t)palpate_u32(body + 9);
    m->tail = body + 13;
    m->tail_n = (n - 13);
    return 1;
}

struct palpate_stream_renew_answer {
    uint32_t stream; /* the stream to go on with, and that goes on */
    uint32_t next_seq; /* number of the frame that comes next */
    uint32_t next_stroke; /* number that the next stroke will have */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
    uint32_t lease_ms; /* ms: how long it goes on without a further word */
};
static inline int palpate_get_stream_renew_answer(const uint8_t *body, size_t n, struct palpate_stream_renew_answer *m) {
    if (n < 24 || body[0] != 0x90) return 0;
    m->stream = (uint32_t)palpate_u32(body + 4);
    m->next_seq = (uint32_t)palpate_u32(body + 8);
    m->next_stroke = (uint32_t)palpate_u32(body + 12);
    m->time_us = (uint32_t)palpate_u32(body + 16);
    m->lease_ms = (uint32_t)palpate_u32(body + 20);
    return 1;
}

struct palpate_results_answer {
    uint16_t waiting; /* estimates that nobody has acknowledged */
    const uint8_t *tail; /* for each stream with such results: its number, its oldest stroke, its newest */
    size_t tail_n; /* 32-bit numbers, for palpate_i32(tail + 4 * k) */
};
static inline int palpate_get_results_answer(const uint8_t *body, size_t n, struct palpate_results_answer *m) {
    if (n < 6 || body[0] != 0x91) return 0;
    m->waiting = (uint16_t)palpate_u16(body + 4);
    m->tail = body + 6;
    m->tail_n = (n - 6) / 4;
    return 1;
}

struct palpate_reference_answer {
    uint8_t kind; /* 0 take one: answered when the press is over; 1 forget it; 2 tell */
    uint8_t held; /* 1 where there is one */
    int32_t ln_fat_q24; /* 2^-24: ln of the fat's modulus, kPa */
    int32_t ln_t_q24; /* 2^-24: ln of the fat's thickness, mm */
    int32_t ln_layers_q24; /* 2^-24: ln of fat and gland together, as mm of fat that give as much */
};
static inline int palpate_get_reference_answer(const uint8_t *body, size_t n, struct palpate_reference_answer *m) {
    if (n < 18 || body[0] != 0x92) return 0;
    m->kind = (uint8_t)body[4];
    m->held = (uint8_t)body[5];
    m->ln_fat_q24 = (int32_t)palpate_u32(body + 6);
    m->ln_t_q24 = (int32_t)palpate_u32(body + 10);
    m->ln_layers_q24 = (int32_t)palpate_u32(body + 14);
    return 1;
}

struct palpate_frame {
    uint32_t seq; /* number of the frame, counts every frame acquired, modulo 2^30 */
    uint32_t time_us; /* us: the probe's clock at the scan, modulo 2^30 */
    int32_t position_um; /* um: along the stroke, by the encoder; grows in the direction of row 15 */
    int32_t displacement_um; /* um: of the probe into the tissue; grows inwards */
    const uint8_t *tail; /* counts: 416 counts of 12 bits, two in three bytes (Frame) */
    size_t tail_n; /* bytes */
};
static inline int palpate_get_frame(const uint8_t *body, size_t n, struct palpate_frame *m) {
    if (n < 17 || body[0] != 0x40) return 0;
    m->seq = (uint32_t)palpate_u32(body + 1);
    m->time_us = (uint32_t)palpate_u32(body + 5);
    m->position_um = (int32_t)palpate_u32(body + 9);
    m->displacement_um = (int32_t)palpate_u32(body + 13);
    m->tail = body + 17;
    m->tail_n = (n - 17);
    return 1;
}

struct palpate_stroke_state {
    uint16_t event_seq; /* counts stroke states modulo 2^16: a gap is a lost one */
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    uint8_t state; /* what has happened (Stroke states) */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
    uint32_t frame_seq; /* the frame in which it happened */
    int32_t value; /* by the state: see Stroke states */
};
static inline int palpate_get_stroke_state(const uint8_t *body, size_t n, struct palpate_stroke_state *m) {
    if (n < 24 || body[0] != 0x42) return 0;
    m->event_seq = (uint16_t)palpate_u16(body + 1);
    m->stream = (uint32_t)palpate_u32(body + 3);
    m->stroke = (uint32_t)palpate_u32(body + 7);
    m->state = (uint8_t)body[11];
    m->time_us = (uint32_t)palpate_u32(body + 12);
    m->frame_seq = (uint32_t)palpate_u32(body + 16);
    m->value = (int32_t)palpate_u32(body + 20);
    return 1;
}

struct palpate_map {
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    int8_t status; /* 0, or why there is no result (Status) */
    uint8_t first_column; /* the first column that was used */
    uint8_t end_column; /* one behind the last */
    uint8_t points; /* values in the map, 1 mm apart */
    int8_t first_mm; /* mm: place of the first value, from place_um */
    int32_t place_um; /* um: position of the lump along the stroke */
    uint32_t count_mpa; /* mPa: pressure of one count */
    int32_t base_q11; /* 1/2048 count: Gaussian fit: level beside the lump */
    int32_t amplitude_q11; /* 1/2048 count: Gaussian fit: height of the bump */
    int32_t centre_q16; /* 1/65536 mm: Gaussian fit: its place, from the first value */
    int32_t stdev_q16; /* 1/65536 mm: Gaussian fit: its standard deviation */
    const uint8_t *tail; /* 1/2048 count: the map; pressure in mPa = value * count_mpa / 2048 */
    size_t tail_n; /* 32-bit numbers, for palpate_i32(tail + 4 * k) */
};
static inline int palpate_get_map(const uint8_t *body, size_t n, struct palpate_map *m) {
    if (n < 38 || body[0] != 0x43) return 0;
    m->stream = (uint32_t)palpate_u32(body + 1);
    m->stroke = (uint32_t)palpate_u32(body + 5);
    m->status = (int8_t)body[9];
    m->first_column = (uint8_t)body[10];
    m->end_column = (uint8_t)body[11];
    m->points = (uint8_t)body[12];
    m->first_mm = (int8_t)body[13];
    m->place_um = (int32_t)palpate_u32(body + 14);
    m->count_mpa = (uint32_t)palpate_u32(body + 18);
    m->base_q11 = (int32_t)palpate_u32(body + 22);
    m->amplitude_q11 = (int32_t)palpate_u32(body + 26);
    m->centre_q16 = (int32_t)palpate_u32(body + 30);
    m->stdev_q16 = (int32_t)palpate_u32(body + 34);
    m->tail = body + 38;
    m->tail_n = (n - 38) / 4;
    return 1;
}

struct palpate_estimate {
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    int8_t status; /* 0, or why there is no result (Status) */
    uint8_t flags; /* bits: 1 lump, 2 in the domain, 4 and 8 hardness, 16 force out, 32 invalid, 64 the reference is in it, 128 it does not fit and is not */
    uint8_t damage; /* as in identify: what this estimate may rest on */
    uint16_t level_permille; /* 1/1000: coverage of the intervals */
    uint16_t distance_permille; /* 1/1000: from the domain's centre; over 1000: outside */
    uint8_t model_id[8]; /* first 8 bytes of the SHA-256 of the model image's signed part; zeros: none */
    uint16_t frames; /* how many frames it rests on */
    uint32_t first_seq; /* the first of them */
    uint32_t last_seq; /* the frame in which the stroke ended; it is not among them */
    uint32_t overrun; /* frames that the sensors were too late for, meanwhile */
    uint32_t time_us; /* us: the probe's clock at the end of the stroke, modulo 2^30 */
    const uint8_t *tail; /* millionths: value, low, high of F (N/m), t (mm), d (mm), h, E^-2/3; or nothing */
    size_t tail_n; /* 32-bit numbers, for palpate_i32(tail + 4 * k) */
};
static inline int palpate_get_estimate(const uint8_t *body, size_t n, struct palpate_estimate *m) {
    if (n < 42 || body[0] != 0x44) return 0;
    m->stream = (uint32_t)palpate_u32(body + 1);
    m->stroke = (uint32_t)palpate_u32(body + 5);
    m->status = (int8_t)body[9];
    m->flags = (uint8_t)body[10];
    m->damage = (uint8_t)body[11];
    m->level_permille = (uint16_t)palpate_u16(body + 12);
    m->distance_permille = (uint16_t)palpate_u16(body + 14);
    memcpy(m->model_id, body + 16, 8);
    m->frames = (uint16_t)palpate_u16(body + 24);
    m->first_seq = (uint32_t)palpate_u32(body + 26);
    m->last_seq = (uint32_t)palpate_u32(body + 30);
    m->overrun = (uint32_t)palpate_u32(body + 34);
    m->time_us = (uint32_t)palpate_u32(body + 38);
    m->tail = body + 42;
    m->tail_n = (n - 42) / 4;
    return 1;
}

struct palpate_log {
    uint8_t level; /* 0 information, 1 warning, 2 error */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
    const uint8_t *tail; /* UTF-8 text */
    size_t tail_n; /* bytes */
};
static inline int palpate_get_log(const uint8_t *body, size_t n, struct palpate_log *m) {
    if (n < 6 || body[0] != 0x45) return 0;
    m->level = (uint8_t)body[1];
    m->time_us = (uint32_t)palpate_u32(body + 2);
    m->tail = body + 6;
    m->tail_n = (n - 6);
    return 1;
}

struct palpate_boot {
    uint32_t boots; /* how often the probe has started */
    int8_t status; /* 0, or what was wrong at the start (Status) */
};
static inline int palpate_get_boot(const uint8_t *body, size_t n, struct palpate_boot *m) {
    if (n < 6 || body[0] != 0x46) return 0;
    m->boots = (uint32_t)palpate_u32(body + 1);
    m->status = (int8_t)body[5];
    return 1;
}

struct palpate_features {
    uint32_t stream; /* number of the stream */
    uint32_t stroke; /* number of the stroke, counts since the probe started */
    int8_t status; /* 0, or why there is no result (Status) */
    uint8_t version; /* of the feature list */
    const uint8_t *tail; /* 1/2^24: what the model was evaluated on (docs/features.md) */
    size_t tail_n; /* 32-bit numbers, for palpate_i32(tail + 4 * k) */
};
static inline int palpate_get_features(const uint8_t *body, size_t n, struct palpate_features *m) {
    if (n < 11 || body[0] != 0x47) return 0;
    m->stream = (uint32_t)palpate_u32(body + 1);
    m->stroke = (uint32_t)palpate_u32(body + 5);
    m->status = (int8_t)body[9];
    m->version = (uint8_t)body[10];
    m->tail = body + 11;
    m->tail_n = (n - 11) / 4;
    return 1;
}

struct palpate_stream_end {
    uint32_t stream; /* the stream that the probe has ended by itself */
    uint8_t reason; /* 1 as many strokes as asked for, 2 its lease was over */
    uint32_t next_seq; /* number of the frame that would have come next */
    uint32_t next_stroke; /* number that the next stroke will have */
    uint32_t time_us; /* us: the probe's clock, modulo 2^30 */
};
static inline int palpate_get_stream_end(const uint8_t *body, size_t n, struct palpate_stream_end *m) {
    if (n < 18 || body[0] != 0x48) return 0;
    m->stream = (uint32_t)palpate_u32(body + 1);
    m->reason = (uint8_t)body[5];
    m->next_seq = (uint32_t)palpate_u32(body + 6);
    m->next_stroke = (uint32_t)palpate_u32(body + 10);
    m->time_us = (uint32_t)palpate_u32(body + 14);
    return 1;
}

#endif
