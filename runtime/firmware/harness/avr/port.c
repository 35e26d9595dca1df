/* port.c of the ATmega1284P under simavr. */
#include "port.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <util/delay_basic.h>

void port_start(void)
{
    UCSR0B = 1 << TXEN0;
    UCSR0A = 1 << U2X0;
    UBRR0 = 0; /* a bit is 8 cycles */
    TCCR1B = 1 << CS12; /* clock / 256 */
}

/* Sleeping with interrupts off ends the simulation. */
void port_stop(void)
{
    cli();
    sleep_mode();
}

void port_print(const char *text)
{
    for (; *text; text++) {
        UDR0 = (uint8_t)*text;
        _delay_loop_2(25); /* 10 bits; waiting by flag would make the simulator sleep in real time */
    }
}

/* 4 cycles a turn: 64000 cycles, 250 ticks. */
uint32_t port_known_loop(void)
{
    const uint16_t before = TCNT1;
    _delay_loop_2(16000);
    return (uint16_t)(TCNT1 - before);
}

uint32_t port_ticks(void)
{
    return TCNT1;
}

uint32_t port_elapsed(uint32_t before, uint32_t after)
{
    return (uint16_t)(after - before);
}
