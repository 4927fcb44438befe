/* Ports of the collector: what a board provides. Write these functions; the collector calls them from
   tl_collector_start and tl_collector_poll only, never from an interrupt. None of them may wait. */
#ifndef TL_PORT_H
#define TL_PORT_H

#include "treadlink_protocol.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Free-running clock in us. It wraps at 32 bits and is never set. */
uint32_t tl_port_clock_us(void);

/* Hands bytes to the link and returns how many it took: any number for a UART; all or none for a notification. */
size_t tl_port_send(const uint8_t *data, size_t size);

/* Copies at most `size` received bytes to `data` and returns their number. */
size_t tl_port_receive(uint8_t *data, size_t size);

/* Whether anybody reads the link: for BLE, whether a client has subscribed; for a UART, true. */
bool tl_port_listening(void);

/* Sets the sensor of a wheel to the nearest rate that it supports and stores that rate. False: the sensor failed.
   Stop its FIFO, discard what it holds, set the rate, start it again: tl_collector_put must get no sample of the old
   rate after this function has returned. */
bool tl_port_set_rate(uint8_t wheel, float wanted_hz, float *rate_hz);

/* Stores the latest slow quantities of a wheel, with the TL_ENVIRONMENT_..._NONE values where there is none. */
void tl_port_environment(uint8_t wheel, tl_environment *environment);

/* Stores supply, battery, signal strength and retries of the hub. The collector fills in the other fields. */
void tl_port_hub_status(tl_hub_status *status);

/* Flash for the boot counter: two pages of TL_BOOT_PAGE_BYTES, numbered 0 and 1. A page is erased as a whole to 0xFF.
   A write is 16 bytes, aligned to 16, to a place that was not written since the page was erased. */
void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size);
bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size);
bool tl_port_flash_erase(unsigned page);

/* 32 random bits. They are used as boot count when the flash has failed. */
uint32_t tl_port_random(void);

/* Restarts the watchdog. Its timeout should be 1 s or more. */
void tl_port_feed_watchdog(void);

/* Restarts the chip. */
_Noreturn void tl_port_reset(void);

#endif
