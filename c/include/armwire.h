/* armwire: exact robot-arm protocols for C. Made by cbindgen from c/src: do not edit. */

#ifndef ARMWIRE_H
#define ARMWIRE_H

#include <stddef.h>
#include <stdint.h>

/**
 * Words in the memory of a client.
 */
#define ARMWIRE_ALPHA1_CLIENT_WORDS 128

/**
 * Words in the memory of a device.
 */
#define ARMWIRE_ALPHA1_DEVICE_WORDS 56

/**
 * Servos that an action has room for (row FB). An Alpha1 has 16.
 */
#define ARMWIRE_ALPHA1_SERVOS 20

/**
 * In place of an angle in an action: the servo is left as it is.
 */
#define ARMWIRE_ALPHA1_NO_ANGLE 255

/**
 * Words in the memory of a client.
 */
#define ARMWIRE_LING_CLIENT_WORDS 80

/**
 * Words in the memory of a device.
 */
#define ARMWIRE_LING_DEVICE_WORDS 32

/**
 * Joints of the arm, the gripper not counted.
 */
#define ARMWIRE_LING_JOINTS 6

/**
 * Maximum number of servos of an arm: a follower has 10, a leader 6.
 */
#define ARMWIRE_LING_MAX_SERVOS 10

/**
 * The version of this header: 0xMMmmpp. Every `init` function takes it.
 */
#define ARMWIRE_VERSION 256

/**
 * Words in the memory of a client.
 */
#define ARMWIRE_XARM_CLIENT_WORDS 136

/**
 * Words in the memory of a device.
 */
#define ARMWIRE_XARM_DEVICE_WORDS 56

/**
 * The result of a function. After an error nothing has changed.
 */
enum ArmwireStatus
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * Done.
   */
  ARMWIRE_STATUS_OK = 0,
  /**
   * A pointer is NULL.
   */
  ARMWIRE_STATUS_NULL,
  /**
   * The header is of another version than the library. Only from `init`.
   */
  ARMWIRE_STATUS_VERSION,
  /**
   * The client or device was not initialized.
   */
  ARMWIRE_STATUS_NOT_INITIALIZED,
  /**
   * The memory holds another client or device: of another protocol, or of the other side.
   */
  ARMWIRE_STATUS_WRONG_TYPE,
  /**
   * A request is in flight, or the rest of a cancelled one is still to be transmitted.
   */
  ARMWIRE_STATUS_BUSY,
  /**
   * The buffer is too short for the message.
   */
  ARMWIRE_STATUS_BUFFER_TOO_SHORT,
  /**
   * A value is out of its range. `fault` has the value and its range.
   */
  ARMWIRE_STATUS_OUT_OF_RANGE,
  /**
   * The protocol has no message of this kind.
   */
  ARMWIRE_STATUS_UNKNOWN_KIND,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireStatus ArmwireStatus;
#else
typedef uint32_t ArmwireStatus;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The kind of an `ArmwireEvent`. The members that it sets are named in parentheses.
 */
enum ArmwireEventKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * Nothing to do before bytes arrive or `until_us` is reached. From a device: before bytes arrive. (`until_us`)
   */
  ARMWIRE_EVENT_KIND_WAIT = 0,
  /**
   * Client: these bytes are to be transmitted. Say with `transmitted` how many the line took. (`bytes`, `len`)
   */
  ARMWIRE_EVENT_KIND_TRANSMIT,
  /**
   * Client: the answer to the request in flight, which is done. (the response)
   */
  ARMWIRE_EVENT_KIND_ANSWER,
  /**
   * Client: the request in flight, which the arm does not answer, is with the line: it is done.
   */
  ARMWIRE_EVENT_KIND_SENT,
  /**
   * Client: the request in flight got no answer and is given up. (`sends`)
   */
  ARMWIRE_EVENT_KIND_TIMED_OUT,
  /**
   * Client: the answer to the request in flight has a value or a length that the protocol does not have. The request is
   * done. (`fault`)
   */
  ARMWIRE_EVENT_KIND_UNACCEPTABLE,
  /**
   * Client: an answer to a request that was given up, cancelled, or answered before. (the response)
   */
  ARMWIRE_EVENT_KIND_LATE,
  /**
   * Client: a response that answers nothing. (the response)
   */
  ARMWIRE_EVENT_KIND_UNSOLICITED,
  /**
   * Client: a request. The line gave it back, or another host is on it.
   */
  ARMWIRE_EVENT_KIND_ECHO,
  /**
   * Device: a request. (the request)
   */
  ARMWIRE_EVENT_KIND_REQUEST,
  /**
   * A good frame that is no message of the protocol. (`bytes`, `len`, `fault`)
   */
  ARMWIRE_EVENT_KIND_UNKNOWN,
  /**
   * Bytes that are not part of a frame. (`offset`, `bytes`, `len`, `fault`)
   */
  ARMWIRE_EVENT_KIND_NOISE,
  /**
   * A lossless stream broke here: nothing after this can be read. Close the connection. (`offset`, `fault`)
   */
  ARMWIRE_EVENT_KIND_BROKEN,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireEventKind ArmwireEventKind;
#else
typedef uint32_t ArmwireEventKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The kind of an `ArmwireFault`. The members that it sets are named in parentheses.
 */
enum ArmwireFaultCode
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint8_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * Nothing.
   */
  ARMWIRE_FAULT_CODE_NONE = 0,
  /**
   * Noise: no frame starts here.
   */
  ARMWIRE_FAULT_CODE_STRAY,
  /**
   * Noise: the length field of a frame is out of range. (`got`, `min`, `max`)
   */
  ARMWIRE_FAULT_CODE_LENGTH,
  /**
   * Noise: a byte of a frame has another value than those allowed. (`offset`, `got`, `expected_bytes`, `expected_len`)
   */
  ARMWIRE_FAULT_CODE_FRAME_BYTE,
  /**
   * Noise: a checksum does not match. (`got`; `min` is the one that does)
   */
  ARMWIRE_FAULT_CODE_CHECKSUM,
  /**
   * Noise: a frame has no terminator. (`got`; `min` is the terminator)
   */
  ARMWIRE_FAULT_CODE_TAIL,
  /**
   * Noise: the line went idle before the end of a frame. (`got` is the number of missing bytes)
   */
  ARMWIRE_FAULT_CODE_TRUNCATED,
  /**
   * The protocol has no such message.
   */
  ARMWIRE_FAULT_CODE_UNKNOWN,
  /**
   * An answer of a servo, but none is expected.
   */
  ARMWIRE_FAULT_CODE_UNEXPECTED,
  /**
   * A frame of the robot's Bluetooth protocol.
   */
  ARMWIRE_FAULT_CODE_BLUETOOTH,
  /**
   * It would start a servo's boot loader.
   */
  ARMWIRE_FAULT_CODE_BOOT_LOADER,
  /**
   * A message has the wrong length. (`got`, `expected_lengths`, `expected_len`)
   */
  ARMWIRE_FAULT_CODE_DATA_LENGTH,
  /**
   * A data byte has another value than those allowed. (`offset`, `got`, `expected_bytes`, `expected_len`)
   */
  ARMWIRE_FAULT_CODE_DATA_BYTE,
  /**
   * A value in a message is out of its range. (`offset`, `got`, `min`, `max`, `what`, `unit`)
   */
  ARMWIRE_FAULT_CODE_DATA_VALUE,
  /**
   * A value that was passed in is out of its range. (`got`, `min`, `max`, `what`, `unit`; `offset` is its index, from 0,
   * if it is one of several)
   */
  ARMWIRE_FAULT_CODE_VALUE,
  /**
   * Another error, which this version has no code for.
   */
  ARMWIRE_FAULT_CODE_OTHER,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireFaultCode ArmwireFaultCode;
#else
typedef uint8_t ArmwireFaultCode;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The message that a faulty frame would be.
 */
enum ArmwireMessageKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint8_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_MESSAGE_KIND_NONE = 0,
  /**
   * A command: `message_id`.
   */
  ARMWIRE_MESSAGE_KIND_COMMAND,
  /**
   * A command and its function: `message_id` and `message_function`.
   */
  ARMWIRE_MESSAGE_KIND_FUNCTION,
  /**
   * A register: `message_id`.
   */
  ARMWIRE_MESSAGE_KIND_REGISTER,
  /**
   * Standard Modbus: the unit in `message_id`, and the function in `message_function`.
   */
  ARMWIRE_MESSAGE_KIND_MODBUS,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireMessageKind ArmwireMessageKind;
#else
typedef uint8_t ArmwireMessageKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the host.
 */
enum ArmwireLingRequestKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_LING_REQUEST_KIND_NONE = 0,
  /**
   * Serial number and versions (section 2.1).
   */
  ARMWIRE_LING_REQUEST_KIND_READ_INFO,
  /**
   * Makes the present pose the zero position, and switches the torque off (section 2.2). Not answered.
   */
  ARMWIRE_LING_REQUEST_KIND_SET_ZERO,
  /**
   * Sets the gripper's stroke (section 2.3). Not answered. (`stroke_mm`)
   */
  ARMWIRE_LING_REQUEST_KIND_SET_STROKE,
  /**
   * Reads the configured stroke of the gripper (section 2.3).
   */
  ARMWIRE_LING_REQUEST_KIND_READ_STROKE,
  /**
   * Switches the torque (section 2.4). Not answered. (`torque_on`)
   */
  ARMWIRE_LING_REQUEST_KIND_SET_TORQUE,
  /**
   * Joint positions, gripper and motion status (section 2.5).
   */
  ARMWIRE_LING_REQUEST_KIND_READ_JOINTS,
  /**
   * Servo temperatures (section 2.5).
   */
  ARMWIRE_LING_REQUEST_KIND_READ_TEMPERATURES,
  /**
   * Sets the temperature at which the arm protects itself (section 2.5). Not answered. (`temperature_limit_celsius`)
   */
  ARMWIRE_LING_REQUEST_KIND_SET_TEMPERATURE_LIMIT,
  /**
   * Servo velocities (section 2.5).
   */
  ARMWIRE_LING_REQUEST_KIND_READ_VELOCITIES,
  /**
   * Moves the joints and the gripper (section 2.5). Not answered. (`target`)
   */
  ARMWIRE_LING_REQUEST_KIND_MOVE,
  /**
   * Checks every servo (section 2.6).
   */
  ARMWIRE_LING_REQUEST_KIND_SELF_CHECK,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireLingRequestKind ArmwireLingRequestKind;
#else
typedef uint32_t ArmwireLingRequestKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the arm.
 */
enum ArmwireLingResponseKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_LING_RESPONSE_KIND_NONE = 0,
  /**
   * The arm's identity. (`serial_number`, `hardware_version`, `firmware_version`)
   */
  ARMWIRE_LING_RESPONSE_KIND_INFO,
  /**
   * The configured gripper. (`stroke_mm`)
   */
  ARMWIRE_LING_RESPONSE_KIND_STROKE,
  /**
   * Joints, gripper and status. (`position_ticks`, `opening_per_mille`, `motion_status`)
   */
  ARMWIRE_LING_RESPONSE_KIND_JOINTS,
  /**
   * Servo temperatures. (`servos`, `temperature_celsius`)
   */
  ARMWIRE_LING_RESPONSE_KIND_TEMPERATURES,
  /**
   * Servo velocities. (`servos`, `velocity_ticks_per_s`)
   */
  ARMWIRE_LING_RESPONSE_KIND_VELOCITIES,
  /**
   * The outcome of a self-check. (`normal_servos`)
   */
  ARMWIRE_LING_RESPONSE_KIND_SELF_CHECK,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireLingResponseKind ArmwireLingResponseKind;
#else
typedef uint32_t ArmwireLingResponseKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the host.
 */
enum ArmwireAlpha1RequestKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_NONE = 0,
  /**
   * The robot's hardware version (row F1).
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_READ_HARDWARE_VERSION,
  /**
   * Which servos run (row EF).
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_READ_SERVO_STATES,
  /**
   * Stops the action that is played (row F2).
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_STOP,
  /**
   * The robot's firmware version (row F5).
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_READ_FIRMWARE_VERSION,
  /**
   * Moves all servos (row FB). (`action`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_ACT,
  /**
   * Connects or disconnects the servo offset tool (row F4). (`connected`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SET_OFFSET_TOOL,
  /**
   * The kind of USB device that the robot is from now on (row F9). (`usb_type`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SET_USB_TYPE,
  /**
   * Plays an action (row F3). (`name`, `name_len`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_PLAY,
  /**
   * Moves a servo, or all. Not answered by all. (`servo_id`, `angle_degrees`, `time_ms`, `lock_ms`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_MOVE,
  /**
   * Switches a servo's motor off, or those of all. Not answered by all. (`servo_id`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_RELEASE,
  /**
   * Switches a servo's light, or those of all. Not answered by all. (`servo_id`, `led`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_SET_LED,
  /**
   * Target and actual angle; switches the motor off. (`servo_id`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_ANGLES,
  /**
   * Gives a servo another id. (`servo_id`, `new_servo_id`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_CHANGE_ID,
  /**
   * Sets the offset of a servo's zero. (`servo_id`, `offset_thirds_of_degree`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_SET_OFFSET,
  /**
   * The offset of a servo's zero. (`servo_id`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_OFFSET,
  /**
   * The version of a servo's firmware. (`servo_id`)
   */
  ARMWIRE_ALPHA1_REQUEST_KIND_SERVO_READ_VERSION,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireAlpha1RequestKind ArmwireAlpha1RequestKind;
#else
typedef uint32_t ArmwireAlpha1RequestKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the robot or of a servo.
 */
enum ArmwireAlpha1ResponseKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_NONE = 0,
  /**
   * The hardware version. (`text`, `text_len`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_HARDWARE_VERSION,
  /**
   * The running servos. (`running_servos`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_STATES,
  /**
   * Outcome of a stop. (`success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_STOPPED,
  /**
   * The firmware version. (`success`, `firmware_version`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_FIRMWARE_VERSION,
  /**
   * Outcome of an action frame. (`success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_ACTED,
  /**
   * Outcome of connecting or disconnecting the offset tool. (`success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_OFFSET_TOOL,
  /**
   * Outcome of a change of the USB device type. (`success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_USB_TYPE,
  /**
   * Outcome of the start of an action. (`success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_PLAYING,
  /**
   * A servo moves, has released its motor or has switched its light. (`servo_id`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ACKNOWLEDGED,
  /**
   * Angles of a servo. Its motor is off now. (`servo_id`, `success`, `target_degrees`, `actual_degrees`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ANGLES,
  /**
   * Outcome of a change of a servo's id. (`servo_id`, `success`, `previous_servo_id`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_ID_CHANGED,
  /**
   * Outcome of a change of a servo's zero offset. (`servo_id`, `success`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET_SET,
  /**
   * The zero offset of a servo. (`servo_id`, `success`, `offset_thirds_of_degree`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_OFFSET,
  /**
   * The version of a servo's firmware. (`servo_id`, `success`, `servo_version`)
   */
  ARMWIRE_ALPHA1_RESPONSE_KIND_SERVO_VERSION,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireAlpha1ResponseKind ArmwireAlpha1ResponseKind;
#else
typedef uint32_t ArmwireAlpha1ResponseKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The kind of USB device that the robot is.
 */
enum ArmwireAlpha1UsbType
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint8_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * A disk, which no longer supports this protocol.
   */
  ARMWIRE_ALPHA1_USB_TYPE_DISK = 1,
  /**
   * A virtual serial port.
   */
  ARMWIRE_ALPHA1_USB_TYPE_SERIAL_PORT = 2,
  /**
   * A HID device with reports of 64 bytes.
   */
  ARMWIRE_ALPHA1_USB_TYPE_HID = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireAlpha1UsbType ArmwireAlpha1UsbType;
#else
typedef uint8_t ArmwireAlpha1UsbType;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the host.
 */
enum ArmwireXarmRequestKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_XARM_REQUEST_KIND_NONE = 0,
  /**
   * A sign of life. Not answered.
   */
  ARMWIRE_XARM_REQUEST_KIND_HEARTBEAT,
  /**
   * Versions (register 1).
   */
  ARMWIRE_XARM_REQUEST_KIND_READ_VERSION,
  /**
   * Serial numbers (register 2).
   */
  ARMWIRE_XARM_REQUEST_KIND_READ_SERIALS,
  /**
   * Reloads the friction parameters (register 4).
   */
  ARMWIRE_XARM_REQUEST_KIND_RELOAD_DYNAMICS,
  /**
   * The quantity reported as torque (register 5).
   */
  ARMWIRE_XARM_REQUEST_KIND_READ_TORQUE_SOURCE,
  /**
   * The radius of rotation of a joint relative to the tool (register 6). (`joint`)
   */
  ARMWIRE_XARM_REQUEST_KIND_READ_ROTATION_RADIUS,
  /**
   * Shuts the arm's operating system down (register 10).
   */
  ARMWIRE_XARM_REQUEST_KIND_SHUTDOWN,
  /**
   * Restarts the arm's operating system (register 10).
   */
  ARMWIRE_XARM_REQUEST_KIND_REBOOT,
  /**
   * Any other register. (`params`, `params_len`)
   */
  ARMWIRE_XARM_REQUEST_KIND_RAW,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireXarmRequestKind ArmwireXarmRequestKind;
#else
typedef uint32_t ArmwireXarmRequestKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A message of the arm.
 */
enum ArmwireXarmResponseKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  /**
   * None.
   */
  ARMWIRE_XARM_RESPONSE_KIND_NONE = 0,
  /**
   * A sign of life. Answers nothing.
   */
  ARMWIRE_XARM_RESPONSE_KIND_HEARTBEAT,
  /**
   * A reply without parameters. (`state`, `reg`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_EMPTY,
  /**
   * Versions: text, padded with NUL. (`state`, `data`, `data_len`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_VERSION,
  /**
   * Serial numbers: that of the arm, NUL, that of the control box, a line feed, padded with NUL.
   * (`state`, `data`, `data_len`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_SERIALS,
  /**
   * The quantity reported as torque. (`state`, `torque_source`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_TORQUE_SOURCE,
  /**
   * The radius of rotation of a joint relative to the tool. (`state`, `rotation_radius_mm`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_ROTATION_RADIUS,
  /**
   * The answer of an arm to shutdown or reboot, with a number whose meaning is not documented. (`state`, `system_control`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_SYSTEM_CONTROL,
  /**
   * The answer of any other register. (`state`, `reg`, `data`, `data_len`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_RAW,
  /**
   * A request in standard Modbus was refused: no such function. (`modbus_unit`, `modbus_function`)
   */
  ARMWIRE_XARM_RESPONSE_KIND_MODBUS_REFUSED,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum ArmwireXarmResponseKind ArmwireXarmResponseKind;
#else
typedef uint32_t ArmwireXarmResponseKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * A client of an Alpha1 robot, or of a bus of its servos: one request at a time. Its memory is yours, what is in it is not.
 */
typedef struct ArmwireAlpha1Client {
  uint64_t opaque[ARMWIRE_ALPHA1_CLIENT_WORDS];
} ArmwireAlpha1Client;

/**
 * The timing of a client.
 */
typedef struct ArmwireConfig {
  /**
   * Baud rate of the line, at least 1; UINT32_MAX for a line without one.
   */
  uint32_t baud;
  /**
   * The longest that the way to the line and back may delay an answer: USB and operating system, or 0.
   */
  uint32_t latency_us;
  /**
   * The time after its due time in which an answer may still arrive. After a missing answer, the next request with the
   * same answer waits for this time, unless answers are numbered.
   */
  uint32_t stale_window_us;
  /**
   * The number of repeats of a request that only reads and gets no answer.
   */
  uint8_t repeats;
} ArmwireConfig;

/**
 * An error in bytes or a value. `armwire_fault_text` writes it as text.
 */
typedef struct ArmwireFault {
  /**
   * The kind: an `ArmwireFaultCode`.
   */
  uint8_t code;
  /**
   * The message that the frame would be: an `ArmwireMessageKind`.
   */
  uint8_t message;
  /**
   * Command, register or Modbus unit.
   */
  uint8_t message_id;
  /**
   * Function.
   */
  uint8_t message_function;
  /**
   * The place, in bytes: from the start of the frame for noise, from the start of the data for a message.
   */
  uint32_t offset;
  /**
   * The value, byte or length itself.
   */
  int32_t got;
  /**
   * The least that is allowed.
   */
  int32_t min;
  /**
   * The most that is allowed.
   */
  int32_t max;
  /**
   * The allowed bytes.
   */
  const uint8_t *expected_bytes;
  /**
   * The allowed lengths.
   */
  const size_t *expected_lengths;
  /**
   * The number of allowed bytes or lengths.
   */
  size_t expected_len;
  /**
   * The name of the value, UTF-8, not terminated.
   */
  const uint8_t *what;
  /**
   * Bytes of `what`.
   */
  size_t what_len;
  /**
   * The unit of the value, UTF-8, not terminated.
   */
  const uint8_t *unit;
  /**
   * Bytes of `unit`.
   */
  size_t unit_len;
} ArmwireFault;

/**
 * An event at a client or a device. Members that its kind does not set are 0.
 */
typedef struct ArmwireEvent {
  /**
   * The kind: an `ArmwireEventKind`.
   */
  uint32_t kind;
  /**
   * The number of times that the request was sent.
   */
  uint32_t sends;
  /**
   * The latest time of the next poll; UINT64_MAX if there is nothing to wait for but bytes.
   */
  uint64_t until_us;
  /**
   * The place of the first byte, in bytes since `init`.
   */
  uint64_t offset;
  /**
   * Bytes, which stay until the next call with the same client or device.
   */
  const uint8_t *bytes;
  /**
   * The number of `bytes`.
   */
  size_t len;
  /**
   * The error.
   */
  struct ArmwireFault fault;
} ArmwireEvent;

/**
 * A response, as a client has received it or a device sends it. Members that its kind does not set are 0.
 */
typedef struct ArmwireAlpha1Response {
  /**
   * The kind: an `ArmwireAlpha1ResponseKind`.
   */
  uint32_t kind;
  /**
   * Outcome: 1 success, 0 failure.
   */
  uint8_t success;
  /**
   * The servo that responds, 1 to 240.
   */
  uint8_t servo_id;
  /**
   * The previous id of the servo.
   */
  uint8_t previous_servo_id;
  /**
   * Firmware version of the robot, year first, ASCII; any bytes without `success`.
   */
  uint8_t firmware_version[10];
  /**
   * Firmware version of a servo. The meaning of its bytes is not documented.
   */
  uint8_t servo_version[4];
  /**
   * Target angle of the servo.
   */
  uint16_t target_degrees;
  /**
   * Actual angle of the servo.
   */
  uint16_t actual_degrees;
  /**
   * Offset of a servo's zero, as sent: -90 to 90.
   */
  int16_t offset_thirds_of_degree;
  /**
   * One bit per servo, servo 1 lowest: 1 runs, 0 can be turned by hand.
   */
  uint32_t running_servos;
  /**
   * The hardware version, 0 to 254 bytes in no documented alphabet. From a client it stays until the next call with it.
   */
  const uint8_t *text;
  /**
   * Bytes of `text`.
   */
  size_t text_len;
} ArmwireAlpha1Response;

/**
 * One frame of an action (row FB).
 */
typedef struct ArmwireAlpha1Action {
  /**
   * Targets of servos 1 to 20, 0 to 240, or ARMWIRE_ALPHA1_NO_ANGLE. A device may receive 241 to 254, too.
   */
  uint8_t angle_degrees[ARMWIRE_ALPHA1_SERVOS];
  /**
   * Duration of the motion, 0 to 5100, in steps of 20 ms; rounded to the nearest.
   */
  uint32_t time_ms;
  /**
   * Time from the end of this frame to the start of the next accepted one, 0 to 1310700; rounded to the nearest 20 ms.
   */
  uint32_t interval_ms;
} ArmwireAlpha1Action;

/**
 * The side of the robot, or of its servos, on a line: requests in, responses out. It implements the protocol, not the robot. Its memory is yours, what is in
 * it is not.
 */
typedef struct ArmwireAlpha1Device {
  uint64_t opaque[ARMWIRE_ALPHA1_DEVICE_WORDS];
} ArmwireAlpha1Device;

/**
 * A request, as a device has received it. Members that its kind does not set are 0.
 */
typedef struct ArmwireAlpha1Request {
  /**
   * The kind: an `ArmwireAlpha1RequestKind`.
   */
  uint32_t kind;
  /**
   * State of the offset tool: 1 connected, 0 disconnected.
   */
  uint8_t connected;
  /**
   * The new USB device type of the robot: an `ArmwireAlpha1UsbType`.
   */
  uint8_t usb_type;
  /**
   * The servo, 1 to 240; 0 for all.
   */
  uint8_t servo_id;
  /**
   * The new id of the servo.
   */
  uint8_t new_servo_id;
  /**
   * The byte for the light. The sources disagree on its meaning.
   */
  uint8_t led;
  /**
   * Target of a servo.
   */
  uint8_t angle_degrees;
  /**
   * Offset of a servo's zero, -90 to 90.
   */
  int16_t offset_thirds_of_degree;
  /**
   * Duration of the motion.
   */
  uint32_t time_ms;
  /**
   * The completion time, which the servos' manual also calls lock time.
   */
  uint32_t lock_ms;
  /**
   * The action.
   */
  struct ArmwireAlpha1Action action;
  /**
   * The name of an action, which stays until the next call with the device.
   */
  const uint8_t *name;
  /**
   * Bytes of `name`.
   */
  size_t name_len;
} ArmwireAlpha1Request;

/**
 * A client of a Ling arm: one request at a time. Its memory is yours, what is in it is not.
 */
typedef struct ArmwireLingClient {
  uint64_t opaque[ARMWIRE_LING_CLIENT_WORDS];
} ArmwireLingClient;

/**
 * A response, as a client has received it or a device sends it. Members that its kind does not set are 0.
 */
typedef struct ArmwireLingResponse {
  /**
   * The kind: an `ArmwireLingResponseKind`.
   */
  uint32_t kind;
  /**
   * Serial number, ASCII, padded with NUL. `armwire_printable` converts it to text.
   */
  uint8_t serial_number[16];
  /**
   * Hardware version: 610 is 6.10.
   */
  uint32_t hardware_version;
  /**
   * Firmware version: 610 is 6.10.
   */
  uint32_t firmware_version;
  /**
   * Positions of joints 1 to 6, as sent: 4096 ticks a turn, 2048 at the centre.
   */
  uint16_t position_ticks[ARMWIRE_LING_JOINTS];
  /**
   * Opening of the gripper, as sent: 0 (closed) to 1000 (open), but arms have sent more.
   */
  uint16_t opening_per_mille;
  /**
   * Motion status: 0x00 idle, 0x01 locked, 0x10 following, 0x11 following and locked, 0xE1 overheating, 0xE2
   * stopped by overheat protection.
   */
  uint8_t motion_status;
  /**
   * Stroke of the gripper: 50, 75 or 100.
   */
  uint8_t stroke_mm;
  /**
   * The number of servos: 6 (leader) or 10 (follower).
   */
  uint8_t servos;
  /**
   * Temperatures, servo 1 first.
   */
  uint8_t temperature_celsius[ARMWIRE_LING_MAX_SERVOS];
  /**
   * Velocities, servo 1 first, unsigned.
   */
  uint16_t velocity_ticks_per_s[ARMWIRE_LING_MAX_SERVOS];
  /**
   * One bit a servo, servo 1 lowest: 1 is normal.
   */
  uint16_t normal_servos;
} ArmwireLingResponse;

/**
 * Targets and speeds of a move (section 2.5). A turn of a joint is 4096 ticks, 2048 is its centre.
 */
typedef struct ArmwireLingMove {
  /**
   * Targets of joints 1 to 6, 0 to 4095.
   */
  uint16_t position_ticks[ARMWIRE_LING_JOINTS];
  /**
   * Speeds of joints 1 to 6, 0 to 5000.
   */
  uint16_t speed_ticks_per_s[ARMWIRE_LING_JOINTS];
  /**
   * Target of the gripper, 0 (closed) to 1000 (open).
   */
  uint16_t opening_per_mille;
  /**
   * Speed of the gripper. The vendor's software sends 5500.
   */
  uint16_t gripper_speed_ticks_per_s;
} ArmwireLingMove;

/**
 * The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. Its memory is yours, what is in
 * it is not.
 */
typedef struct ArmwireLingDevice {
  uint64_t opaque[ARMWIRE_LING_DEVICE_WORDS];
} ArmwireLingDevice;

/**
 * A request, as a device has received it. Members that its kind does not set are 0.
 */
typedef struct ArmwireLingRequest {
  /**
   * The kind: an `ArmwireLingRequestKind`.
   */
  uint32_t kind;
  /**
   * Stroke of the gripper: 50, 75 or 100.
   */
  uint8_t stroke_mm;
  /**
   * Torque: 1 on, the servos hold their positions; 0 off.
   */
  uint8_t torque_on;
  /**
   * Temperature limit of the overheat protection.
   */
  uint8_t temperature_limit_celsius;
  /**
   * Targets and speeds of a move.
   */
  struct ArmwireLingMove target;
} ArmwireLingRequest;

/**
 * A client of an xArm: one request at a time. Its memory is yours, what is in it is not.
 */
typedef struct ArmwireXarmClient {
  uint64_t opaque[ARMWIRE_XARM_CLIENT_WORDS];
} ArmwireXarmClient;

/**
 * A response, as a client has received it or a device sends it. Members that its kind does not set are 0.
 */
typedef struct ArmwireXarmResponse {
  /**
   * The kind: an `ArmwireXarmResponseKind`.
   */
  uint32_t kind;
  /**
   * State bits of the arm and the request: 0x08 refused or failed, 0x10 not ready to move, 0x20 warning, 0x40 error.
   */
  uint8_t state;
  /**
   * The register.
   */
  uint8_t reg;
  /**
   * 0 is the torque of the joint, computed; 1 the current of the servo, measured.
   */
  uint8_t torque_source;
  /**
   * The unit of a request in standard Modbus.
   */
  uint8_t modbus_unit;
  /**
   * The function of a request in standard Modbus, 0 to 127.
   */
  uint8_t modbus_function;
  /**
   * A number whose meaning is not documented.
   */
  uint16_t system_control;
  /**
   * The radius of rotation: any number at all, for this is what arrived.
   */
  float rotation_radius_mm;
  /**
   * Text or parameters, 0 to 252 bytes. From a client they stay until the next call with it.
   */
  const uint8_t *data;
  /**
   * Bytes of `data`.
   */
  size_t data_len;
} ArmwireXarmResponse;

/**
 * The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. Its memory is yours, what is in
 * it is not.
 */
typedef struct ArmwireXarmDevice {
  uint64_t opaque[ARMWIRE_XARM_DEVICE_WORDS];
} ArmwireXarmDevice;

/**
 * A request, as a device has received it. Members that its kind does not set are 0.
 */
typedef struct ArmwireXarmRequest {
  /**
   * The kind: an `ArmwireXarmRequestKind`.
   */
  uint32_t kind;
  /**
   * The request's number, which its response repeats. Set with every frame, as are `protocol_id` and `reg`.
   */
  uint16_t transaction_id;
  /**
   * 2 or 3; 1 for a heartbeat, 0 for standard Modbus.
   */
  uint16_t protocol_id;
  /**
   * The register; in standard Modbus the function.
   */
  uint8_t reg;
  /**
   * The joint, 1 to 7.
   */
  uint8_t joint;
  /**
   * Parameters, which stay until the next call with the device.
   */
  const uint8_t *params;
  /**
   * Bytes of `params`.
   */
  size_t params_len;
} ArmwireXarmRequest;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Makes a client. `version` is ARMWIRE_VERSION. `config` may be NULL: then it is that of
 * `armwire_config_serial` at 115 200 baud.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
 */
ArmwireStatus armwire_alpha1_client_init(struct ArmwireAlpha1Client *client,
                                         uint32_t version,
                                         const struct ArmwireConfig *config);

/**
 * The next step. Call it again after every event but WAIT, once bytes arrived or were transmitted, and at the time that WAIT
 * gives. `now_us` is of a clock that does not go back.
 */
ArmwireStatus armwire_alpha1_client_poll(struct ArmwireAlpha1Client *client,
                                         uint64_t now_us,
                                         struct ArmwireEvent *event,
                                         struct ArmwireAlpha1Response *response);

/**
 * The line took the first `len` bytes of a TRANSMIT event.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than what is left: then nothing is taken for transmitted.
 */
ArmwireStatus armwire_alpha1_client_transmitted(struct ArmwireAlpha1Client *client,
                                                uint64_t now_us,
                                                size_t len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_alpha1_client_space(struct ArmwireAlpha1Client *client,
                                          uint8_t **space,
                                          size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_alpha1_client_received(struct ArmwireAlpha1Client *client, uint64_t now_us, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_alpha1_client_receive(struct ArmwireAlpha1Client *client,
                                            uint64_t now_us,
                                            const uint8_t *bytes,
                                            size_t len,
                                            size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_alpha1_client_idle(struct ArmwireAlpha1Client *client);

/**
 * Gives up the request in flight, if there is one. What is left of its bytes is still to be transmitted.
 */
ArmwireStatus armwire_alpha1_client_cancel(struct ArmwireAlpha1Client *client);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_alpha1_client_fault(struct ArmwireAlpha1Client *client, struct ArmwireFault *fault);

/**
 * Asks for the robot's hardware version (row F1).
 *
 * ARMWIRE_STATUS_BUSY while another request is in flight, as from all requests.
 */
ArmwireStatus armwire_alpha1_client_read_hardware_version(struct ArmwireAlpha1Client *client);

/**
 * Asks which servos run (row EF).
 */
ArmwireStatus armwire_alpha1_client_read_servo_states(struct ArmwireAlpha1Client *client);

/**
 * Stops the action that is played (row F2).
 */
ArmwireStatus armwire_alpha1_client_stop(struct ArmwireAlpha1Client *client);

/**
 * Asks for the robot's firmware version (row F5).
 */
ArmwireStatus armwire_alpha1_client_read_firmware_version(struct ArmwireAlpha1Client *client);

/**
 * Moves all servos (row FB).
 */
ArmwireStatus armwire_alpha1_client_act(struct ArmwireAlpha1Client *client,
                                        const struct ArmwireAlpha1Action *action);

/**
 * Connects (1) or disconnects (0) the servo offset tool (row F4): while it is connected, Bluetooth may not be used.
 */
ArmwireStatus armwire_alpha1_client_set_offset_tool(struct ArmwireAlpha1Client *client,
                                                    uint8_t connected);

/**
 * Sets the robot's USB device type, an `ArmwireAlpha1UsbType` (row F9). A disk no longer supports this protocol.
 */
ArmwireStatus armwire_alpha1_client_set_usb_type(struct ArmwireAlpha1Client *client,
                                                 uint8_t usb);

/**
 * Plays the action of this name, 0 to 254 bytes (row F3).
 *
 * # Safety
 *
 * `name` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_alpha1_client_play(struct ArmwireAlpha1Client *client, const uint8_t *name, size_t len);

/**
 * Moves a servo (1 to 240), or all (0): then it is not answered. `angle_degrees` is 0 to 240, `time_ms` 0 to 5100, `lock_ms`,
 * the completion time, 0 to 1310700; both to the nearest 20 ms.
 */
ArmwireStatus armwire_alpha1_client_servo_move(struct ArmwireAlpha1Client *client,
                                               uint8_t servo_id,
                                               uint8_t angle_degrees,
                                               uint32_t time_ms,
                                               uint32_t lock_ms);

/**
 * Switches the motor of a servo (1 to 240) off, or those of all (0): then it is not answered. What they hold up falls.
 */
ArmwireStatus armwire_alpha1_client_servo_release(struct ArmwireAlpha1Client *client,
                                                  uint8_t servo_id);

/**
 * Switches the light of a servo (1 to 240), or those of all (0): then it is not answered. Sources contradict each other on
 * what `led` means: by the servos' manual 0 is off and 1 blinks, in public programs 0 is on and 1 is off.
 */
ArmwireStatus armwire_alpha1_client_servo_set_led(struct ArmwireAlpha1Client *client,
                                                  uint8_t servo_id,
                                                  uint8_t led);

/**
 * Asks a servo for its target and actual angle. The servo switches its motor off to answer: what it holds up falls.
 */
ArmwireStatus armwire_alpha1_client_servo_read_angles(struct ArmwireAlpha1Client *client,
                                                      uint8_t servo_id);

/**
 * Gives a servo another id.
 */
ArmwireStatus armwire_alpha1_client_servo_change_id(struct ArmwireAlpha1Client *client,
                                                    uint8_t servo_id,
                                                    uint8_t new_servo_id);

/**
 * Sets the offset of a servo's zero, -90 to 90 thirds of a degree.
 */
ArmwireStatus armwire_alpha1_client_servo_set_offset(struct ArmwireAlpha1Client *client,
                                                     uint8_t servo_id,
                                                     int16_t offset_thirds_of_degree);

/**
 * Asks a servo for the offset of its zero.
 */
ArmwireStatus armwire_alpha1_client_servo_read_offset(struct ArmwireAlpha1Client *client, uint8_t servo_id);

/**
 * Asks a servo for the version of its firmware.
 */
ArmwireStatus armwire_alpha1_client_servo_read_version(struct ArmwireAlpha1Client *client, uint8_t servo_id);

/**
 * Makes a device. `version` is ARMWIRE_VERSION.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ.
 */
ArmwireStatus armwire_alpha1_device_init(struct ArmwireAlpha1Device *device, uint32_t version);

/**
 * The next event. Call it again after every event but WAIT, and once bytes arrived.
 */
ArmwireStatus armwire_alpha1_device_poll(struct ArmwireAlpha1Device *device,
                                         struct ArmwireEvent *event,
                                         struct ArmwireAlpha1Request *request);

/**
 * Writes a response to `out` and its length to `len`. 259 bytes hold every one.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE for a value, ARMWIRE_STATUS_UNKNOWN_KIND for a kind that the protocol does not have,
 * ARMWIRE_STATUS_BUFFER_TOO_SHORT: then `len` is the length of the response.
 *
 * # Safety
 *
 * `out` is NULL, or has `size` bytes; so has the `text` of the response `text_len`.
 */
ArmwireStatus armwire_alpha1_device_respond(struct ArmwireAlpha1Device *device,
                                            const struct ArmwireAlpha1Response *response,
                                            uint8_t *out,
                                            size_t size,
                                            size_t *len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_alpha1_device_space(struct ArmwireAlpha1Device *device,
                                          uint8_t **space,
                                          size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_alpha1_device_received(struct ArmwireAlpha1Device *device, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_alpha1_device_receive(struct ArmwireAlpha1Device *device,
                                            const uint8_t *bytes,
                                            size_t len,
                                            size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_alpha1_device_idle(struct ArmwireAlpha1Device *device);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_alpha1_device_fault(struct ArmwireAlpha1Device *device, struct ArmwireFault *fault);

/**
 * The timing of an arm at 1 Mbaud over USB: 10 ms of latency, two repeats, answers up to 100 ms late. For a UART of this
 * microcontroller set `latency_us` to the time that passes at most between two calls of `poll`.
 */
ArmwireStatus armwire_config_serial(struct ArmwireConfig *config);

/**
 * The timing of a TCP connection in a local network: 100 ms of latency, no repeats, answers up to a second late.
 */
ArmwireStatus armwire_config_tcp(struct ArmwireConfig *config);

/**
 * Writes the text of a fault, with a NUL behind it, to `out`, and returns its length without the NUL. If that is not less
 * than `size`, the text was cut short. 128 bytes hold every text.
 *
 * # Safety
 *
 * `fault` is as this library has written it, or all zero. `out` is NULL, or has `size` bytes.
 */
size_t armwire_fault_text(const struct ArmwireFault *fault,
                          char *out,
                          size_t size);

/**
 * Makes a client. `version` is ARMWIRE_VERSION. `config` may be NULL: then it is that of `armwire_config_serial`.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
 */
ArmwireStatus armwire_ling_client_init(struct ArmwireLingClient *client,
                                       uint32_t version,
                                       const struct ArmwireConfig *config);

/**
 * The next step. Call it again after every event but WAIT, once bytes arrived or were transmitted, and at the time that WAIT
 * gives. `now_us` is of a clock that does not go back.
 */
ArmwireStatus armwire_ling_client_poll(struct ArmwireLingClient *client,
                                       uint64_t now_us,
                                       struct ArmwireEvent *event,
                                       struct ArmwireLingResponse *response);

/**
 * The line took the first `len` bytes of a TRANSMIT event.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than what is left: then nothing is taken for transmitted.
 */
ArmwireStatus armwire_ling_client_transmitted(struct ArmwireLingClient *client, uint64_t now_us, size_t len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_ling_client_space(struct ArmwireLingClient *client,
                                        uint8_t **space,
                                        size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_ling_client_received(struct ArmwireLingClient *client, uint64_t now_us, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_ling_client_receive(struct ArmwireLingClient *client,
                                          uint64_t now_us,
                                          const uint8_t *bytes,
                                          size_t len,
                                          size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_ling_client_idle(struct ArmwireLingClient *client);

/**
 * Gives up the request in flight, if there is one. What is left of its bytes is still to be transmitted.
 */
ArmwireStatus armwire_ling_client_cancel(struct ArmwireLingClient *client);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_ling_client_fault(struct ArmwireLingClient *client, struct ArmwireFault *fault);

/**
 * Asks for serial number and versions (section 2.1).
 *
 * ARMWIRE_STATUS_BUSY while another request is in flight, as from all requests.
 */
ArmwireStatus armwire_ling_client_read_info(struct ArmwireLingClient *client);

/**
 * Makes the present pose the zero position, and switches the torque off (section 2.2): what the arm holds up falls. Not
 * answered.
 */
ArmwireStatus armwire_ling_client_set_zero(struct ArmwireLingClient *client);

/**
 * Sets the gripper's stroke in millimetres: 50, 75 or 100 (section 2.3). Not answered.
 */
ArmwireStatus armwire_ling_client_set_stroke(struct ArmwireLingClient *client, uint8_t stroke_mm);

/**
 * Reads the configured stroke of the gripper (section 2.3).
 */
ArmwireStatus armwire_ling_client_read_stroke(struct ArmwireLingClient *client);

/**
 * Switches the torque off (0: what the arm holds up falls) or on (1) (section 2.4). Not answered.
 */
ArmwireStatus armwire_ling_client_set_torque(struct ArmwireLingClient *client, uint8_t on);

/**
 * Asks for joint positions, gripper and motion status (section 2.5).
 */
ArmwireStatus armwire_ling_client_read_joints(struct ArmwireLingClient *client);

/**
 * Asks for servo temperatures (section 2.5).
 */
ArmwireStatus armwire_ling_client_read_temperatures(struct ArmwireLingClient *client);

/**
 * Sets the temperature at which the arm protects itself: 0 to 255 but not 254 (section 2.5). Not answered.
 */
ArmwireStatus armwire_ling_client_set_temperature_limit(struct ArmwireLingClient *client,
                                                        uint8_t limit_celsius);

/**
 * Asks for servo velocities (section 2.5).
 */
ArmwireStatus armwire_ling_client_read_velocities(struct ArmwireLingClient *client);

/**
 * Moves the joints and the gripper (section 2.5). Not answered.
 */
ArmwireStatus armwire_ling_client_move(struct ArmwireLingClient *client,
                                       const struct ArmwireLingMove *target);

/**
 * Has every servo checked (section 2.6).
 */
ArmwireStatus armwire_ling_client_self_check(struct ArmwireLingClient *client);

/**
 * Makes a device. `version` is ARMWIRE_VERSION.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ.
 */
ArmwireStatus armwire_ling_device_init(struct ArmwireLingDevice *device, uint32_t version);

/**
 * The next event. Call it again after every event but WAIT, and once bytes arrived.
 */
ArmwireStatus armwire_ling_device_poll(struct ArmwireLingDevice *device,
                                       struct ArmwireEvent *event,
                                       struct ArmwireLingRequest *request);

/**
 * Writes a response to `out` and its length to `len`. 70 bytes hold every one.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE for a value, ARMWIRE_STATUS_UNKNOWN_KIND for a kind that the protocol does not have,
 * ARMWIRE_STATUS_BUFFER_TOO_SHORT: then `len` is the length of the response.
 *
 * # Safety
 *
 * `out` is NULL, or has `size` bytes.
 */
ArmwireStatus armwire_ling_device_respond(struct ArmwireLingDevice *device,
                                          const struct ArmwireLingResponse *response,
                                          uint8_t *out,
                                          size_t size,
                                          size_t *len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_ling_device_space(struct ArmwireLingDevice *device,
                                        uint8_t **space,
                                        size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_ling_device_received(struct ArmwireLingDevice *device, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_ling_device_receive(struct ArmwireLingDevice *device,
                                          const uint8_t *bytes,
                                          size_t len,
                                          size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_ling_device_idle(struct ArmwireLingDevice *device);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_ling_device_fault(struct ArmwireLingDevice *device, struct ArmwireFault *fault);

/**
 * The text of an `ArmwireStatus`, in English. Never NULL.
 */
const char *armwire_status_text(uint32_t status);

/**
 * Writes bytes that came from outside as text that is safe to print, with a NUL behind it, to `out`: what is not printable
 * ASCII becomes a backslash, an x and two digits, a backslash becomes two. Returns the length without the NUL. If that is not
 * less than `size`, the text was cut short.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes; `out` is NULL, or has `size` bytes. The two do not overlap.
 */
size_t armwire_printable(const uint8_t *bytes,
                         size_t len,
                         char *out,
                         size_t size);

/**
 * The version of the library: 0xMMmmpp.
 */
uint32_t armwire_version(void);

/**
 * Makes a client. `version` is ARMWIRE_VERSION. `config` may be NULL: then it is that of `armwire_config_tcp`.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
 */
ArmwireStatus armwire_xarm_client_init(struct ArmwireXarmClient *client,
                                       uint32_t version,
                                       const struct ArmwireConfig *config);

/**
 * The next step. Call it again after every event but WAIT, once bytes arrived or were transmitted, and at the time that WAIT
 * gives. `now_us` is of a clock that does not go back.
 */
ArmwireStatus armwire_xarm_client_poll(struct ArmwireXarmClient *client,
                                       uint64_t now_us,
                                       struct ArmwireEvent *event,
                                       struct ArmwireXarmResponse *response);

/**
 * The line took the first `len` bytes of a TRANSMIT event.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than what is left: then nothing is taken for transmitted.
 */
ArmwireStatus armwire_xarm_client_transmitted(struct ArmwireXarmClient *client, uint64_t now_us, size_t len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_xarm_client_space(struct ArmwireXarmClient *client,
                                        uint8_t **space,
                                        size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_xarm_client_received(struct ArmwireXarmClient *client, uint64_t now_us, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_xarm_client_receive(struct ArmwireXarmClient *client,
                                          uint64_t now_us,
                                          const uint8_t *bytes,
                                          size_t len,
                                          size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_xarm_client_idle(struct ArmwireXarmClient *client);

/**
 * Gives up the request in flight, if there is one. What is left of its bytes is still to be transmitted.
 */
ArmwireStatus armwire_xarm_client_cancel(struct ArmwireXarmClient *client);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_xarm_client_fault(struct ArmwireXarmClient *client, struct ArmwireFault *fault);

/**
 * Sets the protocol id of the requests from now on: 2, as after `init`, or 3.
 */
ArmwireStatus armwire_xarm_client_set_protocol(struct ArmwireXarmClient *client, uint16_t protocol_id);

/**
 * Sends a sign of life. Not answered.
 *
 * ARMWIRE_STATUS_BUSY while another request is in flight, as from all requests.
 */
ArmwireStatus armwire_xarm_client_heartbeat(struct ArmwireXarmClient *client);

/**
 * Asks for versions (register 1).
 */
ArmwireStatus armwire_xarm_client_read_version(struct ArmwireXarmClient *client);

/**
 * Asks for serial numbers (register 2).
 */
ArmwireStatus armwire_xarm_client_read_serials(struct ArmwireXarmClient *client);

/**
 * Reloads the friction parameters (register 4).
 */
ArmwireStatus armwire_xarm_client_reload_dynamics(struct ArmwireXarmClient *client);

/**
 * Asks what is reported as torque (register 5).
 */
ArmwireStatus armwire_xarm_client_read_torque_source(struct ArmwireXarmClient *client);

/**
 * Asks for the radius of rotation of a joint, 1 to 7, relative to the tool (register 6).
 */
ArmwireStatus armwire_xarm_client_read_rotation_radius(struct ArmwireXarmClient *client, uint8_t joint);

/**
 * Shuts the arm's operating system down (register 10).
 */
ArmwireStatus armwire_xarm_client_shutdown(struct ArmwireXarmClient *client);

/**
 * Restarts the arm's operating system (register 10).
 */
ArmwireStatus armwire_xarm_client_reboot(struct ArmwireXarmClient *client);

/**
 * Sends any other register with up to 252 bytes of parameters: 16-bit numbers big-endian, 32-bit ones little-endian. The answer
 * is waited for 10 s.
 *
 * # Safety
 *
 * `params` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_xarm_client_raw(struct ArmwireXarmClient *client,
                                      uint8_t reg,
                                      const uint8_t *params,
                                      size_t len);

/**
 * Makes a device. `version` is ARMWIRE_VERSION.
 *
 * ARMWIRE_STATUS_VERSION if header and library differ.
 */
ArmwireStatus armwire_xarm_device_init(struct ArmwireXarmDevice *device, uint32_t version);

/**
 * The next event. Call it again after every event but WAIT, and once bytes arrived.
 */
ArmwireStatus armwire_xarm_device_poll(struct ArmwireXarmDevice *device,
                                       struct ArmwireEvent *event,
                                       struct ArmwireXarmRequest *request);

/**
 * Writes a response to a request, or to none if `to` is NULL, to `out` and its length to `len`. 260 bytes hold every one.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE for a value, ARMWIRE_STATUS_UNKNOWN_KIND for a kind that the protocol does not have,
 * ARMWIRE_STATUS_BUFFER_TOO_SHORT: then `len` is the length of the response.
 *
 * # Safety
 *
 * `out` is NULL, or has `size` bytes; so has the `data` of the response `data_len`.
 */
ArmwireStatus armwire_xarm_device_respond(struct ArmwireXarmDevice *device,
                                          const struct ArmwireXarmRequest *to,
                                          const struct ArmwireXarmResponse *response,
                                          uint8_t *out,
                                          size_t size,
                                          size_t *len);

/**
 * Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
 */
ArmwireStatus armwire_xarm_device_space(struct ArmwireXarmDevice *device,
                                        uint8_t **space,
                                        size_t *len);

/**
 * The first `len` bytes of `space` arrived.
 *
 * ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
 */
ArmwireStatus armwire_xarm_device_received(struct ArmwireXarmDevice *device, size_t len);

/**
 * Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
 *
 * # Safety
 *
 * `bytes` is NULL, or has `len` bytes.
 */
ArmwireStatus armwire_xarm_device_receive(struct ArmwireXarmDevice *device,
                                          const uint8_t *bytes,
                                          size_t len,
                                          size_t *taken);

/**
 * The UART reported an idle line. Never call it for a gap between USB packets.
 */
ArmwireStatus armwire_xarm_device_idle(struct ArmwireXarmDevice *device);

/**
 * The last value or length that was refused, with its range.
 */
ArmwireStatus armwire_xarm_device_fault(struct ArmwireXarmDevice *device, struct ArmwireFault *fault);

/**
 * Makes the response of an arm to a frame that is no request, from the fault of the UNKNOWN event: to one of its own that its
 * state is invalid, to standard Modbus that it does not have the function.
 *
 * ARMWIRE_STATUS_UNKNOWN_KIND if the frame names nothing that could be answered.
 */
ArmwireStatus armwire_xarm_refusal(const struct ArmwireFault *fault,
                                   struct ArmwireXarmResponse *response);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ARMWIRE_H */
