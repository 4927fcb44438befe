/* ADXL372, accelerometer of three axes, 200 g, at SPI of at most 10 MHz. Registers after data sheet Rev. B. */
#ifndef TL_ADXL372_H
#define TL_ADXL372_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define ADXL372_SCALE_MPS2 0.980665f /* 100 mg a count */
#define ADXL372_RANGE_MPS2 1961.33f
#define ADXL372_SATURATION_COUNTS 2047u /* 12 bit */
#define ADXL372_MOST_ROWS 40u

typedef enum {
    ADXL372_OK,
    ADXL372_NO_ANSWER, /* the bus failed, or the part is another one */
    ADXL372_OVERRUN,   /* the FIFO has lost samples: start again */
    ADXL372_TORN,      /* a row did not begin with x, axes would be swapped: start again */
} adxl372_outcome;

/* Resets the part, checks that it is one, and leaves it in standby. The next call may come after 1 ms. */
adxl372_outcome adxl372_reset(unsigned part);

/* Starts the FIFO, empty, at the supported rate that is nearest to the one wanted, with half of it as bandwidth. */
adxl372_outcome adxl372_start(unsigned part, float wanted_hz, float *rate_hz);

/* Reads at most ADXL372_MOST_ROWS rows of x, y, z in counts of 12 bit. `left` is the number of rows in the FIFO after
   the last row read. One row always stays in the FIFO, so that a set being written is not torn. */
adxl372_outcome adxl372_read(unsigned part, int16_t *counts, uint32_t *rows, uint32_t *left);

#endif
