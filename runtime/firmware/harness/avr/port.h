/* port.h of the ATmega1284P under simavr: output through the first UART, cycles / 256 through timer 1. */
#ifndef PORT_H
#define PORT_H

#include <avr/pgmspace.h>
#include <stddef.h>
#include <stdint.h>

/* The recording stays in flash, in its first 64 kB. */
#define TABLE PROGMEM
#define READ(word) pgm_read_dword(&(word))

void port_start(void);
void port_stop(void);
void port_print(const char *text);
uint32_t port_known_loop(void);
uint32_t port_ticks(void);
uint32_t port_elapsed(uint32_t before, uint32_t after);

#endif
