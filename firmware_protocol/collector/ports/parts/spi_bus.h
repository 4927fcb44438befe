/* The bus of the drivers; the board provides it. */
#ifndef TL_SPI_BUS_H
#define TL_SPI_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Selects a part, exchanges `size` bytes in mode 0 and deselects it. `in` may be `out`. False: the bus failed. */
bool spi_bus_transfer(unsigned part, const uint8_t *out, uint8_t *in, size_t size);

#endif
