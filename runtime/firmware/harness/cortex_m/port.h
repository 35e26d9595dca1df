/* port.h of the Cortex-M boards under qemu: output by semihosting, time by SysTick. */
#ifndef PORT_H
#define PORT_H

#include <stddef.h>
#include <stdint.h>

#define TABLE
#define READ(word) (word)

void port_start(void);
void port_stop(void);
void port_print(const char *text);
uint32_t port_known_loop(void);

/* SysTick: 24 bits, counts down with the processor clock. */
#define SYSTICK_VALUE (*(volatile uint32_t *)0xe000e018)
#define port_ticks() SYSTICK_VALUE
#define port_elapsed(before, after) (((before) - (after)) & 0xffffff)

#endif
