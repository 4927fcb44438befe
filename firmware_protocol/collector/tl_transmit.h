/* Bounded transmit queue of whole frames. Full means drop, never wait. */
#ifndef TL_TRANSMIT_H
#define TL_TRANSMIT_H

#include "treadlink_protocol.h"

#include <stdbool.h>

#ifndef TL_QUEUE_FRAMES
#define TL_QUEUE_FRAMES 16u /* frames of up to 244 bytes */
#endif

/* Places that samples leave free, so that HELLO and COMMAND_RESULT pass during an overrun. */
#define TL_QUEUE_RESERVED 3u

typedef struct {
    uint8_t frames[TL_QUEUE_FRAMES][TL_MAX_FRAME_BYTES];
    uint8_t sizes[TL_QUEUE_FRAMES];
    uint32_t oldest;
    uint32_t count;
    size_t sent_of_oldest; /* bytes of the oldest frame that the link has taken */
    uint32_t frames_sent;
} tl_transmit_queue;

/* Returns room for one frame, or NULL when there is none. `reserved` places are left free. */
uint8_t *tl_transmit_room(tl_transmit_queue *queue, uint32_t reserved);

/* Adds the frame that was written to the room. */
void tl_transmit_add(tl_transmit_queue *queue, size_t size);

/* Hands as much to the link as it takes. */
void tl_transmit_run(tl_transmit_queue *queue);

/* Empties the queue and returns the number of frames that were in it. */
uint32_t tl_transmit_clear(tl_transmit_queue *queue);

#endif
