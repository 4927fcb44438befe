#include "tl_boot_count.h"

#include "tl_port.h"

#include <string.h>

/* A page is a log of records: count, its complement, a mark, and the CRC-32 of these 12 bytes. The highest valid record
   is the count of the last start. A record is written and read back before its count is used, so a record that a power
   cut tore was never used. When a page is full, the other one is erased and continues the log; until its first record
   is complete, the full page still holds the highest count. */

#define RECORDS (TL_BOOT_PAGE_BYTES / TL_BOOT_RECORD_BYTES)
#define MARK 0x544F4F42u
#define ATTEMPTS 4u

_Static_assert(RECORDS >= 2, "a page holds at least two records");

typedef struct {
    uint32_t count;
    uint32_t complement;
    uint32_t mark;
    uint32_t crc;
} record;

_Static_assert(sizeof(record) == TL_BOOT_RECORD_BYTES, "a record has padding");

typedef struct {
    uint32_t highest; /* 0 when there is no valid record */
    uint32_t unknown; /* damaged records behind the highest */
    size_t used;      /* records that are not erased, up to the last such one */
} page_content;

static uint32_t crc_of(const record *entry) {
    const uint8_t *bytes = (const uint8_t *)entry;
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t i = 0; i < offsetof(record, crc); i++) {
        crc ^= bytes[i];
        for (unsigned bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    return crc ^ 0xFFFFFFFFu;
}

static record read_record(unsigned page, size_t number) {
    record entry;
    tl_port_flash_read(page, number * TL_BOOT_RECORD_BYTES, (uint8_t *)&entry, sizeof entry);
    return entry;
}

static bool is_erased(const record *entry) {
    return (entry->count & entry->complement & entry->mark & entry->crc) == 0xFFFFFFFFu;
}

static bool is_valid(const record *entry) {
    return entry->complement == ~entry->count && entry->mark == MARK && entry->crc == crc_of(entry);
}

static page_content read_page(unsigned page) {
    page_content content = {0, 0, 0};
    for (size_t number = 0; number < RECORDS; number++) {
        record entry = read_record(page, number);
        if (is_erased(&entry)) {
            continue;
        }
        content.used = number + 1;
        if (!is_valid(&entry)) {
            content.unknown++;
        } else if (entry.count > content.highest) {
            content.highest = entry.count;
            content.unknown = 0;
        }
    }
    return content;
}

static bool write_record(unsigned page, size_t number, uint32_t count) {
    record entry = {count, ~count, MARK, 0};
    entry.crc = crc_of(&entry);
    if (!tl_port_flash_write(page, number * TL_BOOT_RECORD_BYTES, (const uint8_t *)&entry, sizeof entry)) {
        return false;
    }
    record stored = read_record(page, number);
    return memcmp(&stored, &entry, sizeof entry) == 0;
}

bool tl_boot_count_next(uint32_t *count) {
    page_content pages[2] = {read_page(0), read_page(1)};
    unsigned page = pages[1].highest > pages[0].highest ? 1u : 0u;
    /* A damaged record may have been a count that was used, before the flash lost it: leave its number out. */
    uint32_t beyond = pages[page].unknown + 1u;
    if (pages[page ^ 1u].highest == 0) {
        beyond += pages[page ^ 1u].unknown; /* it may be the newer page */
    }
    if (pages[page].highest > UINT32_MAX - beyond) {
        return false;
    }
    uint32_t next = pages[page].highest + beyond;
    size_t number = pages[page].used;
    for (unsigned attempt = 0; attempt < ATTEMPTS; attempt++) {
        if (number >= RECORDS) {
            page ^= 1u;
            number = 0;
            if (!tl_port_flash_erase(page)) {
                return false;
            }
        }
        if (write_record(page, number, next)) {
            *count = next;
            return true;
        }
        number++;
    }
    return false;
}
