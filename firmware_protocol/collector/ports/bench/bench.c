#include "bench.h"

#include <string.h>

#define BENCH_POWERED 0x504F5745u
#define WATCHDOG_MS 1000u
#define UNLIMITED 0xFFFFFFFFu
#define CHECK_BYTES 1u
#define HEAD_BYTES 4u
#define LINK_BYTES 1024u

bench_memory *bench_persistent;
tl_collector bench_collector;
volatile bool bench_hangs;

static volatile uint32_t clock_us;
static volatile bool listening = true;
static volatile bool runs;
static volatile uint32_t fed_ms;
static uint32_t link_room = UNLIMITED;
static uint32_t reset_at = UNLIMITED;
/* Limits that a record has set, until the main loop takes them over. */
static volatile bool has_new_room;
static volatile bool has_new_reset;
static volatile uint32_t new_room;
static volatile uint32_t new_reset;
static tl_environment environments[TL_MAX_WHEELS];
static uint8_t link_bytes[LINK_BYTES];
static size_t link_size;

static uint16_t get_u16(const uint8_t *at) {
    return (uint16_t)(at[0] | at[1] << 8);
}

static uint32_t get_u32(const uint8_t *at) {
    return (uint32_t)get_u16(at) | (uint32_t)get_u16(at + 2) << 16;
}

static float get_f32(const uint8_t *at) {
    uint32_t bits = get_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The records of several lines arrive in any order; the clock only advances. */
static void advance_clock(uint32_t tick_us) {
    if (tick_us - clock_us < 0x80000000u) {
        clock_us = tick_us;
    }
}

static uint32_t noise(void) {
    uint32_t value = bench_persistent->noise;
    value ^= value << 13;
    value ^= value >> 17;
    value ^= value << 5;
    bench_persistent->noise = value;
    return value;
}

/* Hub: hub u8, wheels u8, has_key u8, battery u8, hub_id u64, supply_uw u32, supply_mv u16, rssi i8, pad, key[16]. */
static void provision_hub(const uint8_t *at) {
    bench_memory *memory = bench_persistent;
    tl_collector_config *hub = &memory->hub;
    hub->hub = at[0];
    hub->wheel_count = at[1];
    hub->key = at[2] != 0 ? memory->keys[TL_MAX_WHEELS] : NULL;
    hub->hub_id = (uint64_t)get_u32(at + 4) | (uint64_t)get_u32(at + 8) << 32;
    hub->firmware_major = 1;
    hub->wheels = memory->wheels;
    memory->status.battery_percent = at[3];
    memory->status.supply_uw = get_u32(at + 12);
    memory->status.supply_mv = get_u16(at + 16);
    memory->status.rssi_dbm = (int8_t)at[18];
    memcpy(memory->keys[TL_MAX_WHEELS], at + 20, TL_KEY_BYTES);
    memory->provisioned = hub->wheel_count >= 1 && hub->wheel_count <= TL_MAX_WHEELS;
}

/* Wheel: wheel u8, axes u8, coupling u8, has_key u8, sensor_id u32, saturation u16, pad u16, then f32: rate, highpass,
   3 ranges, 3 scales, 3 offsets, 4 supported rates, and key[16]. */
static void provision_wheel(size_t place, const uint8_t *at) {
    tl_wheel_config *wheel = &bench_persistent->wheels[place];
    const uint8_t *real = at + 12;
    wheel->wheel = at[0];
    wheel->axes = at[1];
    wheel->coupling = at[2];
    wheel->key = at[3] != 0 ? bench_persistent->keys[place] : NULL;
    wheel->sensor_id = get_u32(at + 4);
    wheel->saturation_counts = get_u16(at + 8);
    wheel->rate_hz = get_f32(real);
    wheel->highpass_hz = get_f32(real + 4);
    for (size_t i = 0; i < 3; i++) {
        wheel->range_mps2[i] = get_f32(real + 8 + 4 * i);
        wheel->scale_mps2[i] = get_f32(real + 20 + 4 * i);
        wheel->offset_counts[i] = get_f32(real + 32 + 4 * i);
    }
    for (size_t i = 0; i < BENCH_RATES; i++) {
        bench_persistent->rates_hz[place][i] = get_f32(real + 44 + 4 * i);
    }
    memcpy(bench_persistent->keys[place], real + 60, TL_KEY_BYTES);
}

static void set_counters(const uint8_t *at) {
    tl_collector *collector = &bench_collector;
    collector->hub.source.seq = get_u32(at);
    for (size_t i = 0; i < collector->wheel_count; i++) {
        collector->wheels[i].party.source.seq = get_u32(at);
        collector->wheels[i].taken = get_u32(at + 4);
    }
    collector->queue.frames_sent = get_u32(at + 8);
    collector->frames_dropped = get_u32(at + 12);
    collector->samples_dropped = get_u32(at + 16);
    clock_us = get_u32(at + 20);
}

static void take_samples(size_t place, const uint8_t *payload, size_t size) {
    int16_t counts[TL_BLOCK_COUNTS];
    size_t words = (size - 4u) / 2u;
    size_t channels = bench_collector.wheels[place].channels;
    uint32_t n = (uint32_t)(words / channels);
    if (words > TL_BLOCK_COUNTS) {
        return;
    }
    for (size_t i = 0; i < words; i++) {
        counts[i] = (int16_t)get_u16(payload + 4 + 2 * i);
    }
    uint32_t tick_us = get_u32(payload);
    tl_collector_put(&bench_collector, place, counts, n, tick_us);
    advance_clock(tick_us + (uint32_t)((float)n * 1e6f / bench_collector.wheels[place].hello.rate_hz));
}

static void take_environment(size_t place, const uint8_t *payload) {
    environments[place].pressure_pa = (int32_t)get_u32(payload + 4);
    environments[place].temperature_cdegc = (int16_t)get_u16(payload + 8);
    environments[place].supply_mv = get_u16(payload + 10);
    advance_clock(get_u32(payload));
}

static void break_flash(uint8_t how) {
    bench_persistent->flash_broken = how == 0;
    if (how == 2) {
        memset(bench_persistent->flash, 0xFF, sizeof bench_persistent->flash);
    }
}

static void take_control(uint8_t kind, const uint8_t *payload, size_t size) {
    switch (kind) {
    case BENCH_TIME:
        advance_clock(get_u32(payload));
        break;
    case BENCH_LISTEN:
        listening = payload[0] != 0;
        break;
    case BENCH_STALL:
        new_room = get_u32(payload);
        has_new_room = true;
        break;
    case BENCH_RESET_AT:
        new_reset = get_u32(payload);
        has_new_reset = true;
        break;
    case BENCH_CUT:
        bench_persistent->cut_steps = get_u32(payload);
        tl_port_reset();
    case BENCH_START:
        tl_port_reset();
    case BENCH_COUNTERS:
        set_counters(payload);
        break;
    case BENCH_HANG:
        bench_hangs = true;
        break;
    case BENCH_FLASH:
        break_flash(payload[0]);
        break;
    case BENCH_LINK:
        if (link_size + size <= sizeof link_bytes) {
            memcpy(link_bytes + link_size, payload, size);
            link_size += size;
        }
        break;
    default:
        break;
    }
}

/* Least payload of each kind; a shorter record is damaged. */
static size_t least_size(uint8_t kind) {
    switch (kind) {
    case BENCH_SAMPLES:
    case BENCH_TIME:
    case BENCH_STALL:
    case BENCH_RESET_AT:
    case BENCH_CUT:
        return 4;
    case BENCH_ENVIRONMENT:
        return 12;
    case BENCH_HUB:
        return 36;
    case BENCH_WHEEL:
        return 88;
    case BENCH_LISTEN:
    case BENCH_FLASH:
        return 1;
    case BENCH_COUNTERS:
        return 24;
    default:
        return 0;
    }
}

static void take_record(const uint8_t *record) {
    uint8_t kind = record[1];
    size_t place = record[2];
    size_t size = record[3];
    const uint8_t *payload = record + HEAD_BYTES;
    if (size < least_size(kind) || place >= TL_MAX_WHEELS) {
        return;
    }
    if (kind == BENCH_HUB) {
        provision_hub(payload);
    } else if (kind == BENCH_WHEEL) {
        provision_wheel(place, payload);
    } else if (kind != BENCH_SAMPLES && kind != BENCH_ENVIRONMENT) {
        take_control(kind, payload, size);
    } else if (runs && place < bench_collector.wheel_count) {
        if (kind == BENCH_SAMPLES) {
            take_samples(place, payload, size);
        } else {
            take_environment(place, payload);
        }
    }
}

void bench_take(bench_reader *reader, uint8_t byte) {
    if (reader->size == 0 && byte != BENCH_SYNC) {
        return;
    }
    reader->record[reader->size++] = byte;
    if (reader->size < HEAD_BYTES) {
        return;
    }
    size_t whole = HEAD_BYTES + (size_t)reader->record[3] + CHECK_BYTES;
    if (reader->size < whole) {
        return;
    }
    uint8_t sum = 0;
    for (size_t i = 1; i < whole - CHECK_BYTES; i++) {
        sum = (uint8_t)(sum + reader->record[i]);
    }
    reader->size = 0;
    if (sum == reader->record[whole - CHECK_BYTES]) {
        take_record(reader->record);
    }
}

void bench_start(void) {
    bench_memory *memory = bench_persistent;
    if (memory->powered != BENCH_POWERED) {
        memset(memory, 0, sizeof *memory);
        memset(memory->flash, 0xFF, sizeof memory->flash);
        memory->powered = BENCH_POWERED;
        memory->noise = 2463534242u;
    }
    clock_us = 0;
    listening = true;
    bench_hangs = false;
    link_room = UNLIMITED;
    reset_at = UNLIMITED;
    has_new_room = false;
    has_new_reset = false;
    link_size = 0;
    fed_ms = 0;
    for (size_t i = 0; i < TL_MAX_WHEELS; i++) {
        environments[i] = (tl_environment){TL_ENVIRONMENT_PRESSURE_PA_NONE, TL_ENVIRONMENT_TEMPERATURE_CDEGC_NONE,
                                           TL_ENVIRONMENT_SUPPLY_MV_NONE};
    }
    runs = false;
    runs = memory->provisioned && tl_collector_start(&bench_collector, &memory->hub);
}

bool bench_runs(void) {
    return runs;
}

bool bench_watchdog_expired(void) {
    fed_ms++;
    return runs && fed_ms > WATCHDOG_MS;
}

size_t bench_link_room(size_t size) {
    if (has_new_room) {
        has_new_room = false;
        link_room = new_room;
    }
    if (has_new_reset) {
        has_new_reset = false;
        reset_at = new_reset;
    }
    size_t room = link_room < reset_at ? link_room : reset_at;
    return size < room ? size : room;
}

void bench_link_took(size_t size) {
    link_room -= link_room == UNLIMITED ? 0u : (uint32_t)size;
    if (reset_at != UNLIMITED) {
        reset_at -= (uint32_t)size;
        if (reset_at == 0) {
            tl_port_reset();
        }
    }
}

size_t bench_link_received(uint8_t *data, size_t size) {
    size_t n = link_size < size ? link_size : size;
    memcpy(data, link_bytes, n);
    link_size -= n;
    memmove(link_bytes, link_bytes + n, link_size);
    return n;
}

/* The ports that are the same on host and board. */

uint32_t tl_port_clock_us(void) {
    return clock_us;
}

bool tl_port_listening(void) {
    return listening;
}

void tl_port_feed_watchdog(void) {
    fed_ms = 0;
}

uint32_t tl_port_random(void) {
    return noise();
}

void tl_port_environment(uint8_t wheel, tl_environment *environment) {
    for (size_t place = 0; place < bench_collector.wheel_count; place++) {
        if (bench_persistent->wheels[place].wheel == wheel) {
            *environment = environments[place];
        }
    }
}

void tl_port_hub_status(tl_hub_status *status) {
    *status = bench_persistent->status;
}

bool tl_port_set_rate(uint8_t wheel, float wanted_hz, float *rate_hz) {
    for (size_t place = 0; place < bench_collector.wheel_count; place++) {
        if (bench_persistent->wheels[place].wheel != wheel) {
            continue;
        }
        float nearest = *rate_hz;
        float least = -1.0f;
        for (size_t i = 0; i < BENCH_RATES; i++) {
            float rate = bench_persistent->rates_hz[place][i];
            float away = rate > wanted_hz ? rate - wanted_hz : wanted_hz - rate;
            if (rate > 0.0f && (least < 0.0f || away < least)) {
                nearest = rate;
                least = away;
            }
        }
        *rate_hz = nearest;
        return least >= 0.0f;
    }
    return false;
}

/* One step of writing the flash; the power may go at any of them, and leaves a byte with some of its bits. */
static bool power_goes(void) {
    uint32_t *steps = &bench_persistent->cut_steps;
    return *steps > 0 && --*steps == 0;
}

void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size) {
    memcpy(data, bench_persistent->flash[page] + at, size);
}

bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size) {
    uint8_t *place = bench_persistent->flash[page] + at;
    if (bench_persistent->flash_broken) {
        return false;
    }
    for (size_t i = 0; i < size; i++) {
        if (power_goes()) {
            place[i] &= (uint8_t)(data[i] | noise());
            tl_port_reset();
        }
        place[i] &= data[i]; /* a write only clears bits */
    }
    return true;
}

bool tl_port_flash_erase(unsigned page) {
    uint8_t *place = bench_persistent->flash[page];
    if (bench_persistent->flash_broken) {
        return false;
    }
    for (size_t i = 0; i < TL_BOOT_PAGE_BYTES; i++) {
        if (power_goes()) {
            /* An interrupted erasure leaves any bits anywhere behind it. */
            for (size_t k = i; k < TL_BOOT_PAGE_BYTES; k++) {
                place[k] |= (uint8_t)noise();
            }
            tl_port_reset();
        }
        place[i] = 0xFF;
    }
    return true;
}
