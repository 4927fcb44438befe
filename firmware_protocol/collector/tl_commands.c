#include "tl_commands.h"

#include "tl_frames.h"

#include <string.h>

#define FIRST_COMMAND 32u
/* A damaged header can claim bytes that never come; a whole frame takes 21 ms at 115,200 baud. */
#define INCOMPLETE_US 100000u
/* An attacker must not make the hub answer without limit. */
#define ANSWERS_PER_SECOND 10u
#define LOG_PERIOD_US 10000000u

static uint32_t seq_of(const uint8_t *frame) {
    return (uint32_t)frame[8] | (uint32_t)frame[9] << 8 | (uint32_t)frame[10] << 16 | (uint32_t)frame[11] << 24;
}

static void answer(tl_collector *collector, uint32_t seq, uint8_t command, uint8_t outcome) {
    tl_command_result result = {seq, command, outcome};
    tl_frames_result(collector, &result);
}

static void refuse(tl_collector *collector, uint32_t seq, uint8_t command, uint8_t outcome) {
    collector->refused++;
    if (collector->answers_left > 0) {
        collector->answers_left--;
        answer(collector, seq, command, outcome);
    }
}

static bool is_addressed(const tl_wheel *wheel, uint8_t number) {
    return number == TL_WHEEL_HUB_ITSELF || number == wheel->party.source.wheel;
}

static tl_party *party_of(tl_collector *collector, uint8_t number) {
    if (number == TL_WHEEL_HUB_ITSELF) {
        return &collector->hub;
    }
    for (size_t i = 0; i < collector->wheel_count; i++) {
        if (collector->wheels[i].party.source.wheel == number) {
            return &collector->wheels[i].party;
        }
    }
    return NULL;
}

/* Whether a command may be carried out. With keys: it is signed by the addressee's key, and new. */
static bool admit(tl_collector *collector, uint8_t *frame) {
    tl_party *party = party_of(collector, frame[6]);
    uint32_t seq = seq_of(frame);
    if (!collector->keyed && frame[7] == 0) {
        return true;
    }
    if (party == NULL || !party->has_key || !tl_verify(frame, &party->signer)) {
        refuse(collector, seq, frame[3], TL_OUTCOME_NOT_VERIFIED);
        return false;
    }
    if (seq <= party->highest_command) {
        refuse(collector, party->highest_command, frame[3], TL_OUTCOME_REPEATED);
        return false;
    }
    party->highest_command = seq;
    return true;
}

static uint8_t set_stream(tl_collector *collector, const uint8_t *frame) {
    tl_set_stream command;
    if (!tl_decode_set_stream(frame, &command)) {
        return TL_OUTCOME_VALUE_REFUSED;
    }
    uint8_t outcome = TL_OUTCOME_FAILED;
    for (size_t i = 0; i < collector->wheel_count; i++) {
        tl_wheel *wheel = &collector->wheels[i];
        if (is_addressed(wheel, frame[6])) {
            tl_frames_blocks(collector, wheel);
            tl_frames_samples(collector, wheel);
            wheel->streaming = command.running == 1u;
            outcome = TL_OUTCOME_DONE;
        }
    }
    return outcome;
}

static uint8_t set_rate(tl_collector *collector, const uint8_t *frame) {
    tl_set_rate command;
    if (!tl_decode_set_rate(frame, &command)) {
        return TL_OUTCOME_VALUE_REFUSED;
    }
    bool found = false;
    bool failed = false;
    for (size_t i = 0; i < collector->wheel_count; i++) {
        tl_wheel *wheel = &collector->wheels[i];
        if (!is_addressed(wheel, frame[6])) {
            continue;
        }
        found = true;
        /* Samples taken meanwhile belong to neither rate: they are counted as dropped. */
        atomic_store(&wheel->accepting, false);
        tl_frames_blocks(collector, wheel);
        tl_frames_samples(collector, wheel);
        float rate_hz = wheel->hello.rate_hz;
        if (!tl_port_set_rate(frame[6] == TL_WHEEL_HUB_ITSELF ? wheel->party.source.wheel : frame[6],
                              command.rate_hz, &rate_hz)) {
            failed = true;
        } else if (rate_hz != wheel->hello.rate_hz) {
            wheel->hello.rate_hz = rate_hz;
            wheel->hello_due = true;
            atomic_store(&wheel->renumbers, true);
        }
        atomic_store(&wheel->accepting, true);
    }
    return found && !failed ? TL_OUTCOME_DONE : TL_OUTCOME_FAILED;
}

static uint8_t set_time(tl_collector *collector, const uint8_t *frame) {
    tl_set_time command;
    if (!tl_decode_set_time(frame, &command)) {
        return TL_OUTCOME_VALUE_REFUSED;
    }
    collector->host_ns = command.host_ns;
    return TL_OUTCOME_DONE;
}

/* Proves to a gateway which start this is. It takes a counter, so that commands signed before it are no longer new. */
static void answer_challenge(tl_collector *collector, const uint8_t *frame) {
    tl_challenge challenge;
    tl_party *hub = &collector->hub;
    if (collector->answers_left == 0 || !tl_decode_challenge(frame, &challenge)) {
        return;
    }
    collector->answers_left--;
    if (hub->highest_command < UINT32_MAX) {
        hub->highest_command++;
    }
    tl_challenge_answer sent = {challenge.nonce, hub->signer.boot_count, hub->highest_command};
    tl_frames_challenge_answer(collector, &sent);
}

static void take(tl_collector *collector, uint8_t *frame) {
    bool readable = frame[2] == TL_VERSION_BYTE && (frame[7] & ~TL_FLAG_SIGNED) == 0;
    bool ours = frame[5] == collector->hub.source.hub || frame[5] == TL_EVERY_HUB;
    if (frame[3] < FIRST_COMMAND || !readable || !ours) {
        return;
    }
    if (frame[3] == TL_TYPE_CHALLENGE && frame[7] == 0 && collector->hub.has_key) {
        answer_challenge(collector, frame);
        return;
    }
    if (!admit(collector, frame)) {
        return;
    }
    uint8_t outcome = TL_OUTCOME_UNKNOWN_COMMAND;
    switch (frame[3]) {
    case TL_TYPE_SET_STREAM:
        outcome = set_stream(collector, frame);
        break;
    case TL_TYPE_SET_RATE:
        outcome = set_rate(collector, frame);
        break;
    case TL_TYPE_SET_TIME:
        outcome = set_time(collector, frame);
        break;
    default:
        break;
    }
    answer(collector, seq_of(frame), frame[3], outcome);
}

static void drop_received(tl_collector *collector, size_t size) {
    collector->received_size -= size;
    memmove(collector->received, collector->received + size, collector->received_size);
}

/* Drops the first byte and all up to the next possible begin of a frame. */
static void resynchronise(tl_collector *collector) {
    const uint8_t *next = memchr(collector->received + 1, (int)TL_SYNC_0, collector->received_size - 1u);
    drop_received(collector, next == NULL ? collector->received_size : (size_t)(next - collector->received));
}

void tl_commands_receive(tl_collector *collector) {
    size_t free_bytes = sizeof collector->received - collector->received_size;
    size_t fresh = tl_port_receive(collector->received + collector->received_size, free_bytes);
    collector->received_size += fresh;
    if (fresh > 0) {
        collector->received_us = collector->now_us;
    } else if (collector->received_size > 0 && collector->now_us - collector->received_us > INCOMPLETE_US) {
        collector->received_us = collector->now_us;
        resynchronise(collector);
    }
    while (collector->received_size > 0) {
        size_t size = 0;
        tl_verdict verdict = tl_check(collector->received, collector->received_size, &size);
        if (verdict == TL_INCOMPLETE) {
            return;
        }
        if (verdict == TL_INTACT) {
            take(collector, collector->received);
            drop_received(collector, size);
        } else {
            resynchronise(collector);
        }
    }
}

void tl_commands_each_second(tl_collector *collector) {
    collector->answers_left = ANSWERS_PER_SECOND;
    if (collector->refused == collector->refused_logged || collector->now_us < collector->refused_log_us) {
        return;
    }
    char line[] = "commands refused, not verified or repeated:           ";
    size_t at = sizeof line - 1u;
    uint32_t count = collector->refused - collector->refused_logged;
    do {
        at--;
        line[at] = (char)('0' + count % 10u);
        count /= 10u;
    } while (count > 0);
    tl_collector_log(collector, TL_LOG_WARNING, line);
    collector->refused_logged = collector->refused;
    collector->refused_log_us = collector->now_us + LOG_PERIOD_US;
}
