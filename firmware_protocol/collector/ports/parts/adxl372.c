#include "adxl372.h"

#include "spi_bus.h"

#include <string.h>

#define DEVICE_IDS 0x00u /* and the two after it */
#define STATUS 0x04u     /* then the second status and the two registers of FIFO entries */
#define FIFO_CONTROL 0x3Au
#define TIMING 0x3Du
#define MEASURE 0x3Eu
#define POWER_CONTROL 0x3Fu
#define RESET 0x41u
#define FIFO_DATA 0x42u

#define FIFO_OVERRUN (1u << 3)
#define FIFO_BYPASS 0u
#define FIFO_STREAM_XYZ (1u << 1)
#define BEGINS_ROW 1u /* bit 0 of a word */
#define RATE_AT 5u
#define RESET_CODE 0x52u
#define STANDBY 0u
/* Full bandwidth, no high-pass filter, filters settle in 16 ms. */
#define MEASURING (3u | 1u << 2 | 1u << 4)

#define AXES 3u
#define ROW_BYTES (2u * AXES)

static const uint8_t ids[3] = {0xADu, 0x1Du, 0xFAu};
static const float rates_hz[] = {400.0f, 800.0f, 1600.0f, 3200.0f, 6400.0f};

static bool write_register(unsigned part, unsigned address, unsigned value) {
    uint8_t bytes[2] = {(uint8_t)(address << 1), (uint8_t)value};
    return spi_bus_transfer(part, bytes, bytes, sizeof bytes);
}

/* Reads to bytes[1] and following; bytes[0] is the command. */
static bool read_registers(unsigned part, unsigned address, uint8_t *bytes, size_t size) {
    memset(bytes, 0, size + 1u);
    bytes[0] = (uint8_t)(address << 1 | 1u);
    return spi_bus_transfer(part, bytes, bytes, size + 1u);
}

static bool write_checked(unsigned part, unsigned address, unsigned value) {
    uint8_t bytes[2];
    return write_register(part, address, value) && read_registers(part, address, bytes, 1) && bytes[1] == value;
}

adxl372_outcome adxl372_reset(unsigned part) {
    uint8_t bytes[1u + sizeof ids];
    bool answers = read_registers(part, DEVICE_IDS, bytes, sizeof ids) && memcmp(bytes + 1, ids, sizeof ids) == 0 &&
                   write_register(part, RESET, RESET_CODE);
    return answers ? ADXL372_OK : ADXL372_NO_ANSWER;
}

adxl372_outcome adxl372_start(unsigned part, float wanted_hz, float *rate_hz) {
    unsigned code = 0;
    while (code + 1u < sizeof rates_hz / sizeof rates_hz[0] &&
           wanted_hz - rates_hz[code] > rates_hz[code + 1u] - wanted_hz) {
        code++;
    }
    *rate_hz = rates_hz[code];
    /* The FIFO may be changed in standby only; bypass empties it. */
    bool started = write_checked(part, POWER_CONTROL, STANDBY) && write_checked(part, FIFO_CONTROL, FIFO_BYPASS) &&
                   write_checked(part, TIMING, code << RATE_AT) && write_checked(part, MEASURE, code) &&
                   write_checked(part, FIFO_CONTROL, FIFO_STREAM_XYZ) &&
                   write_checked(part, POWER_CONTROL, MEASURING);
    return started ? ADXL372_OK : ADXL372_NO_ANSWER;
}

adxl372_outcome adxl372_read(unsigned part, int16_t *counts, uint32_t *rows, uint32_t *left) {
    uint8_t bytes[1u + ADXL372_MOST_ROWS * ROW_BYTES];
    *rows = 0;
    *left = 0;
    if (!read_registers(part, STATUS, bytes, 4)) {
        return ADXL372_NO_ANSWER;
    }
    if ((bytes[1] & FIFO_OVERRUN) != 0) {
        return ADXL372_OVERRUN;
    }
    uint32_t stored = ((bytes[3] & 3u) << 8 | bytes[4]) / AXES;
    if (stored < 2u) {
        return ADXL372_OK;
    }
    uint32_t taken = stored - 1u < ADXL372_MOST_ROWS ? stored - 1u : ADXL372_MOST_ROWS;
    if (!read_registers(part, FIFO_DATA, bytes, taken * ROW_BYTES)) {
        return ADXL372_NO_ANSWER;
    }
    for (uint32_t i = 0; i < taken * AXES; i++) {
        uint16_t word = (uint16_t)(bytes[1u + 2u * i] << 8 | bytes[2u + 2u * i]);
        if ((word & BEGINS_ROW) != (i % AXES == 0 ? BEGINS_ROW : 0u)) {
            return ADXL372_TORN;
        }
        counts[i] = (int16_t)((int16_t)word >> 4);
    }
    *rows = taken;
    *left = stored - taken;
    return ADXL372_OK;
}
