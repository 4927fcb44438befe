/* Cost of the collector on a Cortex-M4, in instructions: run with QEMU's -icount shift=0, one instruction a ns. The timer
   advances every 40 instructions, so each figure is the mean over many repetitions. */
#include "board.h"
#include "tl_boot_count.h"
#include "tl_collector.h"

#include <string.h>

#define TIMER_INSTRUCTIONS 40u
#define TIMER_PERIOD 0x1000000u
#define FRAMES 200u
#define PAINT 0xA5A5A5A5u
#define FIFO_SAMPLES 36u
#define TIMER_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define TIMER_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define TIMER_VALUE (*(volatile uint32_t *)0xE000E018u)

extern uint32_t stack_limit, stack_top;

static tl_collector collector;
static uint8_t flash[2][TL_BOOT_PAGE_BYTES];
static uint32_t clock_us;
static uint8_t incoming[TL_MAX_FRAME_BYTES];
static size_t incoming_size;

uint32_t tl_port_clock_us(void) {
    return clock_us;
}

size_t tl_port_send(const uint8_t *data, size_t size) {
    (void)data;
    return size;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    size_t n = incoming_size < size ? incoming_size : size;
    memcpy(data, incoming, n);
    incoming_size = 0;
    return n;
}

bool tl_port_listening(void) {
    return true;
}

bool tl_port_set_rate(uint8_t wheel, float wanted_hz, float *rate_hz) {
    (void)wheel;
    *rate_hz = wanted_hz;
    return true;
}

void tl_port_environment(uint8_t wheel, tl_environment *environment) {
    (void)wheel;
    environment->pressure_pa = 220000;
}

void tl_port_hub_status(tl_hub_status *status) {
    status->supply_mv = 3700;
}

void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size) {
    memcpy(data, flash[page] + at, size);
}

bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size) {
    memcpy(flash[page] + at, data, size);
    return true;
}

bool tl_port_flash_erase(unsigned page) {
    memset(flash[page], 0xFF, TL_BOOT_PAGE_BYTES);
    return true;
}

uint32_t tl_port_random(void) {
    return 4;
}

void tl_port_feed_watchdog(void) {
}

_Noreturn void tl_port_reset(void) {
    board_reset();
}

#ifdef TL_AES_HARDWARE
/* What the processor does for a block in a peripheral: store key and block, wait, load the result. The peripheral's own
   time is not an instruction, and comes on top. */
static volatile uint32_t peripheral[8];

void tl_port_aes128(const uint8_t key[16], uint8_t block[16]) {
    uint32_t words[4];
    memcpy(words, key, 16);
    for (unsigned i = 0; i < 4; i++) {
        peripheral[i] = words[i];
    }
    memcpy(words, block, 16);
    for (unsigned i = 0; i < 4; i++) {
        peripheral[4 + i] = words[i];
    }
    for (unsigned i = 0; i < 4; i++) {
        words[i] = peripheral[4 + i] ^ peripheral[i];
    }
    memcpy(block, words, 16);
}
#endif

void board_received(unsigned uart, uint8_t byte) {
    (void)uart;
    (void)byte;
}

void board_millisecond(void) {
}

static void print(const char *text) {
    for (size_t size = strlen(text); size > 0;) {
        size_t taken = board_send(board_uarts[0], (const uint8_t *)text, size);
        text += taken;
        size -= taken;
    }
}

static void print_value(const char *name, uint32_t value) {
    char digits[12] = "           ";
    size_t at = sizeof digits - 1u;
    digits[at] = '\0';
    do {
        digits[--at] = (char)('0' + value % 10u);
        value /= 10u;
    } while (value > 0);
    print(name);
    print(" ");
    print(digits + at);
    print("\n");
}

static uint32_t begun;

static void begin(void) {
    TIMER_VALUE = 0;
    begun = TIMER_VALUE;
}

/* Instructions since `begin`, of each of `times`. */
static uint32_t each(uint32_t times) {
    uint32_t passed = (begun - TIMER_VALUE) & (TIMER_PERIOD - 1u);
    return (uint32_t)(((uint64_t)passed * TIMER_INSTRUCTIONS + times / 2u) / times);
}

static void start(const uint8_t *key, uint8_t axes) {
    static tl_wheel_config wheel;
    static tl_collector_config hub;
    wheel = (tl_wheel_config){.axes = axes, .sensor_id = 0xA001, .rate_hz = 9600.0f, .saturation_counts = 32767,
                              .key = key};
    hub = (tl_collector_config){.hub_id = 1, .key = key, .wheels = &wheel, .wheel_count = 1};
    clock_us = 0;
    (void)tl_collector_start(&collector, &hub);
    tl_collector_poll(&collector);
}

static void stream(const char *frame_name, const char *sample_name, const char *take_name, const uint8_t *key) {
    static int16_t counts[3u * FIFO_SAMPLES];
    start(key, 7);
    uint32_t samples = key != NULL ? 35u : 36u;
    uint32_t taking = 0;
    uint32_t polling = 0;
    for (uint32_t i = 0; i < FRAMES; i++) {
        begin();
        tl_collector_put(&collector, 0, counts, samples, clock_us);
        taking += each(1);
        begin();
        tl_collector_poll(&collector);
        polling += each(1);
    }
    print_value(take_name, taking / FRAMES);
    print_value(frame_name, polling / FRAMES);
    print_value(sample_name, (taking + polling) / (FRAMES * samples));
}

static void command(const char *name, const uint8_t *key) {
    uint32_t total = 0;
    start(key, 7);
    for (uint32_t i = 0; i < FRAMES; i++) {
        tl_source source = {0, TL_WHEEL_HUB_ITSELF, i};
        tl_set_time time = {i};
        incoming_size = tl_encode_set_time(incoming, &source, 0, &time);
        if (key != NULL) {
            incoming_size = tl_sign(incoming, &collector.hub.signer);
        }
        begin();
        tl_collector_poll(&collector);
        total += each(1);
    }
    print_value(name, total / FRAMES);
}

static uint32_t stack_used(void) {
    const uint32_t *at = &stack_limit;
    while (at < &stack_top && *at == PAINT) {
        at++;
    }
    return (uint32_t)((const uint8_t *)&stack_top - (const uint8_t *)at);
}

static void paint_stack(void) {
    volatile uint32_t here = 0;
    for (uint32_t *at = &stack_limit; at + 32 < (uint32_t *)&here; at++) {
        *at = PAINT;
    }
}

int main(void) {
    static const uint8_t key[16] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
    static tl_signer signer;
    paint_stack();
    board_open();
    TIMER_CONTROL = 0;
    TIMER_RELOAD = TIMER_PERIOD - 1u;
    TIMER_CONTROL = 5; /* no interrupt */
    memset(flash, 0xFF, sizeof flash);
    uint32_t boot_count = 0;
    begin();
    (void)tl_boot_count_next(&boot_count);
    print_value("boot_count", each(1));
    stream("frame_unsigned", "sample_unsigned", "put_unsigned", NULL);
    stream("frame_signed", "sample_signed", "put_signed", key);
    begin();
    for (uint32_t i = 0; i < FRAMES; i++) {
        tl_collector_poll(&collector);
    }
    print_value("idle_poll", each(FRAMES));
    clock_us += 2000000u;
    begin();
    tl_collector_poll(&collector);
    print_value("second_signed", each(1));
    command("command_unsigned", NULL);
    command("command_signed", key);
    begin();
    tl_signer_init(&signer, key, 1, 1);
    print_value("signer_init", each(1));
    uint8_t block[16] = {0};
    begin();
    for (uint32_t i = 0; i < FRAMES; i++) {
        tl_cmac(&signer, block, 16, block);
    }
    print_value("cmac_block", each(FRAMES));
    print_value("stack_bytes", stack_used());
    print_value("ram_collector", sizeof collector);
    print_value("ram_wheel", sizeof(tl_wheel));
    print_value("ram_queue", sizeof(tl_transmit_queue));
    print("end\n");
    for (;;) {
        board_sleep();
    }
}
