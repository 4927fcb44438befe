/* The collector on QEMU's mps2-an386: the link at UART 0, the sensor of wheel i at UART 1 + i. */
#include "bench.h"
#include "board.h"

#include <string.h>

#define LINK_BYTES 2048u

/* Sent on the line of the first sensor at every start. */
static const uint8_t ready = 'R';

__attribute__((section(".kept"))) static bench_memory memory;

static bench_reader readers[BOARD_UARTS - 1u];
static uint8_t link_bytes[LINK_BYTES];
static volatile uint32_t link_written;
static volatile uint32_t link_read;

void board_received(unsigned uart, uint8_t byte) {
    if (uart > 0 && uart < BOARD_UARTS) {
        bench_take(&readers[uart - 1u], byte);
    } else if (link_written - link_read < LINK_BYTES) {
        link_bytes[link_written % LINK_BYTES] = byte;
        link_written++;
    }
}

void board_millisecond(void) {
    if (bench_watchdog_expired()) {
        tl_port_reset();
    }
}

size_t tl_port_send(const uint8_t *data, size_t size) {
    size_t taken = board_send(board_uarts[0], data, bench_link_room(size));
    bench_link_took(taken);
    return taken;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    size_t n = 0;
    while (n < size && link_read != link_written) {
        data[n++] = link_bytes[link_read % LINK_BYTES];
        link_read++;
    }
    return n;
}

_Noreturn void tl_port_reset(void) {
    board_reset();
}

int main(void) {
    bench_persistent = &memory;
    bench_start();
    board_open();
    (void)board_send(board_uarts[1], &ready, 1);
    for (;;) {
        while (bench_hangs) {
        }
        if (bench_runs()) {
            tl_collector_poll(&bench_collector);
        }
        board_sleep();
    }
}
