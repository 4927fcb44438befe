/* Ring of sample blocks from one interrupt to the main loop: one writer, one reader, no lock. */
#ifndef TL_BLOCK_RING_H
#define TL_BLOCK_RING_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifndef TL_RING_BLOCKS
#define TL_RING_BLOCKS 8u /* a power of two */
#endif
#ifndef TL_BLOCK_COUNTS
#define TL_BLOCK_COUNTS 120u /* raw words of a block, all axes */
#endif

typedef struct {
    uint32_t first_sample;
    uint32_t tick_us; /* of the first sample */
    uint32_t n;
    int16_t counts[TL_BLOCK_COUNTS];
} tl_block;

typedef struct {
    tl_block blocks[TL_RING_BLOCKS];
    atomic_uint written;
    atomic_uint read;
} tl_block_ring;

/* Interrupt: copies a block. False when the ring is full. */
bool tl_ring_put(tl_block_ring *ring, const tl_block *head, const int16_t *counts, size_t words);

/* Main loop: returns the oldest block, NULL when there is none. It stays valid until tl_ring_release. */
const tl_block *tl_ring_oldest(tl_block_ring *ring);
void tl_ring_release(tl_block_ring *ring);

#endif
