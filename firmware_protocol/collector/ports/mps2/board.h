/* Start-up, UARTs and timer of QEMU's mps2-an386. */
#ifndef TL_BOARD_H
#define TL_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BOARD_UARTS 5u
#define BOARD_HZ 25000000u

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state; /* bit 0: transmitter full, bit 1: receiver full */
    volatile uint32_t control;
    volatile uint32_t interrupts;
    volatile uint32_t divider;
} board_uart;

extern board_uart *const board_uarts[BOARD_UARTS];

/* Opens the UARTs with interrupts of their receivers, and a tick of 1 ms. */
void board_open(void);
/* Sends as many bytes as the UART takes now. */
size_t board_send(board_uart *uart, const uint8_t *data, size_t size);
_Noreturn void board_reset(void);
void board_sleep(void);

/* Interrupts, written by the program. */
void board_received(unsigned uart, uint8_t byte);
void board_millisecond(void);

int main(void);
void reset_handler(void);

#endif
