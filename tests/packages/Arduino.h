/* Arduino.h: as much of a core as the first program asks for. */
struct Port {
    void begin(long) {}
    void println(int) {}
};
extern Port Serial;
