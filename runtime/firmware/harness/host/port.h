/* port.h of the host: no output, no counter; the caller takes the words from memory. */
#ifndef PORT_H
#define PORT_H

#include <stddef.h>
#include <stdint.h>

#define HARNESS_HOST
#define TABLE
#define READ(word) (word)
#define port_ticks() 0
#define port_elapsed(before, after) ((before) + (after))

#endif
