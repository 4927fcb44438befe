/* The board's code, unchanged, on this computer: every access to a register traps, and a model of the chip after
   reference manual RM0090 answers it. x86-64 Linux. Prints what it has checked; the status is 1 where a check fails. */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <ucontext.h>
#include <unistd.h>

/* Instructions of the Cortex-M4: left out here. */
#define __asm if (0) __asm
#include "board.c"
#include "tl_boot_count.h"

uint32_t data_begin, data_end, data_source, bss_begin, bss_end, stack_top;

#define CHECK(condition) check(condition, #condition, __LINE__)
static int failures;
static void check(bool holds, const char *text, int line) {
    if (!holds) {
        failures++;
        printf("line %d: not so: %s\n", line, text);
    }
}

/* Windows of addresses, each mapped twice: for the board, where accesses trap, and for the model. */
typedef struct {
    uintptr_t begin;
    size_t size;
    uint8_t *model;
} window;
static window windows[] = {
    {0x40000000u, 0x24000u, NULL},
    {0x50060000u, 0x1000u, NULL},
    {0xE000E000u, 0x1000u, NULL},
    {0x08008000u, 0x8000u, NULL},
};
#define FLASH_WINDOW (&windows[3])

static window *window_of(uintptr_t address) {
    for (size_t i = 0; i < sizeof windows / sizeof *windows; i++) {
        if (address - windows[i].begin < windows[i].size) {
            return &windows[i];
        }
    }
    return NULL;
}

static uint32_t *held(uint32_t address) {
    window *of = window_of(address);
    return (uint32_t *)(of->model + (address - of->begin));
}

static bool has_crystal = true;
static bool has_flash = true;
static bool has_bus = true;
static uint32_t key_step, busy_reads;
static uint8_t erased_sectors[16];
static uint32_t watchdog_feeds;
static bool watchdog_open, watchdog_runs;
static uint8_t sent[8192];
static uint32_t sent_bytes;
static uint8_t exchanged[64];
static uint32_t exchanged_bytes, selected[64];

static void program(uintptr_t address, uint32_t before) {
    uint32_t control = *held(0x40023C10u);
    uint32_t *word = held((uint32_t)address & ~3u);
    uint32_t wanted = *word;
    *word = before;
    if ((control & FLASH_LOCK) != 0 || (control & 1u) == 0 || (control & (3u << 8)) != FLASH_WORDS || busy_reads != 0) {
        *held(0x40023C0Cu) |= 1u << 7; /* sequence error */
    } else if (has_flash) {
        *word = before & wanted; /* bits are cleared only */
        busy_reads = 3;
    }
}

static void before_access(uintptr_t address) {
    uint32_t *value = held((uint32_t)address & ~3u);
    switch (address & ~3u) {
    case 0x40023800u: { /* RCC control: what is switched on is ready */
        uint32_t ready = (has_crystal && (*value & CRYSTAL_ON) != 0 ? CRYSTAL_READY : 0u) | ((*value & PLL_ON) << 1);
        *value = (*value & ~(CRYSTAL_READY | PLL_READY)) | ready;
        break;
    }
    case 0x40023C0Cu: /* flash status */
        *value = (*value & ~FLASH_BUSY) | (busy_reads != 0 ? FLASH_BUSY : 0u);
        busy_reads -= busy_reads != 0;
        break;
    case 0x50060804u:
        *value = 1u;
        break;
    case 0x50060808u:
        *value = (uint32_t)rand();
        break;
    default:
        break;
    }
}

static void after_read(uintptr_t address) {
    if (address == 0x40011004u) {
        *held(0x40011000u) &= ~USART_RECEIVED;
    } else if (address == 0x4001300Cu) {
        *held(0x40013008u) &= ~SPI_RECEIVED;
    }
}

static void after_write(uintptr_t address, uint32_t before) {
    uint32_t *value = held((uint32_t)address & ~3u);
    uint32_t now = *value;
    if (window_of(address) == FLASH_WINDOW) {
        program(address, before);
        return;
    }
    switch (address) {
    case 0x40003000u: /* watchdog key */
        watchdog_open = now == 0x5555u;
        watchdog_runs |= now == 0xCCCCu;
        watchdog_feeds += now == 0xAAAAu;
        break;
    case 0x40003004u:
    case 0x40003008u:
        CHECK(watchdog_open);
        break;
    case 0x40011004u: /* link: data register */
        CHECK((*held(0x40011000u) & USART_READY_TO_SEND) != 0);
        sent[sent_bytes++] = (uint8_t)now;
        *held(0x40011000u) &= ~USART_READY_TO_SEND;
        break;
    case 0x4001300Cu: /* SPI: data register */
        CHECK((*held(0x40013000u) & (1u << 6 | 1u << 2)) == (1u << 6 | 1u << 2));
        selected[exchanged_bytes] = *held(0x40020014u) >> 4 & 1u ? 2u : 0u;
        selected[exchanged_bytes] |= *held(0x40020414u) & 1u;
        exchanged[exchanged_bytes++] = (uint8_t)now;
        *value = (uint8_t)~now;
        *held(0x40013008u) |= has_bus ? SPI_RECEIVED : 0u;
        break;
    case 0x40020018u: /* set and reset of pins */
    case 0x40020418u: {
        uint32_t *output = held((uint32_t)address - 4u);
        *output = (*output | (now & 0xFFFFu)) & ~(now >> 16);
        break;
    }
    case 0x40023808u: /* the clock is switched */
        if ((now & 3u) == 2u) {
            uint32_t pll = *held(0x40023804u);
            uint32_t source_mhz = (pll & 1u << 22) != 0 ? 8u : 16u;
            CHECK((pll & 1u << 22) == 0 || has_crystal);
            CHECK(source_mhz / (pll & 63u) >= 1u && source_mhz / (pll & 63u) <= 2u);
            CHECK(source_mhz * (pll >> 6 & 511u) / (pll & 63u) / (2u * (pll >> 16 & 3u) + 2u) == 168u);
            CHECK((*held(0x40023C00u) & 7u) >= 5u);                      /* wait states at 168 MHz and 3.3 V */
            CHECK((now >> 10 & 7u) == 5u && (now >> 13 & 7u) == 4u);     /* APB1 a quarter, APB2 half */
        }
        break;
    case 0x40023C04u: /* flash keys */
        key_step = (key_step == 0 && now == 0x45670123u) ? 1u : (key_step == 1u && now == 0xCDEF89ABu) ? 2u : 0u;
        if (key_step == 2u) {
            *held(0x40023C10u) &= ~FLASH_LOCK;
        }
        break;
    case 0x40023C0Cu: /* flash status: ones clear */
        *value = before & ~now;
        break;
    case 0x40023C10u: /* flash control */
        if ((before & FLASH_LOCK) != 0) {
            *value = before;
        } else if ((now & FLASH_LOCK) != 0) {
            key_step = 0;
        } else if ((now & FLASH_START) != 0) {
            uint32_t sector = now >> 3 & 15u;
            CHECK((now & FLASH_ERASE_SECTOR) != 0 && busy_reads == 0);
            erased_sectors[sector]++;
            if (has_flash && sector >= 2u && sector < 4u) {
                memset(FLASH_WINDOW->model + (sector - 2u) * 0x4000u, 0xFF, 0x4000u);
            }
            busy_reads = 5;
            *value = now & ~FLASH_START;
        }
        break;
    default:
        break;
    }
}

/* One access at a time: the window is opened for one instruction. */
static uintptr_t accessed;
static bool writes;
static uint32_t value_before;

static void protect(window *of, int flags) {
    if (mprotect((void *)of->begin, of->size, flags) != 0) {
        _exit(3);
    }
}

static void on_access(int number, siginfo_t *info, void *context) {
    (void)number;
    ucontext_t *state = context;
    accessed = (uintptr_t)info->si_addr;
    window *of = window_of(accessed);
    if (of == NULL) {
        _exit(4);
    }
    writes = (state->uc_mcontext.gregs[REG_ERR] & 2) != 0;
    before_access(accessed);
    value_before = *held((uint32_t)accessed & ~3u);
    protect(of, PROT_READ | PROT_WRITE);
    state->uc_mcontext.gregs[REG_EFL] |= 0x100; /* trap after one instruction */
}

static void on_step(int number, siginfo_t *info, void *context) {
    (void)number;
    (void)info;
    ((ucontext_t *)context)->uc_mcontext.gregs[REG_EFL] &= ~0x100;
    window *of = window_of(accessed);
    /* Flash is read like memory; only writes to it matter. */
    protect(of, of == FLASH_WINDOW ? PROT_READ : PROT_NONE);
    if (writes) {
        after_write(accessed, value_before);
    } else {
        after_read(accessed);
    }
}

static void power_on(void) {
    for (size_t i = 0; i < 3; i++) {
        memset(windows[i].model, 0, windows[i].size);
    }
    *held(0x40023C10u) = FLASH_LOCK;
    *held(0x40011000u) = USART_READY_TO_SEND;
    key_step = busy_reads = watchdog_feeds = sent_bytes = exchanged_bytes = 0;
    watchdog_open = watchdog_runs = false;
    send_written = send_read = receive_written = receive_read = 0;
}

/* The link takes a byte from its register, and interrupts where that is wanted. */
static bool byte_time(void) {
    *held(0x40011000u) |= USART_READY_TO_SEND;
    if ((*held(0x4001100Cu) & USART_SEND_INTERRUPT) == 0) {
        return false;
    }
    link_interrupt();
    return true;
}

static void arrives(uint8_t byte) {
    *held(0x40011004u) = byte;
    *held(0x40011000u) |= USART_RECEIVED;
    CHECK((*held(0x4001100Cu) & 1u << 5) != 0);
    link_interrupt();
}

static void test_start(void) {
    power_on();
    board_open();
    CHECK((*held(0x40023808u) & 3u) == 2u);
    double baud = 84e6 / *held(0x40011008u);
    CHECK(baud > 0.995 * BOARD_LINK_BAUD && baud < 1.005 * BOARD_LINK_BAUD);
    CHECK(*held(0xE000E014u) == 167999u && *held(0xE000E010u) == 7u);
    CHECK(*held(0xE000E104u) == 1u << 5); /* interrupt 37 */
    CHECK(watchdog_runs && watchdog_feeds == 1u);
    double timeout_s = (4u << *held(0x40003004u)) * (*held(0x40003008u) + 1.0) / 32e3;
    CHECK(timeout_s > 1.0 && timeout_s < 4.0);
    tl_port_feed_watchdog();
    CHECK(watchdog_feeds == 2u);
    puts("start, clock, watchdog");
}

static void test_link(void) {
    uint8_t data[3000];
    for (size_t i = 0; i < sizeof data; i++) {
        data[i] = (uint8_t)(i * 7u);
    }
    size_t taken = tl_port_send(data, sizeof data);
    CHECK(taken == SEND_BYTES && sent_bytes == 1u);
    uint32_t interrupts = 0;
    while (byte_time()) {
        interrupts++;
    }
    CHECK(interrupts == SEND_BYTES - 1u && sent_bytes == SEND_BYTES);
    taken += tl_port_send(data + taken, sizeof data - taken);
    while (byte_time()) {
    }
    CHECK(taken == sizeof data && sent_bytes == sizeof data && memcmp(sent, data, sizeof data) == 0);
    for (uint32_t i = 0; i < RECEIVE_BYTES + 5u; i++) {
        arrives((uint8_t)i);
    }
    uint8_t read[RECEIVE_BYTES + 8u];
    CHECK(tl_port_receive(read, sizeof read) == RECEIVE_BYTES); /* more did not fit */
    CHECK(read[0] == 0u && read[RECEIVE_BYTES - 1u] == (uint8_t)(RECEIVE_BYTES - 1u));
    puts("link: transmit and receive interrupts");
}

static void test_bus(void) {
    uint8_t out[5] = {1, 2, 3, 4, 5};
    uint8_t in[5];
    CHECK(spi_bus_transfer(BOARD_ACCELEROMETER, out, in, sizeof out));
    CHECK(exchanged_bytes == 5u && memcmp(exchanged, out, 5) == 0 && in[4] == (uint8_t)~5u);
    CHECK(selected[0] == 1u && selected[4] == 1u); /* the accelerometer's pin low, the other high */
    CHECK(spi_bus_transfer(BOARD_PRESSURE, out, in, 1));
    CHECK(selected[5] == 2u);
    CHECK((*held(0x40020014u) >> 4 & 1u) == 1u && (*held(0x40020414u) & 1u) == 1u);
    has_bus = false;
    CHECK(!spi_bus_transfer(BOARD_ACCELEROMETER, out, in, 1));
    CHECK((*held(0x40020014u) >> 4 & 1u) == 1u);
    has_bus = true;
    puts("bus: exchange and chip select");
}

static void test_flash(void) {
    uint8_t record[16];
    uint8_t read[16];
    memset(FLASH_WINDOW->model, 0x5A, FLASH_WINDOW->size);
    CHECK(tl_port_flash_erase(1) && erased_sectors[3] == 1u && erased_sectors[2] == 0u);
    tl_port_flash_read(0, 0, read, 16);
    CHECK(read[0] == 0x5Au);
    memset(record, 0x33, sizeof record);
    CHECK(tl_port_flash_write(1, 32, record, sizeof record));
    tl_port_flash_read(1, 32, read, 16);
    CHECK(memcmp(read, record, 16) == 0);
    memset(record, 0xCC, sizeof record);
    CHECK(!tl_port_flash_write(1, 32, record, sizeof record)); /* bits do not rise without erasing */
    CHECK((*held(0x40023C10u) & FLASH_LOCK) != 0);
    memset(FLASH_WINDOW->model, 0xFF, FLASH_WINDOW->size);
    uint32_t before = 0;
    for (int i = 0; i < 600; i++) { /* a page of 4096 bytes has room for 256 */
        uint32_t count;
        CHECK(tl_boot_count_next(&count) && count > before);
        before = count;
    }
    CHECK(erased_sectors[2] > 0u && erased_sectors[3] > 1u);
    has_flash = false;
    uint32_t count;
    memset(FLASH_WINDOW->model, 0, FLASH_WINDOW->size);
    CHECK(!tl_boot_count_next(&count));
    has_flash = true;
    puts("flash: keys, erasing, programming, boot counter");
}

int main(void) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    int file = memfd_create("chip", 0);
    off_t end = 0;
    for (size_t i = 0; i < sizeof windows / sizeof *windows; i++) {
        window *of = &windows[i];
        if (ftruncate(file, end + (off_t)of->size) != 0) {
            return 2;
        }
        of->model = mmap(NULL, of->size, PROT_READ | PROT_WRITE, MAP_SHARED, file, end);
        int flags = of == FLASH_WINDOW ? PROT_READ : PROT_NONE;
        void *board = mmap((void *)of->begin, of->size, flags, MAP_SHARED | MAP_FIXED_NOREPLACE, file, end);
        if (of->model == MAP_FAILED || board != (void *)of->begin) {
            return 2;
        }
        end += (off_t)of->size;
    }
    struct sigaction access = {.sa_sigaction = on_access, .sa_flags = SA_SIGINFO};
    struct sigaction step = {.sa_sigaction = on_step, .sa_flags = SA_SIGINFO};
    sigaction(SIGSEGV, &access, NULL);
    sigaction(SIGTRAP, &step, NULL);
    test_start();
    test_link();
    test_bus();
    test_flash();
    has_crystal = false;
    power_on();
    board_open();
    CHECK((*held(0x40023808u) & 3u) == 2u);
    puts("start without a crystal");
    return failures != 0;
}
