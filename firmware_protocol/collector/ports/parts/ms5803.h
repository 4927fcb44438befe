/* MS5803-14BA, absolute pressure to 14 bar and temperature, at SPI. Commands and compensation after its data sheet. */
#ifndef TL_MS5803_H
#define TL_MS5803_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    unsigned part;
    uint16_t prom[8];
    uint32_t pressure_raw;
    bool converts_temperature;
    bool ready; /* the values below are measured */
    int32_t pressure_pa;
    int16_t temperature_cdegc;
} ms5803;

/* Resets the part. ms5803_open may follow after 3 ms. */
bool ms5803_reset(unsigned part);

/* Reads the calibration and starts the first conversion. False: no answer, or its check sum is wrong. */
bool ms5803_open(ms5803 *sensor, unsigned part);

/* Reads the conversion that has ended and starts the next, of pressure and temperature in turn. Call it every 10 ms or
   later. False: no answer, or the call came too early. */
bool ms5803_step(ms5803 *sensor);

#endif
