#include "tl_block_ring.h"

#include <string.h>

_Static_assert((TL_RING_BLOCKS & (TL_RING_BLOCKS - 1u)) == 0, "TL_RING_BLOCKS is not a power of two");

bool tl_ring_put(tl_block_ring *ring, const tl_block *head, const int16_t *counts, size_t words) {
    unsigned written = atomic_load_explicit(&ring->written, memory_order_relaxed);
    if (words > TL_BLOCK_COUNTS || written - atomic_load_explicit(&ring->read, memory_order_acquire) >= TL_RING_BLOCKS) {
        return false;
    }
    tl_block *block = &ring->blocks[written % TL_RING_BLOCKS];
    block->first_sample = head->first_sample;
    block->tick_us = head->tick_us;
    block->n = head->n;
    memcpy(block->counts, counts, words * sizeof *counts);
    atomic_store_explicit(&ring->written, written + 1u, memory_order_release);
    return true;
}

const tl_block *tl_ring_oldest(tl_block_ring *ring) {
    unsigned read = atomic_load_explicit(&ring->read, memory_order_relaxed);
    if (atomic_load_explicit(&ring->written, memory_order_acquire) == read) {
        return NULL;
    }
    return &ring->blocks[read % TL_RING_BLOCKS];
}

void tl_ring_release(tl_block_ring *ring) {
    unsigned read = atomic_load_explicit(&ring->read, memory_order_relaxed);
    atomic_store_explicit(&ring->read, read + 1u, memory_order_release);
}
