// Stub of Arduino's API, as far as the example uses it.
#include <stddef.h>
#include <stdint.h>

struct Port {
  void begin(unsigned long baud);
  int available();
  size_t readBytes(uint8_t *bytes, size_t len);
  size_t write(const uint8_t *bytes, size_t len);
  void print(int number);
  void print(char character);
  void println();
  void println(const char *text);
};
extern Port Serial, Serial1;
unsigned long micros();
