// Reads the joints of a Ling arm on Serial1 continuously.
#include <armwire.h>

static ArmwireLingClient arm;

// micros() wraps after 71 minutes. The clock of a client must not wrap.
static uint64_t now_us() {
  static uint64_t now;
  now += (uint32_t)(micros() - (uint32_t)now);
  return now;
}

void setup() {
  Serial.begin(115200);
  Serial1.begin(1000000);
  if (armwire_ling_client_init(&arm, ARMWIRE_VERSION, NULL) != ARMWIRE_STATUS_OK) {
    Serial.println("the header and the library of armwire have different versions");
  }
}

void loop() {
  ArmwireEvent event;
  ArmwireLingResponse response;
  uint8_t *space;
  size_t room;
  // Also without bytes: that answers the event RECEIVE of the last loop.
  armwire_ling_client_space(&arm, &space, &room);
  size_t arrived = Serial1.available();
  size_t taken = Serial1.readBytes(space, arrived < room ? arrived : room);
  armwire_ling_client_received(&arm, now_us(), taken);
  armwire_ling_client_read_joints(&arm);  // BUSY while the last request is in flight
  armwire_ling_client_poll(&arm, now_us(), &event, &response);
  switch (event.kind) {
    case ARMWIRE_EVENT_KIND_TRANSMIT:
      armwire_ling_client_transmitted(&arm, now_us(), Serial1.write(event.bytes, event.len));
      break;
    case ARMWIRE_EVENT_KIND_ANSWER:
      for (uint16_t ticks : response.position_ticks) {
        Serial.print(ticks);
        Serial.print(' ');
      }
      Serial.println();
      break;
    case ARMWIRE_EVENT_KIND_TIMED_OUT:
      Serial.println("no answer");
      break;
  }
}
