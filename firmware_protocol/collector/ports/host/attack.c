/* Forged, changed, replayed and reordered commands, N in all (argument): none may be carried out, while every genuine
   command between them is. Prints the counts of each kind. */
#include "bench.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FIRST_START 41u
#define HEARD 256u
#define EVERY 100u /* attacks between two genuine commands */

enum { FORGED, CHANGED, REPLAYED, REORDERED, OTHER_START, OTHER_KEY, NOT_SIGNED, REFLECTED, KINDS };
static const char *const names[KINDS] = {
    "forged",          "changed",           "replayed",   "reordered",
    "earlier start",   "another key",       "not signed", "reflected frame of the hub",
};

static bench_memory memory;
static uint8_t incoming[TL_MAX_FRAME_BYTES];
static size_t incoming_size;
static uint8_t outgoing[TL_MAX_FRAME_BYTES];
static size_t outgoing_size;
static unsigned long done;

size_t tl_port_send(const uint8_t *data, size_t size) {
    memcpy(outgoing, data, size);
    outgoing_size = size;
    if (data[3] == TL_TYPE_COMMAND_RESULT && data[TL_HEADER_BYTES + 5u] == TL_OUTCOME_DONE) {
        done++;
    }
    return size;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    size_t n = incoming_size < size ? incoming_size : size;
    memcpy(data, incoming, n);
    incoming_size = 0;
    return n;
}

_Noreturn void tl_port_reset(void) {
    exit(2);
}

static uint32_t number(void) {
    static uint64_t state = 88172645463325252u;
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (uint32_t)(state >> 32);
}

/* Gives a changed frame its right CRC. */
static void seal(uint8_t *frame, size_t size) {
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < size - TL_CRC_BYTES; i++) {
        crc ^= frame[i];
        for (unsigned bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    crc ^= 0xFFFFFFFFu;
    for (size_t i = 0; i < TL_CRC_BYTES; i++) {
        frame[size - TL_CRC_BYTES + i] = (uint8_t)(crc >> (8u * i));
    }
}

static size_t command(uint8_t *frame, uint32_t seq, const tl_signer *signer, bool hostile) {
    tl_source source = {0, TL_WHEEL_HUB_ITSELF, seq};
    size_t size;
    if (hostile || number() % 2u == 0) {
        tl_set_stream stop = {hostile ? 0u : 1u};
        size = tl_encode_set_stream(frame, &source, 0, &stop);
    } else {
        tl_set_time time = {seq};
        size = tl_encode_set_time(frame, &source, 0, &time);
    }
    return signer == NULL ? size : tl_sign(frame, signer);
}

static void deliver(const uint8_t *frame, size_t size) {
    memcpy(incoming, frame, size);
    incoming_size = size;
    tl_collector_poll(&bench_collector);
}

int main(int argc, char **argv) {
    unsigned long wanted = argc > 1 ? strtoul(argv[1], NULL, 10) : 1000000u;
    static uint8_t heard[HEARD][TL_MAX_FRAME_BYTES];
    static size_t heard_size[HEARD];
    unsigned long sent[KINDS] = {0};
    unsigned long carried[KINDS] = {0};
    unsigned long genuine = 0;
    bench_persistent = &memory;
    bench_start();
    for (size_t i = 0; i < TL_KEY_BYTES; i++) {
        memory.keys[0][i] = (uint8_t)number();
        memory.keys[TL_MAX_WHEELS][i] = (uint8_t)number();
    }
    memory.wheels[0] = (tl_wheel_config){.axes = 7, .sensor_id = 0xA001, .rate_hz = 9600.0f, .saturation_counts = 32767,
                                         .key = memory.keys[0]};
    memory.hub = (tl_collector_config){.hub_id = 77, .key = memory.keys[TL_MAX_WHEELS], .wheels = memory.wheels,
                                       .wheel_count = 1};
    memory.provisioned = true;
    for (unsigned i = 0; i < FIRST_START; i++) {
        bench_start();
    }
    tl_signer now;
    tl_signer before;
    tl_signer other;
    tl_signer_init(&now, memory.keys[TL_MAX_WHEELS], 77, FIRST_START);
    tl_signer_init(&before, memory.keys[TL_MAX_WHEELS], 77, FIRST_START - 1u);
    tl_signer_init(&other, memory.keys[0], 77, FIRST_START);
    uint32_t seq = 1000;
    for (unsigned long i = 0; i < wanted; i++) {
        uint8_t frame[TL_MAX_FRAME_BYTES];
        size_t size;
        if (i % EVERY == 0) {
            seq += 1u + number() % 5u;
            size = command(frame, seq, &now, false);
            memcpy(heard[genuine % HEARD], frame, size);
            heard_size[genuine % HEARD] = size;
            genuine++;
            deliver(frame, size);
        }
        unsigned kind = (unsigned)(i % KINDS);
        unsigned long before_it = done;
        size = command(frame, seq + 1u, kind == OTHER_START ? &before : kind == OTHER_KEY ? &other : &now, true);
        if (kind == FORGED) {
            for (size_t k = 0; k < TL_TAG_BYTES; k++) {
                frame[size - TL_CRC_BYTES - TL_TAG_BYTES + k] = (uint8_t)number();
            }
            seal(frame, size);
        } else if (kind == CHANGED) {
            size_t bit = 8u * 5u + number() % (8u * (size - TL_CRC_BYTES - 5u)); /* behind sync, version, type, length */
            frame[bit / 8u] ^= (uint8_t)(1u << (bit % 8u));
            seal(frame, size);
        } else if (kind == REPLAYED) {
            size_t old = number() % (genuine < HEARD ? genuine : HEARD);
            size = heard_size[old];
            memcpy(frame, heard[old], size);
        } else if (kind == REORDERED) {
            size = command(frame, seq - number() % 500u, &now, true);
        } else if (kind == NOT_SIGNED) {
            size = command(frame, seq + 1u, NULL, true);
        } else if (kind == REFLECTED && outgoing_size > 0) {
            size = outgoing_size;
            memcpy(frame, outgoing, size);
            frame[3] = TL_TYPE_SET_STREAM;
            seal(frame, size);
        }
        deliver(frame, size);
        sent[kind]++;
        carried[kind] += done - before_it;
    }
    unsigned long all = 0;
    unsigned long passed = 0;
    for (unsigned kind = 0; kind < KINDS; kind++) {
        printf("%-28s %8lu sent %4lu carried out\n", names[kind], sent[kind], carried[kind]);
        all += sent[kind];
        passed += carried[kind];
    }
    unsigned long executed = done - passed;
    printf("%-28s %8lu sent %4lu carried out\n", "all of these", all, passed);
    printf("%-28s %8lu sent %4lu carried out\n", "genuine, between them", genuine, executed);
    return passed == 0 && executed == genuine && bench_collector.wheels[0].streaming ? 0 : 1;
}
