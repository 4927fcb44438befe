#include "tl_transmit.h"

#include "tl_port.h"

_Static_assert(TL_QUEUE_FRAMES > TL_QUEUE_RESERVED, "the queue has no place for samples");

uint8_t *tl_transmit_room(tl_transmit_queue *queue, uint32_t reserved) {
    if (queue->count + reserved >= TL_QUEUE_FRAMES) {
        return NULL;
    }
    return queue->frames[(queue->oldest + queue->count) % TL_QUEUE_FRAMES];
}

void tl_transmit_add(tl_transmit_queue *queue, size_t size) {
    queue->sizes[(queue->oldest + queue->count) % TL_QUEUE_FRAMES] = (uint8_t)size;
    queue->count++;
}

void tl_transmit_run(tl_transmit_queue *queue) {
    while (queue->count > 0) {
        const uint8_t *frame = queue->frames[queue->oldest];
        size_t left = queue->sizes[queue->oldest] - queue->sent_of_oldest;
        size_t taken = tl_port_send(frame + queue->sent_of_oldest, left);
        queue->sent_of_oldest += taken;
        if (taken < left) {
            return;
        }
        queue->sent_of_oldest = 0;
        queue->oldest = (queue->oldest + 1u) % TL_QUEUE_FRAMES;
        queue->count--;
        queue->frames_sent++;
    }
}

uint32_t tl_transmit_clear(tl_transmit_queue *queue) {
    uint32_t dropped = queue->count;
    queue->count = 0;
    queue->sent_of_oldest = 0;
    return dropped;
}
