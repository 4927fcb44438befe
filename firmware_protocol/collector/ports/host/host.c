/* The collector as a program: records of the bench on standard input, bytes of the link on standard output. */
#include "bench.h"

#include <setjmp.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static bench_memory memory;
static jmp_buf power_on;

static void write_all(const uint8_t *data, size_t size) {
    while (size > 0) {
        ssize_t written = write(STDOUT_FILENO, data, size);
        if (written <= 0) {
            _exit(1);
        }
        data += written;
        size -= (size_t)written;
    }
}

/* Bytes wait here for one system call each; a restart of the chip does not lose what the link has taken. */
static uint8_t sent[1u << 16];
static size_t sent_size;

static void flush_link(void) {
    write_all(sent, sent_size);
    sent_size = 0;
}

size_t tl_port_send(const uint8_t *data, size_t size) {
    size_t taken = bench_link_room(size);
    if (sent_size + taken > sizeof sent) {
        flush_link();
    }
    memcpy(sent + sent_size, data, taken);
    sent_size += taken;
    bench_link_took(taken);
    return taken;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    return bench_link_received(data, size);
}

_Noreturn void tl_port_reset(void) {
    longjmp(power_on, 1);
}

int main(void) {
    static uint8_t input[1u << 16];
    static ssize_t got;
    static ssize_t at;
    static bench_reader reader;
    bench_persistent = &memory;
    if (setjmp(power_on) != 0) {
        reader.size = 0;
    }
    bench_start();
    if (bench_runs()) {
        tl_collector_poll(&bench_collector);
    }
    for (;;) {
        if (at == got) {
            flush_link();
            at = 0;
            got = read(STDIN_FILENO, input, sizeof input);
            if (got <= 0) {
                return 0;
            }
        }
        bench_take(&reader, input[at++]);
        if (reader.size != 0 || !bench_runs()) {
            continue;
        }
        /* Time does not pass in a program that waits for input: a hanging main loop lasts as long as it takes. */
        while (bench_hangs) {
            if (bench_watchdog_expired()) {
                tl_port_reset();
            }
        }
        tl_collector_poll(&bench_collector);
    }
}
