/* Number of starts, kept in two flash pages. A power cut at any instruction neither repeats nor loses it. */
#ifndef TL_BOOT_COUNT_H
#define TL_BOOT_COUNT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef TL_BOOT_PAGE_BYTES
#define TL_BOOT_PAGE_BYTES 4096u
#endif
#define TL_BOOT_RECORD_BYTES 16u

/* Stores a count above every count that it has returned before. False when the flash cannot store it. */
bool tl_boot_count_next(uint32_t *count);

#endif
