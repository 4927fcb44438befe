/* Frames that commands cause. Internal to the collector. */
#ifndef TL_FRAMES_H
#define TL_FRAMES_H

#include "tl_collector.h"

/* Frames the waiting blocks of a wheel. */
void tl_frames_blocks(tl_collector *collector, tl_wheel *wheel);

/* Sends the samples of a frame that is not full. */
void tl_frames_samples(tl_collector *collector, tl_wheel *wheel);

void tl_frames_result(tl_collector *collector, const tl_command_result *result);

void tl_frames_challenge_answer(tl_collector *collector, const tl_challenge_answer *answer);

#endif
