#include "board.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define NVIC_ENABLE REGISTER(0xE000E100u)
#define VECTORS REGISTER(0xE000ED08u)
#define RESTART REGISTER(0xE000ED0Cu)
#define COPROCESSORS REGISTER(0xE000ED88u)

#define TRANSMITTER_FULL 1u
#define RECEIVER_FULL 2u
#define RECEIVE_INTERRUPT 2u

extern uint32_t data_begin, data_end, data_source, bss_begin, bss_end, stack_top;

board_uart *const board_uarts[BOARD_UARTS] = {
    (board_uart *)0x40004000u, (board_uart *)0x40005000u, (board_uart *)0x40006000u,
    (board_uart *)0x40007000u, (board_uart *)0x40009000u,
};

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
    board_reset();
}

static void fault_handler(void) {
    board_reset();
}

static void receive(unsigned number) {
    board_uart *uart = board_uarts[number];
    while ((uart->state & RECEIVER_FULL) != 0) {
        uart->interrupts = RECEIVE_INTERRUPT;
        board_received(number, (uint8_t)uart->data);
    }
}

static void receive_0(void) {
    receive(0);
}
static void receive_1(void) {
    receive(1);
}
static void receive_2(void) {
    receive(2);
}
static void receive_3(void) {
    receive(3);
}
static void receive_4(void) {
    receive(4);
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    const void *stack;
    handler handlers[47];
} vectors = {&stack_top,
             {
                 [0] = reset_handler,
                 [1] = fault_handler,
                 [2] = fault_handler,
                 [3] = fault_handler,
                 [4] = fault_handler,
                 [5] = fault_handler,
                 [14] = board_millisecond,
                 [15] = receive_0,
                 [17] = receive_1,
                 [19] = receive_2,
                 [33] = receive_3,
                 [35] = receive_4,
             }};

void board_open(void) {
    for (unsigned i = 0; i < BOARD_UARTS; i++) {
        board_uarts[i]->divider = 16;
        board_uarts[i]->control = 1u | 2u | 8u; /* transmitter, receiver, interrupt of the receiver */
    }
    SYSTICK_RELOAD = BOARD_HZ / 1000u - 1u;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7;
    NVIC_ENABLE = 1u << 0 | 1u << 2 | 1u << 4 | 1u << 18 | 1u << 20;
}

size_t board_send(board_uart *uart, const uint8_t *data, size_t size) {
    size_t taken = 0;
    while (taken < size && (uart->state & TRANSMITTER_FULL) == 0) {
        uart->data = data[taken++];
    }
    return taken;
}

_Noreturn void board_reset(void) {
    __asm volatile("dsb" ::: "memory");
    RESTART = 0x05FA0004u;
    for (;;) {
    }
}

void board_sleep(void) {
    __asm volatile("wfi" ::: "memory");
}
