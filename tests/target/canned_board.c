/* A board whose line is a text: the requests are compiled in (REQUESTS, a header with their bytes), each byte of the
 * answers is printed as a line "=xx". On an AVR it prints over UART 0, then sleeps for good, which ends simavr. */
#include HEADER
#include REQUESTS

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)

#ifdef __AVR__
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

static void print(int letter)
{
    while ((UCSR0A & (1 << UDRE0)) == 0) {
    }
    UDR0 = (unsigned char)letter;
}

static void finish(void)
{
    cli();
    sleep_mode();
}
#else
#include <stdio.h>

static void print(int letter)
{
    putchar(letter);
}

static void finish(void)
{
}
#endif

static int at;
static Uint32 now;

int pmsm_board_get(void)
{
    return (at < REQUEST_BYTES) ? (int)requests[at++] : -1;
}

int pmsm_board_put(Uint16 byte)
{
    static const char digits[] = "0123456789abcdef";
    print('=');
    print(digits[(byte >> 4) & 15u]);
    print(digits[byte & 15u]);
    print('\n');
    return 1;
}

Uint32 pmsm_board_ticks(void)
{
    now += 70001uL; /* more than 16 bits, the same everywhere */
    return now;
}

int main(void)
{
    static pmsm_pil_t pil;
    static JOIN(FILTER, _t) filter;
#ifdef __AVR__
    UCSR0B = 1 << TXEN0;
#endif
    JOIN(FILTER, _pil_init)(&pil, &filter);
    while (at < REQUEST_BYTES) {
        pmsm_pil_poll(&pil);
    }
    pmsm_pil_poll(&pil);
    finish();
    return 0;
}
