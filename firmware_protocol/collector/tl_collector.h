/* Reference collector: frames the samples of several wheels, keeps the schedule of the other messages, and carries out
   commands. No heap, no operating system. Sensor interrupts call tl_collector_put; everything else runs in the main
   loop through tl_collector_poll. */
#ifndef TL_COLLECTOR_H
#define TL_COLLECTOR_H

#include "tl_block_ring.h"
#include "tl_port.h"
#include "tl_transmit.h"
#include "treadlink_protocol.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef TL_MAX_WHEELS
#define TL_MAX_WHEELS 4u
#endif

#define TL_KEY_BYTES 16u

/* One wheel. Keys are AES-128 keys; NULL where frames are not signed. */
typedef struct {
    uint8_t wheel; /* number of the wheel at this hub, 0 to 254 */
    uint8_t axes;
    uint8_t coupling;
    uint32_t sensor_id;
    float rate_hz;
    float highpass_hz;
    float range_mps2[3];
    float scale_mps2[3];
    float offset_counts[3];
    uint16_t saturation_counts;
    const uint8_t *key;
} tl_wheel_config;

typedef struct {
    uint8_t hub; /* number of the hub on its link */
    uint64_t hub_id;
    uint8_t firmware_major;
    uint8_t firmware_minor;
    uint16_t firmware_patch;
    const uint8_t *key;
    const tl_wheel_config *wheels;
    size_t wheel_count; /* 1 to TL_MAX_WHEELS */
} tl_collector_config;

/* One source of frames and addressee of commands: a wheel or the hub itself. */
typedef struct {
    tl_source source;
    tl_signer signer;
    bool has_key;
    uint32_t highest_command; /* counter of the last signed command or challenge since the start, 0 before */
} tl_party;

typedef struct {
    tl_party party;
    tl_hello hello;
    size_t channels;
    size_t samples_per_frame;
    bool streaming;
    bool hello_due;
    uint32_t lost_seen;
    /* The frame being filled. */
    uint32_t filled;
    uint32_t first_sample;
    uint32_t first_tick_us;
    int16_t counts[TL_MAX_SAMPLES];
    /* Written by the interrupt. */
    tl_block_ring ring;
    uint32_t taken;
    atomic_uint lost;
    atomic_bool accepting;
    atomic_bool renumbers; /* the next sample has number 0 */
} tl_wheel;

typedef struct {
    tl_party hub;
    tl_wheel wheels[TL_MAX_WHEELS];
    size_t wheel_count;
    bool keyed;      /* some party has a key: every command must be signed */
    bool boot_fault; /* the boot count could not be stored: nothing is signed, no command accepted where keys are set */
    bool listening;
    uint32_t clock_us;
    uint64_t now_us;
    uint64_t hello_due_us;
    uint64_t second_due_us;
    uint64_t host_ns;
    uint32_t frames_dropped;
    uint32_t samples_dropped;
    tl_transmit_queue queue;
    /* Commands. */
    uint8_t received[TL_MAX_FRAME_BYTES];
    size_t received_size;
    uint64_t received_us;
    uint32_t answers_left; /* refusals that may still be answered this second */
    uint32_t refused;      /* commands refused since the start because they were not verified or repeated */
    uint32_t refused_logged;
    uint64_t refused_log_us;
} tl_collector;

/* Starts. The configuration and what it points to must stay. False when it is not valid. */
bool tl_collector_start(tl_collector *collector, const tl_collector_config *config);

/* Takes n consecutive samples of a wheel, by its place in the configuration: n rows of the raw words of its axes, in
   ascending order of the axes. `tick_us` is tl_port_clock_us at the first sample. Call it from the interrupt of the
   sensor's FIFO or DMA. Samples that find no room are counted, and show as a gap in first_sample. */
void tl_collector_put(tl_collector *collector, size_t place, const int16_t *counts, uint32_t n, uint32_t tick_us);

/* Does what is due. Call it in the main loop, at least every 10 ms; it returns without waiting. */
void tl_collector_poll(tl_collector *collector);

/* Sends a line of log by the hub itself: level TL_LOG_..., text of at most 200 bytes of UTF-8. */
void tl_collector_log(tl_collector *collector, uint8_t level, const char *text);

#endif
