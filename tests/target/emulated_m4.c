/* A Cortex-M4F board, as QEMU's mps2-an386 emulates it: start-up, UART 0 and timer 0 behind pmsm_pil's three functions. */
#include HEADER

#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define REGISTER(address) (*(volatile Uint32 *)(address))

#define CPACR REGISTER(0xE000ED88u)
#define TIMER_CTRL REGISTER(0x40000000u)
#define TIMER_VALUE REGISTER(0x40000004u)
#define TIMER_RELOAD REGISTER(0x40000008u)
#define UART_DATA REGISTER(0x40004000u)
#define UART_STATE REGISTER(0x40004004u) /* bit 0: transmitter full, bit 1: received */
#define UART_CTRL REGISTER(0x40004008u)
#define UART_BAUDDIV REGISTER(0x40004010u)

extern Uint32 stack_top;
void start(void);
__attribute__((section(".vectors"), used)) static const void *const vectors[] = {&stack_top, start};

int pmsm_board_get(void)
{
    return ((UART_STATE & 2u) != 0u) ? (int)(UART_DATA & 0xFFu) : -1;
}

int pmsm_board_put(Uint16 byte)
{
    const int room = (UART_STATE & 1u) == 0u;
    if (room) {
        UART_DATA = byte;
    }
    return room;
}

Uint32 pmsm_board_ticks(void)
{
    return ~TIMER_VALUE; /* it counts down */
}

void start(void)
{
    static pmsm_pil_t pil;
    static JOIN(FILTER, _t) filter;
    CPACR |= 0xF00000u; /* the FPU on */
    TIMER_RELOAD = 0xFFFFFFFFu;
    TIMER_VALUE = 0xFFFFFFFFu;
    TIMER_CTRL = 1u;
    UART_BAUDDIV = 16u;
    UART_CTRL = 3u;
    JOIN(FILTER, _pil_init)(&pil, &filter);
    for (;;) {
        pmsm_pil_poll(&pil);
    }
}
