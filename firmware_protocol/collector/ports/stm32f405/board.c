/* Registers after reference manual RM0090. */
#include "board.h"

#include "spi_bus.h"
#include "tl_boot_count.h"
#include "tl_port.h"

#include <string.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))

#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define NVIC_ENABLE_1 REGISTER(0xE000E104u)
#define RESTART REGISTER(0xE000ED0Cu)
#define COPROCESSORS REGISTER(0xE000ED88u)

#define RCC_CONTROL REGISTER(0x40023800u)
#define RCC_PLL REGISTER(0x40023804u)
#define RCC_CONFIGURATION REGISTER(0x40023808u)
#define RCC_AHB1 REGISTER(0x40023830u)
#define RCC_AHB2 REGISTER(0x40023834u)
#define RCC_APB1 REGISTER(0x40023840u)
#define RCC_APB2 REGISTER(0x40023844u)
#define CRYSTAL_ON (1u << 16)
#define CRYSTAL_READY (1u << 17)
#define PLL_ON (1u << 24)
#define PLL_READY (1u << 25)

#define FLASH_ACCESS REGISTER(0x40023C00u)
#define FLASH_KEY REGISTER(0x40023C04u)
#define FLASH_STATUS REGISTER(0x40023C0Cu)
#define FLASH_CONTROL REGISTER(0x40023C10u)
#define FLASH_BUSY (1u << 16)
#define FLASH_ERRORS 0xF2u
#define FLASH_LOCK (1u << 31)
#define FLASH_START (1u << 16)
#define FLASH_WORDS (2u << 8)
#define FLASH_PROGRAM 1u
#define FLASH_ERASE_SECTOR 2u
#define FIRST_PAGE 0x08008000u
#define PAGE_DISTANCE 0x4000u
#define FIRST_PAGE_SECTOR 2u

#define WATCHDOG_KEY REGISTER(0x40003000u)
#define WATCHDOG_DIVIDER REGISTER(0x40003004u)
#define WATCHDOG_RELOAD REGISTER(0x40003008u)

#define RANDOM_CONTROL REGISTER(0x50060800u)
#define RANDOM_STATUS REGISTER(0x50060804u)
#define RANDOM_DATA REGISTER(0x50060808u)

#define SPI_CONTROL REGISTER(0x40013000u)
#define SPI_STATUS REGISTER(0x40013008u)
#define SPI_DATA REGISTER(0x4001300Cu)
#define SPI_RECEIVED 1u
/* Enabled, master, chip select by software, clock of 84 MHz / 16. */
#define SPI_MASTER (1u << 2 | 3u << 3 | 1u << 6 | 1u << 8 | 1u << 9)

/* Loops after which a part of the chip counts as failed; some ms. */
#ifndef PATIENCE
#define PATIENCE 200000u
#endif

typedef struct {
    volatile uint32_t status;
    volatile uint32_t data;
    volatile uint32_t baud;
    volatile uint32_t control;
} usart;

#define LINK ((usart *)0x40011000u)
#define USART_READY_TO_SEND (1u << 7)
#define USART_RECEIVED (1u << 5)
#define USART_SEND_INTERRUPT (1u << 7)
#define USART_OPEN (1u << 13 | 1u << 5 | 1u << 3 | 1u << 2) /* enabled, interrupt of the receiver, both directions */
#define LINK_INTERRUPT 37u

typedef struct {
    volatile uint32_t mode;
    volatile uint32_t type;
    volatile uint32_t speed;
    volatile uint32_t pull;
    volatile uint32_t input;
    volatile uint32_t output;
    volatile uint32_t set_reset;
    volatile uint32_t lock;
    volatile uint32_t alternate[2];
} gpio;

#define PORT_A ((gpio *)0x40020000u)
#define PORT_B ((gpio *)0x40020400u)

extern uint32_t data_begin, data_end, data_source, bss_begin, bss_end, stack_top;

/* One writer and one reader each; sizes are powers of two. */
#define SEND_BYTES 2048u
#define RECEIVE_BYTES 1024u
static uint8_t to_send[SEND_BYTES];
static volatile uint32_t send_written;
static volatile uint32_t send_read;
static uint8_t received[RECEIVE_BYTES];
static volatile uint32_t receive_written;
static volatile uint32_t receive_read;

static volatile uint32_t uptime_ms;

void reset_handler(void) {
    COPROCESSORS |= 0xFu << 20; /* floating point */
    __asm volatile("dsb\nisb" ::: "memory");
    uint32_t *from = &data_source;
    for (uint32_t *to = &data_begin; to < &data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &bss_begin; to < &bss_end;) {
        *to++ = 0;
    }
    (void)main();
    tl_port_reset();
}

static void fault_handler(void) {
    tl_port_reset();
}

static void millisecond(void) {
    uptime_ms = uptime_ms + 1u;
}

/* Runs in the interrupt of the link, or with it disabled. */
static void send_waiting(void) {
    while (send_read != send_written && (LINK->status & USART_READY_TO_SEND) != 0) {
        LINK->data = to_send[send_read % SEND_BYTES];
        send_read = send_read + 1u;
    }
    LINK->control = send_read != send_written ? USART_OPEN | USART_SEND_INTERRUPT : USART_OPEN;
}

static void link_interrupt(void) {
    while ((LINK->status & USART_RECEIVED) != 0) {
        uint8_t byte = (uint8_t)LINK->data;
        if (receive_written - receive_read < RECEIVE_BYTES) {
            received[receive_written % RECEIVE_BYTES] = byte;
            receive_written = receive_written + 1u;
        }
    }
    send_waiting();
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    const void *stack;
    handler handlers[15u + 82u];
} vectors = {&stack_top,
             {
                 [0] = reset_handler,
                 [1] = fault_handler,
                 [2] = fault_handler,
                 [3] = fault_handler,
                 [4] = fault_handler,
                 [5] = fault_handler,
                 [14] = millisecond,
                 [15u + LINK_INTERRUPT] = link_interrupt,
             }};

static bool becomes(const volatile uint32_t *status, uint32_t mask, uint32_t wanted) {
    for (uint32_t i = 0; i < PATIENCE; i++) {
        if ((*status & mask) == wanted) {
            return true;
        }
    }
    return false;
}

/* 168 MHz from the crystal, or from the oscillator of the chip, within 1 %, where the crystal does not start. */
static void open_clock(void) {
    RCC_CONTROL |= CRYSTAL_ON;
    bool crystal = becomes(&RCC_CONTROL, CRYSTAL_READY, CRYSTAL_READY);
    uint32_t source_mhz = crystal ? BOARD_CRYSTAL_MHZ : 16u;
    RCC_PLL = source_mhz | 336u << 6 | (crystal ? 1u << 22 : 0u) | 7u << 24;
    RCC_CONTROL |= PLL_ON;
    FLASH_ACCESS = 5u | 7u << 8;                  /* five wait states, prefetch, both caches */
    RCC_CONFIGURATION = 5u << 10 | 4u << 13;      /* APB1 42 MHz, APB2 84 MHz */
    if (becomes(&RCC_CONTROL, PLL_READY, PLL_READY)) {
        RCC_CONFIGURATION |= 2u;
    }
}

static void set_alternate(gpio *port, unsigned pin, uint32_t function) {
    port->alternate[pin / 8u] |= function << 4u * (pin % 8u);
    port->speed |= 2u << 2u * pin;
    port->mode = (port->mode & ~(3u << 2u * pin)) | 2u << 2u * pin;
}

static void set_output_high(gpio *port, unsigned pin) {
    port->set_reset = 1u << pin;
    port->mode = (port->mode & ~(3u << 2u * pin)) | 1u << 2u * pin;
}

#ifdef BOARD_BUS_ON_USART2
/* The emulator's SPI has no part on it. So what SPI exchanges is also sent to the models of the parts, behind USART 2:
   part, size in two bytes, bytes; they answer with as many bytes. */
#define MODELS ((usart *)0x40004400u)

static void exchange_with_models(unsigned part, const uint8_t *out, uint8_t *in, size_t size) {
    const uint8_t head[3] = {(uint8_t)part, (uint8_t)(size >> 8), (uint8_t)size};
    for (size_t i = 0; i < sizeof head; i++) {
        MODELS->data = head[i];
    }
    for (size_t i = 0; i < size; i++) {
        MODELS->data = out[i];
    }
    for (size_t i = 0; i < size; i++) {
        while ((MODELS->status & USART_RECEIVED) == 0) {
        }
        in[i] = (uint8_t)MODELS->data;
    }
}
#endif

void board_open(void) {
    open_clock();
    RCC_AHB1 |= 1u << 0 | 1u << 1;
    RCC_AHB2 |= 1u << 6;
    RCC_APB1 |= 1u << 17;
    RCC_APB2 |= 1u << 4 | 1u << 12;
    set_alternate(PORT_A, 9, 7);
    set_alternate(PORT_A, 10, 7);
    set_output_high(PORT_A, 4);
    set_output_high(PORT_B, 0);
    set_alternate(PORT_A, 5, 5);
    set_alternate(PORT_A, 6, 5);
    set_alternate(PORT_A, 7, 5);
    SPI_CONTROL = SPI_MASTER;
    RANDOM_CONTROL = 1u << 2;
    LINK->baud = (BOARD_HZ / 2u + BOARD_LINK_BAUD / 2u) / BOARD_LINK_BAUD;
    LINK->control = USART_OPEN;
#ifdef BOARD_BUS_ON_USART2
    MODELS->control = 1u << 13 | 1u << 3 | 1u << 2;
#endif
    SYSTICK_RELOAD = BOARD_HZ / 1000u - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7;
    NVIC_ENABLE_1 = 1u << (LINK_INTERRUPT - 32u);
    WATCHDOG_KEY = 0x5555u;
    WATCHDOG_DIVIDER = 4u; /* 32 kHz / 64 */
    WATCHDOG_RELOAD = 1000u;
    WATCHDOG_KEY = 0xCCCCu;
    tl_port_feed_watchdog();
}

uint32_t tl_port_clock_us(void) {
    uint32_t left_before;
    uint32_t whole_ms;
    uint32_t left_after;
    /* The timer counts down; one that starts again between the two readings belongs to the next millisecond. */
    do {
        left_before = SYSTICK_VALUE;
        whole_ms = uptime_ms;
        left_after = SYSTICK_VALUE;
    } while (left_after > left_before);
    return whole_ms * 1000u + (BOARD_HZ / 1000u - 1u - left_after) / (BOARD_HZ / 1000000u);
}

void board_wait_ms(uint32_t duration_ms) {
    uint32_t begin_ms = uptime_ms;
    while (uptime_ms - begin_ms <= duration_ms) {
        board_sleep();
    }
}

void board_sleep(void) {
    __asm volatile("wfi" ::: "memory");
}

size_t tl_port_send(const uint8_t *data, size_t size) {
    size_t taken = 0;
    while (taken < size && send_written - send_read < SEND_BYTES) {
        to_send[send_written % SEND_BYTES] = data[taken++];
        send_written = send_written + 1u;
    }
    __asm volatile("cpsid i" ::: "memory");
    send_waiting();
    __asm volatile("cpsie i" ::: "memory");
    return taken;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    size_t n = 0;
    while (n < size && receive_read != receive_written) {
        data[n++] = received[receive_read % RECEIVE_BYTES];
        receive_read = receive_read + 1u;
    }
    return n;
}

bool spi_bus_transfer(unsigned part, const uint8_t *out, uint8_t *in, size_t size) {
    gpio *port = part == BOARD_ACCELEROMETER ? PORT_A : PORT_B;
    uint32_t select = part == BOARD_ACCELEROMETER ? 1u << 4 : 1u << 0;
    bool works = true;
#ifdef BOARD_BUS_ON_USART2
    exchange_with_models(part, out, in, size);
    uint8_t unheard;
#endif
    port->set_reset = select << 16;
    for (size_t i = 0; i < size && works; i++) {
        SPI_DATA = out[i];
        works = becomes(&SPI_STATUS, SPI_RECEIVED, SPI_RECEIVED);
#ifdef BOARD_BUS_ON_USART2
        unheard = (uint8_t)SPI_DATA;
        (void)unheard;
#else
        in[i] = (uint8_t)SPI_DATA;
#endif
    }
    port->set_reset = select;
    return works;
}

static const uint8_t *page_begin(unsigned page) {
    return (const uint8_t *)(FIRST_PAGE + page * PAGE_DISTANCE);
}

void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size) {
    memcpy(data, page_begin(page) + at, size);
}

static void unlock_flash(void) {
    if ((FLASH_CONTROL & FLASH_LOCK) != 0) {
        FLASH_KEY = 0x45670123u;
        FLASH_KEY = 0xCDEF89ABu;
    }
    FLASH_STATUS = FLASH_ERRORS; /* ones clear */
}

static bool end_flash(void) {
    while ((FLASH_STATUS & FLASH_BUSY) != 0) { /* ends by itself; the watchdog bounds it */
    }
    bool good = (FLASH_STATUS & FLASH_ERRORS) == 0;
    FLASH_CONTROL = FLASH_LOCK;
    FLASH_ACCESS &= ~(3u << 9); /* the caches may hold what was there before: off, */
    FLASH_ACCESS |= 3u << 11;   /* emptied, */
    FLASH_ACCESS &= ~(3u << 11);
    FLASH_ACCESS |= 3u << 9; /* on again */
    return good;
}

bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size) {
    unlock_flash();
    FLASH_CONTROL = FLASH_WORDS | FLASH_PROGRAM;
    for (size_t i = 0; i < size; i += sizeof(uint32_t)) {
        uint32_t word;
        memcpy(&word, data + i, sizeof word);
        REGISTER(FIRST_PAGE + page * PAGE_DISTANCE + at + i) = word;
        while ((FLASH_STATUS & FLASH_BUSY) != 0) {
        }
    }
    return end_flash() && memcmp(page_begin(page) + at, data, size) == 0;
}

bool tl_port_flash_erase(unsigned page) {
    unlock_flash();
    FLASH_CONTROL = FLASH_WORDS | FLASH_ERASE_SECTOR | (FIRST_PAGE_SECTOR + page) << 3;
    FLASH_CONTROL |= FLASH_START;
    return end_flash();
}

uint32_t tl_port_random(void) {
    return becomes(&RANDOM_STATUS, 1u, 1u) ? RANDOM_DATA : SYSTICK_VALUE;
}

void tl_port_feed_watchdog(void) {
    WATCHDOG_KEY = 0xAAAAu;
}

_Noreturn void tl_port_reset(void) {
    __asm volatile("dsb" ::: "memory");
    RESTART = 0x05FA0004u;
    for (;;) {
    }
}
