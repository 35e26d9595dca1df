/* port.c of the Cortex-M boards: start-up, semihosting, SysTick. */
#include "port.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xe000e010)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xe000e014)
#define COPROCESSORS (*(volatile uint32_t *)0xe000ed88)

extern uint32_t data_start, data_end, data_image, bss_start, bss_end, stack_top;

int main(void);

static void semihost(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void port_print(const char *text)
{
    semihost(0x04, text);
}

void port_stop(void)
{
    semihost(0x18, (const void *)0x20026); /* the application ends */
}

void port_start(void)
{
    SYSTICK_RELOAD = 0xffffff;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 5; /* processor clock, no interrupt */
}

/* 20001 instructions and the second reading. */
uint32_t port_known_loop(void)
{
    uint32_t before, after, turns;
    __asm__ volatile("ldr %0, [%3]\n\tmovw %2, #10000\n1:\tsubs %2, #1\n\tbne 1b\n\tldr %1, [%3]"
                     : "=&r"(before), "=&r"(after), "=&r"(turns)
                     : "r"(&SYSTICK_VALUE)
                     : "cc", "memory");
    return port_elapsed(before, after);
}

static void fault(void)
{
    port_print("FAULT\n");
    port_stop();
}

__attribute__((noreturn)) void reset(void)
{
    uint32_t *from = &data_image, *to;
    COPROCESSORS |= 0xfu << 20;
    __asm__ volatile("dsb\n\tisb");
    for (to = &data_start; to < &data_end;) {
        *to++ = *from++;
    }
    for (to = &bss_start; to < &bss_end;) {
        *to++ = 0;
    }
    (void)main();
    for (;;) {
        port_stop();
    }
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (const void *)reset, (const void *)fault, (const void *)fault,
    (const void *)fault, (const void *)fault, (const void *)fault,
};
