/* The test bench's side of both ports: records of the simulated sensors, provisioning, and faults on request. */
#ifndef TL_BENCH_H
#define TL_BENCH_H

#include "tl_boot_count.h"
#include "tl_collector.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BENCH_SYNC 0xC3u
#define BENCH_RATES 4u

/* Kinds of records: sync, kind, place of the wheel, length, payload, checksum (sum of the bytes after sync). */
enum {
    BENCH_SAMPLES = 1,     /* tick_us u32 of the first, then the raw words */
    BENCH_ENVIRONMENT = 2, /* tick_us u32, pressure i32, temperature i16, supply u16 */
    BENCH_TIME = 3,        /* tick_us u32 */
    BENCH_HUB = 4,         /* see bench.c */
    BENCH_WHEEL = 5,
    BENCH_START = 6,
    BENCH_LISTEN = 16,   /* u8 */
    BENCH_STALL = 17,    /* u32: the link takes this many more bytes, then none; 0xFFFFFFFF: all */
    BENCH_RESET_AT = 18, /* u32: restart when the link has taken this many more bytes */
    BENCH_CUT = 19,      /* u32: restart, and cut the power at this step of writing the flash */
    BENCH_COUNTERS = 20, /* u32 each: seq, first_sample, frames sent, frames dropped, samples dropped, clock_us */
    BENCH_HANG = 21,     /* the main loop stops: the watchdog must restart the chip */
    BENCH_LINK = 22,     /* bytes that arrive from the gateway, where the link itself cannot bring them */
    BENCH_FLASH = 23,    /* u8: 0 breaks the flash, 1 repairs it, 2 erases it */
};

/* What survives a restart: the flash, the provisioning, and faults that wait. Zero when power first comes on. */
typedef struct {
    uint32_t powered; /* BENCH_POWERED once the flash has been erased by the factory */
    uint8_t flash[2][TL_BOOT_PAGE_BYTES];
    tl_collector_config hub;
    tl_wheel_config wheels[TL_MAX_WHEELS];
    uint8_t keys[TL_MAX_WHEELS + 1u][TL_KEY_BYTES];
    float rates_hz[TL_MAX_WHEELS][BENCH_RATES];
    tl_hub_status status;
    bool provisioned;
    bool flash_broken;
    uint32_t cut_steps; /* steps of the flash until a power cut, 0 for none */
    uint32_t noise;     /* state of the random numbers */
} bench_memory;

/* Reader of one serial line of a sensor. */
typedef struct {
    uint8_t record[4u + 255u + 1u];
    size_t size;
} bench_reader;

extern bench_memory *bench_persistent; /* set by the port */
extern tl_collector bench_collector;
extern volatile bool bench_hangs;

/* Starts the collector if it has been provisioned. */
void bench_start(void);
/* Whether the collector runs. */
bool bench_runs(void);
/* Takes one byte of a sensor's line; from the interrupt on a board. */
void bench_take(bench_reader *reader, uint8_t byte);
/* Of `size` bytes, the number that the stalled or resetting link may take now. */
size_t bench_link_room(size_t size);
/* Notes bytes that the link took; may restart. */
void bench_link_took(size_t size);
/* Counts the main loop out: true when the watchdog has expired. Call it once a ms. */
bool bench_watchdog_expired(void);

/* Bytes of BENCH_LINK records, for tl_port_receive. */
size_t bench_link_received(uint8_t *data, size_t size);

#endif
