#include "ms5803.h"

#include "spi_bus.h"

#define RESET 0x1Eu
#define READ_CONVERSION 0x00u
#define READ_PROM 0xA0u
#define CONVERT_PRESSURE 0x48u /* oversampling 4096: 9.04 ms at most */
#define CONVERT_TEMPERATURE 0x58u

static bool command(unsigned part, uint8_t code) {
    return spi_bus_transfer(part, &code, &code, 1);
}

bool ms5803_reset(unsigned part) {
    return command(part, RESET);
}

static unsigned prom_check(const uint16_t prom[8]) {
    unsigned remainder = 0;
    for (unsigned i = 0; i < 16; i++) {
        unsigned word = i == 15 ? 0 : prom[i / 2u]; /* the last byte holds the check sum itself */
        remainder ^= i % 2u == 0 ? word >> 8 : word & 0xFFu;
        for (unsigned bit = 0; bit < 8; bit++) {
            remainder = (remainder & 0x8000u) != 0 ? (remainder << 1 ^ 0x3000u) & 0xFFFFu : remainder << 1;
        }
    }
    return remainder >> 12;
}

bool ms5803_open(ms5803 *sensor, unsigned part) {
    *sensor = (ms5803){.part = part};
    bool all_zero = true;
    for (unsigned i = 0; i < 8; i++) {
        uint8_t bytes[3] = {(uint8_t)(READ_PROM + 2u * i), 0, 0};
        if (!spi_bus_transfer(part, bytes, bytes, sizeof bytes)) {
            return false;
        }
        sensor->prom[i] = (uint16_t)(bytes[1] << 8 | bytes[2]);
        all_zero = all_zero && sensor->prom[i] == 0;
    }
    /* A dead line reads as zeros, whose check sum is right. */
    return !all_zero && prom_check(sensor->prom) == (sensor->prom[7] & 0xFu) && command(part, CONVERT_PRESSURE);
}

static void compensate(ms5803 *sensor, uint32_t temperature_raw) {
    const uint16_t *c = sensor->prom;
    int64_t dt = (int64_t)temperature_raw - ((int64_t)c[5] << 8);
    int64_t temperature = 2000 + dt * c[6] / (1 << 23);
    int64_t offset = ((int64_t)c[2] << 16) + c[4] * dt / (1 << 7);
    int64_t sensitivity = ((int64_t)c[1] << 15) + c[3] * dt / (1 << 8);
    int64_t below = temperature - 2000;
    int64_t correction;
    if (temperature < 2000) {
        correction = 3 * dt * dt / ((int64_t)1 << 33);
        offset -= 3 * below * below / 2;
        sensitivity -= 5 * below * below / 8;
        if (temperature < -1500) {
            int64_t cold = temperature + 1500;
            offset -= 7 * cold * cold;
            sensitivity -= 4 * cold * cold;
        }
    } else {
        correction = 7 * dt * dt / ((int64_t)1 << 37);
        offset -= below * below / 16;
    }
    /* In units of 0.1 mbar, 10 Pa. */
    int64_t pressure = (sensor->pressure_raw * sensitivity / (1 << 21) - offset) / (1 << 15);
    sensor->pressure_pa = (int32_t)(10 * pressure);
    sensor->temperature_cdegc = (int16_t)(temperature - correction);
    sensor->ready = true;
}

bool ms5803_step(ms5803 *sensor) {
    uint8_t bytes[4] = {READ_CONVERSION, 0, 0, 0};
    if (!spi_bus_transfer(sensor->part, bytes, bytes, sizeof bytes)) {
        return false;
    }
    uint32_t raw = (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
    bool converted = raw != 0; /* zero says that the conversion had not ended */
    if (converted && sensor->converts_temperature) {
        compensate(sensor, raw);
    } else if (converted) {
        sensor->pressure_raw = raw;
    }
    sensor->converts_temperature = converted && !sensor->converts_temperature;
    return command(sensor->part, sensor->converts_temperature ? CONVERT_TEMPERATURE : CONVERT_PRESSURE) && converted;
}
