/* A wheel on an STM32F405: an ADXL372 and an MS5803-14BA at SPI 1, the link at USART 1. */
#include "adxl372.h"
#include "board.h"
#include "ms5803.h"
#include "tl_collector.h"

#ifndef BOARD_HUB_ID
#define BOARD_HUB_ID 1u
#endif
#ifndef BOARD_SENSOR_ID
#define BOARD_SENSOR_ID 1u
#endif
/* The part measures absolute pressure, the protocol has it above the ambient one. */
#ifndef BOARD_AMBIENT_PA
#define BOARD_AMBIENT_PA 101325
#endif
#define RATE_HZ 6400.0f
#define SLOW_US 20000u

static const tl_wheel_config wheel = {
    .axes = 7,
    .sensor_id = BOARD_SENSOR_ID,
    .rate_hz = RATE_HZ,
    .range_mps2 = {ADXL372_RANGE_MPS2, ADXL372_RANGE_MPS2, ADXL372_RANGE_MPS2},
    .scale_mps2 = {ADXL372_SCALE_MPS2, ADXL372_SCALE_MPS2, ADXL372_SCALE_MPS2},
    .saturation_counts = ADXL372_SATURATION_COUNTS,
};
static const tl_collector_config config = {.hub_id = BOARD_HUB_ID, .wheels = &wheel, .wheel_count = 1};

static tl_collector collector;
static ms5803 pressure;
static bool has_pressure;
static float rate_hz = RATE_HZ;

bool tl_port_set_rate(uint8_t number, float wanted_hz, float *set_hz) {
    (void)number;
    if (adxl372_start(BOARD_ACCELEROMETER, wanted_hz, set_hz) != ADXL372_OK) {
        return false;
    }
    rate_hz = *set_hz;
    return true;
}

void tl_port_environment(uint8_t number, tl_environment *environment) {
    (void)number;
    bool known = has_pressure && pressure.ready;
    *environment = (tl_environment){
        .pressure_pa = known ? pressure.pressure_pa - BOARD_AMBIENT_PA : TL_ENVIRONMENT_PRESSURE_PA_NONE,
        .temperature_cdegc = known ? pressure.temperature_cdegc : (int16_t)TL_ENVIRONMENT_TEMPERATURE_CDEGC_NONE,
        .supply_mv = TL_ENVIRONMENT_SUPPLY_MV_NONE,
    };
}

void tl_port_hub_status(tl_hub_status *status) {
    status->battery_percent = TL_HUB_STATUS_BATTERY_PERCENT_NONE;
    status->rssi_dbm = TL_HUB_STATUS_RSSI_DBM_NONE;
}

bool tl_port_listening(void) {
    return true;
}

/* The rows in the FIFO end now, within one sample; so the first one was taken this long ago. */
static void take_samples(void) {
    static int16_t counts[3u * ADXL372_MOST_ROWS];
    uint32_t rows;
    uint32_t left;
    uint32_t now_us = tl_port_clock_us();
    adxl372_outcome outcome = adxl372_read(BOARD_ACCELEROMETER, counts, &rows, &left);
    if (outcome != ADXL372_OK) {
        static const char *const texts[] = {
            [ADXL372_OK] = "",
            [ADXL372_NO_ANSWER] = "ADXL372: no answer",
            [ADXL372_OVERRUN] = "ADXL372: FIFO overrun, samples lost",
            [ADXL372_TORN] = "ADXL372: rows of the FIFO torn, samples lost",
        };
        tl_collector_log(&collector, TL_LOG_ERROR, texts[outcome]);
        (void)adxl372_start(BOARD_ACCELEROMETER, rate_hz, &rate_hz);
    } else if (rows > 0) {
        uint32_t age_us = (uint32_t)((float)(rows + left - 1u) * 1e6f / rate_hz);
        tl_collector_put(&collector, 0, counts, rows, now_us - age_us);
    }
}

static void take_environment(void) {
    static uint32_t taken_us;
    if (tl_port_clock_us() - taken_us >= SLOW_US) {
        taken_us = tl_port_clock_us();
        has_pressure = ms5803_step(&pressure);
    }
}

int main(void) {
    board_open();
    (void)ms5803_reset(BOARD_PRESSURE);
    bool answers = adxl372_reset(BOARD_ACCELEROMETER) == ADXL372_OK;
    board_wait_ms(5);
    bool opened = ms5803_open(&pressure, BOARD_PRESSURE);
    answers = answers && adxl372_start(BOARD_ACCELEROMETER, RATE_HZ, &rate_hz) == ADXL372_OK;
    if (!tl_collector_start(&collector, &config)) {
        tl_port_reset();
    }
    if (!answers) {
        tl_collector_log(&collector, TL_LOG_ERROR, "ADXL372: no answer");
    }
    for (;;) {
        if (answers) {
            take_samples();
        }
        if (opened) {
            take_environment();
        }
        tl_collector_poll(&collector);
        board_sleep();
    }
}
