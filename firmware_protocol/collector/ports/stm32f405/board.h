/* STM32F405RG: start-up, clock, link, bus of the sensors, flash, watchdog. */
#ifndef TL_BOARD_H
#define TL_BOARD_H

#include <stdint.h>

#ifndef BOARD_CRYSTAL_MHZ
#define BOARD_CRYSTAL_MHZ 8u
#endif
#define BOARD_HZ 168000000u
#define BOARD_LINK_BAUD 921600u

/* Places on the bus. */
#define BOARD_ACCELEROMETER 0u
#define BOARD_PRESSURE 1u

void board_open(void);
void board_wait_ms(uint32_t duration_ms);
void board_sleep(void);

int main(void);
void reset_handler(void);

#endif
