#include "tl_collector.h"

#include "tl_boot_count.h"
#include "tl_commands.h"
#include "tl_frames.h"

#include <string.h>

#define HELLO_PERIOD_US 2000000u
#define SECOND_US 1000000u
#define SAMPLES_HEADER_BYTES 6u
/* More frames than one poll makes. */
#define SEQ_RESERVE 4096u

static bool start_party(tl_party *party, uint8_t hub, uint8_t wheel, const uint8_t *key, uint64_t identity,
                        uint32_t boot_count) {
    party->source = (tl_source){hub, wheel, 0};
    party->has_key = key != NULL;
    if (key != NULL) {
        tl_signer_init(&party->signer, key, identity, boot_count);
    }
    return key != NULL;
}

static size_t channels_of(uint8_t axes) {
    return (size_t)((axes & 1u) + ((axes >> 1) & 1u) + ((axes >> 2) & 1u));
}

/* Starts a wheel; `frame` is room for its first hello, which is encoded to check the configuration. */
static bool start_wheel(tl_wheel *wheel, uint8_t *frame, const tl_wheel_config *config, const tl_collector_config *hub,
                        uint32_t boot_count, bool signs) {
    tl_hello *hello = &wheel->hello;
    hello->protocol_major = TL_VERSION_MAJOR;
    hello->protocol_minor = TL_VERSION_MINOR;
    hello->firmware_major = hub->firmware_major;
    hello->firmware_minor = hub->firmware_minor;
    hello->firmware_patch = hub->firmware_patch;
    hello->axes = config->axes;
    hello->coupling = config->coupling;
    hello->hub_id = hub->hub_id;
    hello->sensor_id = config->sensor_id;
    hello->boot_count = boot_count;
    hello->rate_hz = config->rate_hz;
    hello->highpass_hz = config->highpass_hz;
    memcpy(hello->range_mps2, config->range_mps2, sizeof hello->range_mps2);
    memcpy(hello->scale_mps2, config->scale_mps2, sizeof hello->scale_mps2);
    memcpy(hello->offset_counts, config->offset_counts, sizeof hello->offset_counts);
    hello->saturation_counts = config->saturation_counts;
    const uint8_t *key = signs ? config->key : NULL;
    (void)start_party(&wheel->party, hub->hub, config->wheel, key, config->sensor_id, boot_count);
    tl_source probe = wheel->party.source;
    if (tl_encode_hello(frame, &probe, 0, hello) == 0) {
        return false;
    }
    wheel->channels = channels_of(config->axes);
    size_t payload = key != NULL ? TL_MAX_SIGNED_PAYLOAD_BYTES : TL_MAX_PAYLOAD_BYTES;
    wheel->samples_per_frame = (payload - SAMPLES_HEADER_BYTES) / (2u * wheel->channels);
    wheel->streaming = true;
    wheel->hello_due = true;
    atomic_store(&wheel->accepting, true);
    return true;
}

bool tl_collector_start(tl_collector *collector, const tl_collector_config *config) {
    memset(collector, 0, sizeof *collector);
    if (config->wheel_count == 0 || config->wheel_count > TL_MAX_WHEELS) {
        return false;
    }
    uint32_t boot_count = 0;
    collector->boot_fault = !tl_boot_count_next(&boot_count);
    if (collector->boot_fault) {
        boot_count = tl_port_random();
    }
    bool signs = !collector->boot_fault;
    collector->keyed = config->key != NULL;
    (void)start_party(&collector->hub, config->hub, TL_WHEEL_HUB_ITSELF, signs ? config->key : NULL, config->hub_id,
                      boot_count);
    for (size_t i = 0; i < config->wheel_count; i++) {
        collector->keyed = collector->keyed || config->wheels[i].key != NULL;
        if (!start_wheel(&collector->wheels[i], collector->queue.frames[0], &config->wheels[i], config, boot_count,
                         signs)) {
            return false;
        }
    }
    collector->wheel_count = config->wheel_count;
    collector->clock_us = tl_port_clock_us();
    collector->now_us = collector->clock_us;
    collector->hello_due_us = collector->now_us;
    collector->second_due_us = collector->now_us;
    collector->refused_log_us = collector->now_us;
    return true;
}

void tl_collector_put(tl_collector *collector, size_t place, const int16_t *counts, uint32_t n, uint32_t tick_us) {
    tl_wheel *wheel = &collector->wheels[place];
    bool accepted = atomic_load(&wheel->accepting);
    if (accepted && atomic_exchange(&wheel->renumbers, false)) {
        wheel->taken = 0;
    }
    tl_block head = {.first_sample = wheel->taken, .tick_us = tick_us, .n = n};
    wheel->taken += n;
    if (!accepted || !tl_ring_put(&wheel->ring, &head, counts, n * wheel->channels)) {
        atomic_fetch_add(&wheel->lost, n);
    }
}

/* The room for a frame of a party, or NULL after counting the loss: its number is used, so that the loss shows. */
static uint8_t *room_for(tl_collector *collector, tl_party *party, uint32_t reserved) {
    uint8_t *frame = tl_transmit_room(&collector->queue, reserved);
    if (frame == NULL) {
        party->source.seq++;
        collector->frames_dropped++;
    }
    return frame;
}

static void queue_frame(tl_collector *collector, const tl_party *party, uint8_t *frame, size_t size) {
    if (size > 0 && party->has_key) {
        size = tl_sign(frame, &party->signer);
    }
    if (size > 0) {
        tl_transmit_add(&collector->queue, size);
    }
}

static uint32_t tick(const tl_collector *collector) {
    return (uint32_t)(collector->now_us & 0xFFFFFFFFu);
}

void tl_frames_samples(tl_collector *collector, tl_wheel *wheel) {
    if (wheel->filled == 0) {
        return;
    }
    uint8_t *frame = room_for(collector, &wheel->party, TL_QUEUE_RESERVED);
    if (frame == NULL) {
        collector->samples_dropped += wheel->filled;
    } else {
        tl_samples samples = {wheel->first_sample, wheel->hello.axes, (uint8_t)wheel->filled, wheel->counts};
        size_t size = tl_encode_samples(frame, &wheel->party.source, wheel->first_tick_us, &samples);
        queue_frame(collector, &wheel->party, frame, size);
    }
    wheel->filled = 0;
}

/* A hello that finds no room waits; it is not lost. */
static void send_hello(tl_collector *collector, tl_wheel *wheel) {
    uint8_t *frame = tl_transmit_room(&collector->queue, 0);
    if (frame != NULL) {
        size_t size = tl_encode_hello(frame, &wheel->party.source, tick(collector), &wheel->hello);
        queue_frame(collector, &wheel->party, frame, size);
    }
    wheel->hello_due = frame == NULL;
}

static void send_environment(tl_collector *collector, tl_wheel *wheel) {
    tl_environment environment = {TL_ENVIRONMENT_PRESSURE_PA_NONE, TL_ENVIRONMENT_TEMPERATURE_CDEGC_NONE,
                                  TL_ENVIRONMENT_SUPPLY_MV_NONE};
    tl_port_environment(wheel->party.source.wheel, &environment);
    uint8_t *frame = room_for(collector, &wheel->party, 0);
    if (frame != NULL) {
        size_t size = tl_encode_environment(frame, &wheel->party.source, tick(collector), &environment);
        queue_frame(collector, &wheel->party, frame, size);
    }
}

static void send_status(tl_collector *collector) {
    tl_hub_status status = {.battery_percent = TL_HUB_STATUS_BATTERY_PERCENT_NONE,
                            .rssi_dbm = TL_HUB_STATUS_RSSI_DBM_NONE};
    tl_port_hub_status(&status);
    status.uptime_s = (uint32_t)(collector->now_us / SECOND_US);
    status.frames_sent = collector->queue.frames_sent;
    status.frames_dropped = collector->frames_dropped;
    status.samples_dropped = collector->samples_dropped;
    uint8_t *frame = room_for(collector, &collector->hub, 0);
    if (frame != NULL) {
        size_t size = tl_encode_hub_status(frame, &collector->hub.source, tick(collector), &status);
        queue_frame(collector, &collector->hub, frame, size);
    }
}

static void send_time(tl_collector *collector) {
    tl_time_sync time = {collector->now_us, collector->host_ns};
    uint8_t *frame = room_for(collector, &collector->hub, 0);
    if (frame != NULL) {
        size_t size = tl_encode_time_sync(frame, &collector->hub.source, tick(collector), &time);
        queue_frame(collector, &collector->hub, frame, size);
    }
}

void tl_frames_result(tl_collector *collector, const tl_command_result *result) {
    uint8_t *frame = room_for(collector, &collector->hub, 0);
    if (frame != NULL) {
        size_t size = tl_encode_command_result(frame, &collector->hub.source, tick(collector), result);
        queue_frame(collector, &collector->hub, frame, size);
    }
}

void tl_frames_challenge_answer(tl_collector *collector, const tl_challenge_answer *answer) {
    uint8_t *frame = room_for(collector, &collector->hub, 0);
    if (frame != NULL) {
        size_t size = tl_encode_challenge_answer(frame, &collector->hub.source, tick(collector), answer);
        queue_frame(collector, &collector->hub, frame, size);
    }
}

void tl_collector_log(tl_collector *collector, uint8_t level, const char *text) {
    uint8_t *frame = room_for(collector, &collector->hub, TL_QUEUE_RESERVED);
    if (frame != NULL) {
        tl_log_text line = {level, text, strlen(text)};
        size_t size = tl_encode_log_text(frame, &collector->hub.source, tick(collector), &line);
        queue_frame(collector, &collector->hub, frame, size);
    }
}

/* The tick of sample `offset` of a block. */
static uint32_t tick_of(const tl_wheel *wheel, const tl_block *block, uint32_t offset) {
    return block->tick_us + (uint32_t)((float)offset * 1e6f / wheel->hello.rate_hz + 0.5f);
}

static void frame_block(tl_collector *collector, tl_wheel *wheel, const tl_block *block) {
    if (wheel->filled > 0 && wheel->first_sample + wheel->filled != block->first_sample) {
        tl_frames_samples(collector, wheel);
    }
    for (uint32_t at = 0; at < block->n;) {
        if (wheel->filled == 0) {
            wheel->first_sample = block->first_sample + at;
            wheel->first_tick_us = tick_of(wheel, block, at);
        }
        uint32_t room = (uint32_t)wheel->samples_per_frame - wheel->filled;
        uint32_t n = block->n - at < room ? block->n - at : room;
        memcpy(wheel->counts + wheel->filled * wheel->channels, block->counts + at * wheel->channels,
               n * wheel->channels * sizeof *wheel->counts);
        wheel->filled += n;
        at += n;
        if (wheel->filled == wheel->samples_per_frame) {
            tl_frames_samples(collector, wheel);
        }
    }
}

void tl_frames_blocks(tl_collector *collector, tl_wheel *wheel) {
    const tl_block *block;
    while ((block = tl_ring_oldest(&wheel->ring)) != NULL) {
        if (collector->listening && wheel->streaming) {
            frame_block(collector, wheel, block);
        }
        tl_ring_release(&wheel->ring);
    }
    uint32_t lost = atomic_load(&wheel->lost);
    if (collector->listening && wheel->streaming) {
        collector->samples_dropped += lost - wheel->lost_seen;
    }
    wheel->lost_seen = lost;
}

static void watch_listener(tl_collector *collector) {
    bool listening = tl_port_listening();
    if (listening && !collector->listening) {
        collector->received_size = 0;
        collector->hello_due_us = collector->now_us;
        collector->second_due_us = collector->now_us;
    }
    if (!listening && collector->listening) {
        collector->frames_dropped += tl_transmit_clear(&collector->queue);
        for (size_t i = 0; i < collector->wheel_count; i++) {
            collector->wheels[i].filled = 0;
        }
    }
    collector->listening = listening;
}

/* Whether `period_us` has passed; a late caller does not catch up. */
static bool is_due(uint64_t now_us, uint64_t *due_us, uint32_t period_us) {
    if (now_us < *due_us) {
        return false;
    }
    *due_us += period_us;
    if (*due_us <= now_us) {
        *due_us = now_us + period_us;
    }
    return true;
}

static void greet(tl_collector *collector) {
    bool all = is_due(collector->now_us, &collector->hello_due_us, HELLO_PERIOD_US);
    for (size_t i = 0; i < collector->wheel_count; i++) {
        if (all || collector->wheels[i].hello_due) {
            send_hello(collector, &collector->wheels[i]);
        }
    }
}

static void keep_schedule(tl_collector *collector) {
    if (!is_due(collector->now_us, &collector->second_due_us, SECOND_US)) {
        return;
    }
    for (size_t i = 0; i < collector->wheel_count; i++) {
        send_environment(collector, &collector->wheels[i]);
    }
    send_status(collector);
    send_time(collector);
    if (collector->boot_fault) {
        tl_collector_log(collector, TL_LOG_ERROR, "boot count not stored: frames are not signed");
    }
    tl_commands_each_second(collector);
}

static bool ends(const tl_party *party) {
    return party->has_key && party->source.seq > UINT32_MAX - SEQ_RESERVE;
}

/* (boot_count, seq) must not repeat under a key: a new start gives a new boot_count. */
static void restart_before_wrap(const tl_collector *collector) {
    bool restarts = ends(&collector->hub);
    for (size_t i = 0; i < collector->wheel_count; i++) {
        restarts = restarts || ends(&collector->wheels[i].party);
    }
    if (restarts) {
        tl_port_reset();
    }
}

void tl_collector_poll(tl_collector *collector) {
    uint32_t clock_us = tl_port_clock_us();
    collector->now_us += (uint32_t)(clock_us - collector->clock_us);
    collector->clock_us = clock_us;
    watch_listener(collector);
    if (collector->listening) {
        greet(collector);
        keep_schedule(collector);
        tl_commands_receive(collector);
        greet(collector); /* a new rate precedes the samples taken at it */
    }
    for (size_t i = 0; i < collector->wheel_count; i++) {
        tl_frames_blocks(collector, &collector->wheels[i]);
    }
    tl_transmit_run(&collector->queue);
    restart_before_wrap(collector);
    tl_port_feed_watchdog();
}
