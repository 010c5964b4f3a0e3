/* A whole client in C, on nothing but palpate.h and POSIX: shakes hands, flashes an image if one is given,
   streams strokes, acknowledges their results, and counts what is lost.

       cc -std=c99 -D_POSIX_C_SOURCE=200809L -o client client.c
       ./client HOST:PORT|DEVICE STROKES [IMAGE.palp]

   Exit status: 0 all strokes came, 1 something failed (one sentence says what), 2 wrong words. */
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "palpate.h"

enum { BODY = 2048, RETRY_MS = 400, GIVE_UP_MS = 6000, VERIFY_MS = 60000, RENEW_MS = 3000, SILENCE_MS = 60000 };

static struct {
    int fd;
    uint16_t id;                          /* of the last command */
    uint8_t packet[BODY + BODY / 254 + 8];
    size_t have;                          /* bytes of a packet that has not ended yet */
    int skip;                             /* it is too long: forget it up to its zero */
    uint8_t in[4096];
    size_t at, end;
    unsigned damaged;
    uint32_t stream, next_seq, frames, lost, estimates, wanted;
} link_;

static void fail(const char *what) {
    fprintf(stderr, "client: %s\n", what);
    exit(1);
}

static int64_t now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static uint32_t crc32(const uint8_t *p, size_t n) {
    uint32_t crc = 0xFFFFFFFFu;
    while (n--) {
        crc ^= *p++;
        for (int k = 0; k < 8; k++) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

static size_t stuff(const uint8_t *in, size_t n, uint8_t *out) {
    size_t code_at = 0, at = 1;
    uint8_t code = 1;
    for (size_t i = 0; i < n; i++) {
        if (in[i]) {
            out[at++] = in[i];
            if (++code < 255) continue;
        }
        out[code_at] = code;
        code_at = at++;
        code = 1;
    }
    out[code_at] = code;
    out[at] = 0;
    return at + 1;
}

/* In place; the new length, or 0 if the packet is malformed. */
static size_t unstuff(uint8_t *p, size_t n) {
    size_t at = 0, out = 0;
    while (at < n) {
        uint8_t code = p[at++];
        if (code == 0 || at + code - 1 > n) return 0;
        memmove(p + out, p + at, code - 1u);
        out += code - 1u;
        at += code - 1u;
        if (code < 255 && at < n) p[out++] = 0;
    }
    return out;
}

static void send_body(const uint8_t *body, size_t n) {
    uint8_t sealed[64], wire[80];
    memcpy(sealed, body, n);
    palpate_put(sealed + n, crc32(body, n), 4);
    wire[0] = 0; /* ends whatever noise stood before */
    size_t total = 1 + stuff(sealed, n + 4, wire + 1), at = 0;
    while (at < total) {
        ssize_t k = write(link_.fd, wire + at, total - at);
        if (k > 0) at += (size_t)k;
        else if (errno != EAGAIN && errno != EINTR) fail("the link is gone; plug the probe in again");
    }
}

/* The next good body, or NULL after so many ms. It is valid until the next call. */
static const uint8_t *next_body(int64_t deadline, size_t *n) {
    for (;;) {
        while (link_.at < link_.end) {
            uint8_t byte = link_.in[link_.at++];
            if (byte) {
                if (link_.have < sizeof link_.packet) link_.packet[link_.have++] = byte;
                else link_.skip = 1;
                continue;
            }
            size_t length = link_.skip ? 0 : unstuff(link_.packet, link_.have);
            int empty = link_.have == 0;
            link_.have = 0;
            link_.skip = 0;
            if (empty) continue;
            if (length > 4 && crc32(link_.packet, length - 4) == palpate_u32(link_.packet + length - 4)) {
                *n = length - 4;
                return link_.packet;
            }
            link_.damaged++;
        }
        int64_t left = deadline - now_ms();
        if (left <= 0) return NULL;
        struct pollfd ready = {link_.fd, POLLIN, 0};
        if (poll(&ready, 1, (int)left) <= 0) continue;
        ssize_t k = read(link_.fd, link_.in, sizeof link_.in);
        if (k == 0 || (k < 0 && errno != EAGAIN && errno != EINTR)) fail("the link is gone; plug the probe in again");
        link_.at = 0;
        link_.end = k > 0 ? (size_t)k : 0;
    }
}

/* Results may come again: they are acknowledged each time, and used once. */
static void acknowledge(uint32_t stream, uint32_t stroke, uint8_t have) {
    uint8_t body[64];
    struct palpate_stroke_ack ack = {stream, stroke, have};
    send_body(body, palpate_put_stroke_ack(body, ++link_.id, &ack));
}

static void on_frame(const uint8_t *body, size_t n) {
    struct palpate_frame frame;
    if (!palpate_get_frame(body, n, &frame) || frame.tail_n != 624) return;
    uint32_t ahead = (frame.seq - link_.next_seq) & (PALPATE_WRAP - 1);
    if (ahead >= PALPATE_WRAP / 2) return; /* late, doubled, or of a stream before this one */
    link_.lost += ahead;
    link_.next_seq = (frame.seq + 1) & (PALPATE_WRAP - 1);
    link_.frames++;
}

static void on_estimate(const uint8_t *body, size_t n) {
    static const char *names[] = {"F_N_per_m", "t_mm", "d_mm", "h", "E_inv23", "E_fat_kPa"};
    static uint32_t newest;
    struct palpate_estimate e;
    if (!palpate_get_estimate(body, n, &e) || e.stream != link_.stream) return; /* not ours */
    acknowledge(e.stream, e.stroke, PALPATE_HAVE_ESTIMATE);
    if (link_.estimates && ((e.stroke - newest) & (PALPATE_WRAP - 1)) - 1 >= PALPATE_WRAP / 2) return; /* again */
    newest = e.stroke;
    link_.estimates++;
    printf("stroke %u frames %u status %d flags %u", (unsigned)e.stroke, e.frames, e.status, e.flags);
    for (size_t k = 0; k < 6 && 3 * k + 2 < e.tail_n; k++)
        printf(" %s %.6f %.6f %.6f", names[k], palpate_i32(e.tail + 12 * k) / 1e6,
               palpate_i32(e.tail + 12 * k + 4) / 1e6, palpate_i32(e.tail + 12 * k + 8) / 1e6);
    printf("\n");
}

static void on_event(const uint8_t *body, size_t n) {
    struct palpate_map map;
    struct palpate_features features;
    if (body[0] == PALPATE_FRAME) on_frame(body, n);
    else if (body[0] == PALPATE_ESTIMATE) on_estimate(body, n);
    else if (palpate_get_map(body, n, &map) && map.stream == link_.stream)
        acknowledge(map.stream, map.stroke, PALPATE_HAVE_MAP);
    else if (palpate_get_features(body, n, &features) && features.stream == link_.stream)
        acknowledge(features.stream, features.stroke, PALPATE_HAVE_FEATURES);
}

/* Sends the same bytes until their answer comes: every command may be repeated. Events meanwhile are served. */
static const uint8_t *ask(const uint8_t *command, size_t length, int64_t patience_ms, size_t *n) {
    static char words[80];
    int64_t give_up = now_ms() + patience_ms;
    while (now_ms() < give_up) {
        int64_t again = now_ms() + RETRY_MS;
        const uint8_t *body;
        send_body(command, length);
        while ((body = next_body(again, n))) {
            if (body[0] != (command[0] | 0x80) || *n < 4 || palpate_id(body) != palpate_id(command)) {
                on_event(body, *n);
                continue;
            }
            if (palpate_status(body) < 0) {
                snprintf(words, sizeof words, "the probe refuses 0x%02X: status %d", command[0], palpate_status(body));
                fail(words);
            }
            return body;
        }
    }
    fail("the probe does not answer; check the port");
    return NULL;
}

static void flash(const char *path) {
    static uint8_t image[65536];
    uint8_t body[64];
    const uint8_t *answer;
    size_t n;
    FILE *file = fopen(path, "rb");
    size_t size = file ? fread(image, 1, sizeof image, file) : 0;
    if (!size) fail("the image cannot be read");
    fclose(file);
    struct palpate_flash_begin begin = {(uint32_t)size, {0}};
    palpate_put(begin.name, crc32(image, size), 4); /* enough to tell this image from another of its size */
    struct palpate_flash_begin_answer begun;
    answer = ask(body, palpate_put_flash_begin(body, ++link_.id, &begin), GIVE_UP_MS, &n);
    if (!palpate_get_flash_begin_answer(answer, n, &begun)) fail("the answer is too short");
    for (uint32_t at = begun.received; at < size;) {
        uint32_t left = (uint32_t)size - at;
        struct palpate_flash_data piece = {at, image + at, left < PALPATE_FLASH_PIECE ? left : PALPATE_FLASH_PIECE};
        struct palpate_flash_data_answer taken;
        answer = ask(body, palpate_put_flash_data(body, ++link_.id, &piece), GIVE_UP_MS, &n);
        if (!palpate_get_flash_data_answer(answer, n, &taken)) fail("the answer is too short");
        at = taken.received;
    }
    struct palpate_flash_verify verify;
    memcpy(verify.name, begin.name, 8);
    struct palpate_flash_verify_answer ready;
    answer = ask(body, palpate_put_flash_verify(body, ++link_.id, &verify), VERIFY_MS, &n);
    if (!palpate_get_flash_verify_answer(answer, n, &ready)) fail("the answer is too short");
    struct palpate_flash_confirm confirm;
    memcpy(confirm.model_id, ready.model_id, 8);
    ask(body, palpate_put_flash_confirm(body, ++link_.id, &confirm), VERIFY_MS, &n);
    printf("flashed %u bytes\n", (unsigned)size);
}

static int open_link(const char *where) {
    const char *colon = strrchr(where, ':');
    if (where[0] == '/' || !colon) {
        struct termios raw;
        int fd = open(where, O_RDWR | O_NOCTTY);
        if (fd < 0 || tcgetattr(fd, &raw)) fail("the port cannot be opened");
        raw.c_iflag = raw.c_oflag = raw.c_lflag = 0; /* bytes, not lines: no echo, no translation */
        raw.c_cflag = CS8 | CREAD | CLOCAL;
        tcsetattr(fd, TCSANOW, &raw);
        return fd;
    }
    char host[256];
    struct addrinfo hints = {0}, *found;
    snprintf(host, sizeof host, "%.*s", (int)(colon - where), where);
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(host, colon + 1, &hints, &found)) fail("there is no such host");
    int fd = socket(found->ai_family, SOCK_STREAM, 0);
    if (fd < 0 || connect(fd, found->ai_addr, found->ai_addrlen)) fail("nothing listens there");
    freeaddrinfo(found);
    return fd;
}

int main(int argc, char **argv) {
    uint8_t body[64];
    const uint8_t *answer;
    size_t n;
    if (argc < 3 || argc > 4) {
        fprintf(stderr, "usage: client HOST:PORT|DEVICE STROKES [IMAGE.palp]\n");
        return 2;
    }
    link_.fd = open_link(argv[1]);
    link_.wanted = (uint32_t)strtoul(argv[2], NULL, 10);
    link_.id = (uint16_t)(now_ms() * 2654435761u >> 16); /* an old answer to an earlier host fits no new id */

    struct palpate_identify identify = {(uint32_t)now_ms() & (PALPATE_WRAP - 1)};
    struct palpate_identify_answer who;
    answer = ask(body, palpate_put_identify(body, ++link_.id, &identify), GIVE_UP_MS, &n);
    if (!palpate_get_identify_answer(answer, n, &who) || who.nonce != identify.nonce) fail("this is no probe");
    if (who.protocol != PALPATE_PROTOCOL) fail("the probe speaks another protocol");
    printf("serial ");
    for (int k = 0; k < 8; k++) printf("%02x", who.serial[k]);
    printf(" firmware %u.%u.%u model_status %d\n", who.firmware[0], who.firmware[1], who.firmware[2], who.model_status);
    if (argc == 4) flash(argv[3]);

    struct palpate_stream_start start = {PALPATE_CONTENT_FRAMES | PALPATE_CONTENT_STROKES, 1, 0, 0};
    struct palpate_stream_start_answer begun;
    answer = ask(body, palpate_put_stream_start(body, ++link_.id, &start), GIVE_UP_MS, &n);
    if (!palpate_get_stream_start_answer(answer, n, &begun)) fail("the answer is too short");
    link_.stream = begun.stream;
    link_.next_seq = begun.next_seq;
    int64_t renewed = now_ms(), heard = now_ms();
    while (link_.estimates < link_.wanted) {
        const uint8_t *event = next_body(now_ms() + 100, &n);
        if (event) {
            on_event(event, n);
            heard = now_ms();
        } else if (now_ms() - heard > SILENCE_MS) fail("no sign of the probe for a minute");
        if (now_ms() - renewed > RENEW_MS) { /* else the probe takes us for gone, and stops */
            struct palpate_stream_renew renew = {link_.stream};
            send_body(body, palpate_put_stream_renew(body, ++link_.id, &renew));
            renewed = now_ms();
        }
    }
    struct palpate_stream_stop_answer end;
    answer = ask(body, palpate_put_stream_stop(body, ++link_.id), GIVE_UP_MS, &n);
    if (!palpate_get_stream_stop_answer(answer, n, &end)) fail("the answer is too short");
    printf("frames %u lost %u damaged %u\n", (unsigned)link_.frames, (unsigned)link_.lost, link_.damaged);
    return 0;
}
