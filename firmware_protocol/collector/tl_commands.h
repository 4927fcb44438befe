/* Commands from the gateway. Internal to the collector. */
#ifndef TL_COMMANDS_H
#define TL_COMMANDS_H

#include "tl_collector.h"

/* Reads what has arrived, and carries out the commands in it. */
void tl_commands_receive(tl_collector *collector);

/* Allows new answers to refused commands, and logs their number. */
void tl_commands_each_second(tl_collector *collector);

#endif
