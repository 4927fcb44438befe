/* A hub on this computer: the collector behind a TCP port, its sensor a file of raw words that is played in a circle.

   host_collector --tcp PORT --sensor FILE [--flash FILE] [--keys FILE]

   A line of the sensor's file holds the words of one sample, in ascending order of the axes. Lines `# name value` state
   rate_hz, scale_mps2, range_mps2 and axes. The flash keeps the number of starts; it is a file, too. The file
   of keys has lines as `treadlink keys import` reads them: a serial number of 8 (sensor) or 16 digits (hub), and a key. */
#include "tl_boot_count.h"
#include "tl_collector.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define MOST_ROWS 1000000u
#define BLOCK_ROWS 32u
#define POLL_NS 1000000
#define LOWEST_RATE_HZ 2000.0

static int server = -1;
static int client = -1;
static const char *flash_name = "host_collector.flash";
static uint8_t flash[2][TL_BOOT_PAGE_BYTES];
static uint64_t begin_us;
static tl_collector collector;

/* The sensor: its rows, the one in turn, how many it leaves out at a lower rate, and when it started. */
static int16_t *rows;
static size_t row_count;
static size_t channels;
static size_t stride = 1;
static double file_rate_hz = 4000.0;
static double rate_hz;
static double scale_mps2 = 0.125;
static double range_mps2 = 4000.0;
static uint64_t sensor_begin_us;
static uint64_t taken;

static _Noreturn void fail(const char *what, const char *name) {
    fprintf(stderr, "host_collector: %s '%s'%s%s\n", what, name, errno != 0 ? ": " : "",
            errno != 0 ? strerror(errno) : "");
    exit(1);
}

static uint64_t now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

uint32_t tl_port_clock_us(void) {
    return (uint32_t)(now_us() - begin_us);
}

static void hang_up(void) {
    close(client);
    client = -1;
}

size_t tl_port_send(const uint8_t *data, size_t size) {
    ssize_t sent = client < 0 ? 0 : send(client, data, size, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && errno != EAGAIN && errno != EWOULDBLOCK) {
        hang_up();
    }
    return sent < 0 ? 0 : (size_t)sent;
}

size_t tl_port_receive(uint8_t *data, size_t size) {
    ssize_t received = client < 0 ? -1 : recv(client, data, size, MSG_DONTWAIT);
    if (received == 0 || (received < 0 && client >= 0 && errno != EAGAIN && errno != EWOULDBLOCK)) {
        hang_up();
    }
    return received < 0 ? 0 : (size_t)received;
}

bool tl_port_listening(void) {
    if (client < 0) {
        int one = 1;
        client = accept(server, NULL, NULL);
        if (client >= 0) {
            (void)setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
        }
    }
    return client >= 0;
}

/* The rate of the file, or the half, third ... of it. */
bool tl_port_set_rate(uint8_t wheel, float wanted_hz, float *taken_hz) {
    (void)wheel;
    stride = 1;
    for (size_t i = 2; file_rate_hz / (double)i >= LOWEST_RATE_HZ; i++) {
        double away = file_rate_hz / (double)i - (double)wanted_hz;
        double best = file_rate_hz / (double)stride - (double)wanted_hz;
        if (away * away < best * best) {
            stride = i;
        }
    }
    rate_hz = file_rate_hz / (double)stride;
    *taken_hz = (float)rate_hz;
    sensor_begin_us = now_us();
    taken = 0;
    return true;
}

void tl_port_environment(uint8_t wheel, tl_environment *environment) {
    (void)wheel;
    *environment = (tl_environment){230000, 2500, 3000};
}

void tl_port_hub_status(tl_hub_status *status) {
    status->battery_percent = TL_HUB_STATUS_BATTERY_PERCENT_NONE;
    status->rssi_dbm = TL_HUB_STATUS_RSSI_DBM_NONE;
}

void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size) {
    memcpy(data, flash[page] + at, size);
}

static bool store_flash(void) {
    FILE *file = fopen(flash_name, "wb");
    if (file == NULL) {
        return false;
    }
    bool written = fwrite(flash, 1, sizeof flash, file) == sizeof flash;
    return fclose(file) == 0 && written;
}

bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size) {
    memcpy(flash[page] + at, data, size);
    return store_flash();
}

bool tl_port_flash_erase(unsigned page) {
    memset(flash[page], 0xFF, sizeof flash[page]);
    return store_flash();
}

uint32_t tl_port_random(void) {
    return (uint32_t)now_us() * 2654435761u;
}

void tl_port_feed_watchdog(void) {
}

_Noreturn void tl_port_reset(void) {
    exit(3);
}

static void load_flash(void) {
    memset(flash, 0xFF, sizeof flash);
    FILE *file = fopen(flash_name, "rb");
    if (file != NULL) {
        if (fread(flash, 1, sizeof flash, file) != sizeof flash) {
            errno = 0;
            fail("this is no flash of a collector:", flash_name);
        }
        (void)fclose(file);
    }
    errno = 0;
}

static void set_stated(const char *name, double value, tl_wheel_config *wheel) {
    if (strcmp(name, "rate_hz") == 0) {
        file_rate_hz = value;
    } else if (strcmp(name, "scale_mps2") == 0) {
        scale_mps2 = value;
    } else if (strcmp(name, "range_mps2") == 0) {
        range_mps2 = value;
    } else if (strcmp(name, "axes") == 0 && value >= 1.0 && value <= 7.0) {
        wheel->axes = (uint8_t)value;
    }
}

static bool take_row(char *line) {
    char *at = line;
    for (size_t i = 0; i < channels; i++) {
        char *end;
        long word = strtol(at, &end, 10);
        if (end == at || word < -32768 || word > 32767) {
            return false;
        }
        rows[row_count * channels + i] = (int16_t)word;
        at = end + strspn(end, ", \t;");
    }
    row_count++;
    return *at == '\n' || *at == '\r' || *at == '\0';
}

static void load_sensor(const char *name, tl_wheel_config *wheel) {
    char line[200];
    FILE *file = fopen(name, "r");
    if (file == NULL) {
        fail("cannot open the sensor's file", name);
    }
    rows = malloc(MOST_ROWS * 3u * sizeof *rows);
    for (unsigned long number = 1; rows != NULL && row_count < MOST_ROWS && fgets(line, sizeof line, file); number++) {
        channels = (size_t)((wheel->axes & 1) + (wheel->axes >> 1 & 1) + (wheel->axes >> 2 & 1));
        if (line[0] == '#') {
            char word[32];
            double value;
            if (sscanf(line, "# %31s %lf", word, &value) == 2) {
                set_stated(word, value, wheel);
            }
        } else if (!take_row(line)) {
            fprintf(stderr, "host_collector: line %lu of '%s' is not %zu words of 16 bits\n", number, name, channels);
            exit(1);
        }
    }
    (void)fclose(file);
    if (row_count == 0) {
        errno = 0;
        fail("there is no sample in", name);
    }
}

static void load_keys(const char *name, tl_wheel_config *wheel, tl_collector_config *config) {
    static uint8_t hub_key[16];
    static uint8_t sensor_key[16];
    char line[200];
    FILE *file = fopen(name, "r");
    if (file == NULL) {
        fail("cannot open the file of keys", name);
    }
    for (unsigned long number = 1; fgets(line, sizeof line, file); number++) {
        char serial[18];
        char digits[34];
        if (line[0] == '#' || line[0] == '\n') {
            continue;
        }
        if (sscanf(line, "%17[0-9A-Fa-f] %33[0-9A-Fa-f]", serial, digits) != 2 || strlen(digits) != 32 ||
            (strlen(serial) != 8 && strlen(serial) != 16)) {
            fprintf(stderr, "host_collector: line %lu of '%s' is not a serial number and a key\n", number, name);
            exit(1);
        }
        bool is_hub = strlen(serial) == 16 && strtoull(serial, NULL, 16) == config->hub_id;
        bool is_sensor = strlen(serial) == 8 && strtoull(serial, NULL, 16) == wheel->sensor_id;
        uint8_t *key = is_hub ? hub_key : sensor_key;
        for (size_t i = 0; (is_hub || is_sensor) && i < 16; i++) {
            const char pair[3] = {digits[2 * i], digits[2 * i + 1], '\0'};
            key[i] = (uint8_t)strtoul(pair, NULL, 16);
        }
        config->key = is_hub ? hub_key : config->key;
        wheel->key = is_sensor ? sensor_key : wheel->key;
    }
    (void)fclose(file);
    if (config->key == NULL || wheel->key == NULL) {
        errno = 0;
        fail("there are no keys of hub 0000000000007ead and sensor 0000a001 in", name);
    }
}

/* The next block that the sensor has taken, as its interrupt would hand it over; false: there is none. A process that
   the computer wakes late has all of them still. */
static bool take_block(void) {
    int16_t words[BLOCK_ROWS * 3u];
    uint64_t due = (uint64_t)((double)(now_us() - sensor_begin_us) * 1e-6 * rate_hz);
    if (taken >= due) {
        return false;
    }
    uint32_t n = due - taken < BLOCK_ROWS ? (uint32_t)(due - taken) : BLOCK_ROWS;
    for (uint32_t i = 0; i < n; i++) {
        size_t row = (size_t)((taken + i) * stride % row_count);
        memcpy(words + i * channels, rows + row * channels, channels * sizeof *words);
    }
    uint64_t first_us = sensor_begin_us + (uint64_t)((double)taken / rate_hz * 1e6);
    tl_collector_put(&collector, 0, words, n, (uint32_t)(first_us - begin_us));
    taken += n;
    return true;
}

static void listen_on(const char *port) {
    struct sockaddr_in address = {.sin_family = AF_INET};
    char *end;
    unsigned long number = strtoul(port, &end, 10);
    socklen_t size = sizeof address;
    int one = 1;
    if (*end != '\0' || number > 65535) {
        errno = 0;
        fail("this is no port:", port);
    }
    address.sin_port = htons((uint16_t)number);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    server = socket(AF_INET, SOCK_STREAM, 0);
    (void)setsockopt(server, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    if (server < 0 || bind(server, (struct sockaddr *)&address, sizeof address) != 0 || listen(server, 1) != 0 ||
        fcntl(server, F_SETFL, O_NONBLOCK) != 0 || getsockname(server, (struct sockaddr *)&address, &size) != 0) {
        fail("cannot listen on port", port);
    }
    printf("tcp://127.0.0.1:%u\n", (unsigned)ntohs(address.sin_port));
    (void)fflush(stdout);
}

static const char *option(int count, char **arguments, const char *name) {
    for (int i = 1; i + 1 < count; i += 2) {
        if (strcmp(arguments[i], name) == 0) {
            return arguments[i + 1];
        }
    }
    return NULL;
}

int main(int count, char **arguments) {
    static tl_wheel_config wheel = {.axes = 7, .sensor_id = 0xA001, .saturation_counts = 32767};
    static tl_collector_config config = {.hub_id = 0x7EAD, .firmware_major = 1, .wheels = &wheel, .wheel_count = 1};
    const char *sensor = option(count, arguments, "--sensor");
    const char *port = option(count, arguments, "--tcp");
    if (port == NULL || sensor == NULL) {
        fprintf(stderr, "host_collector --tcp PORT --sensor FILE [--flash FILE] [--keys FILE]\n");
        return 2;
    }
    if (option(count, arguments, "--flash") != NULL) {
        flash_name = option(count, arguments, "--flash");
    }
    load_sensor(sensor, &wheel);
    if (option(count, arguments, "--keys") != NULL) {
        load_keys(option(count, arguments, "--keys"), &wheel, &config);
    }
    load_flash();
    for (size_t i = 0; i < 3; i++) {
        bool present = (wheel.axes >> i & 1) != 0;
        wheel.scale_mps2[i] = present ? (float)scale_mps2 : 0.0f;
        wheel.range_mps2[i] = present ? (float)range_mps2 : 0.0f;
    }
    begin_us = now_us();
    (void)tl_port_set_rate(0, (float)file_rate_hz, &wheel.rate_hz);
    if (!tl_collector_start(&collector, &config)) {
        errno = 0;
        fail("the collector does not take rate, scale or range of", sensor);
    }
    listen_on(port);
    for (;;) {
        const struct timespec pause = {.tv_nsec = POLL_NS};
        bool took = take_block();
        tl_collector_poll(&collector);
        if (!took) {
            nanosleep(&pause, NULL);
        }
    }
}
