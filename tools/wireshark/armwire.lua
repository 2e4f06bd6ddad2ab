-- Wireshark dissectors for robot arms: Ling / Alicia-D of both generations, UFACTORY xArm, UBTECH Alpha1.
--
-- Recordings of `armwire decode --pcapng` have link type USER0 for Ling, USER1 for xArm and USER2 for Alpha1. A packet
-- is one byte of direction and one frame, or damaged bytes. The direction is 0 from the host to the arm, 1 from the arm
-- to the host, and 2 if it is not known. xArm frames and reports are read on TCP, too. Texts are those of
-- `armwire decode`. docs/analysers.md has a guide.

local HOST, ARM, UNKNOWN = 0, 1, 2
local DIRECTIONS = { [HOST] = "to the arm", [ARM] = "from the arm", [UNKNOWN] = "unknown" }
local SOURCES = { [HOST] = "host", [ARM] = "arm", [UNKNOWN] = "?" }
local DESTINATIONS = { [HOST] = "arm", [ARM] = "host", [UNKNOWN] = "?" }

-- Views: bytes of a packet. Offsets begin at 0.

local View = {}
View.__index = View

function View.new(tvb, start, len)
  return setmetatable({ tvb = tvb, start = start, len = len }, View)
end

function View:part(at, len)
  return View.new(self.tvb, self.start + at, len)
end

-- A range for the tree. Its length is at least 1.
function View:range(at, len)
  return self.tvb:range(self.start + at, len)
end

-- Numbers are integers: in newer versions of Lua, a floating-point number has another text.

function View:byte(at)
  return math.floor(self:range(at, 1):uint())
end

function View:le16(at)
  return math.floor(self:range(at, 2):le_uint())
end

function View:be16(at)
  return math.floor(self:range(at, 2):uint())
end

function View:le32(at)
  return math.floor(self:range(at, 4):le_uint())
end

function View:be32(at)
  return math.floor(self:range(at, 4):uint())
end

function View:float(at)
  return self:range(at, 4):le_float()
end

-- The sum of all bytes.
function View:sum()
  local sum = 0
  for at = 0, self.len - 1 do
    sum = sum + self:byte(at)
  end
  return sum
end

function View:is_zero(from)
  return self:part(from, self.len - from):sum() == 0
end

function View:hex()
  local digits = {}
  for at = 0, self.len - 1 do
    digits[at + 1] = string.format("%02X", self:byte(at))
  end
  return table.concat(digits, " ")
end

local ESCAPES = { [9] = "\\t", [10] = "\\n", [13] = "\\r", [34] = '\\"', [39] = "\\'", [92] = "\\\\" }

local function escape(byte)
  local is_printable = byte >= 32 and byte < 127
  return ESCAPES[byte] or string.format(is_printable and "%c" or "\\x%02x", byte)
end

-- Text up to the first NUL, or all of it, with escapes for bytes that are not printable.
function View:text(is_padded)
  local text = {}
  for at = 0, self.len - 1 do
    if is_padded and self:byte(at) == 0 then break end
    text[at + 1] = escape(self:byte(at))
  end
  return table.concat(text)
end

-- Words.

local function bit(mask, nth)
  return math.floor(mask / 2 ^ nth) % 2 == 1
end

-- Numbers as text without trailing zeros.
local function number(value)
  return string.format("%.7g", value)
end

-- Micrometres as metres without trailing zeros: a float has no more digits of an arm's length.
local function micrometres(value)
  local text = string.format("%.6f", math.floor(value + 0.5) / 1e6)
  return (text:gsub("0+$", ""):gsub("%.$", ""))
end

-- The texts of `count` items.
local function list(count, text)
  local texts = {}
  for nth = 1, count do
    texts[nth] = text(nth)
  end
  return table.concat(texts, " ")
end

-- The numbers, from 1, of bits with this value.
local function bits(mask, count, value)
  local found = {}
  for nth = 1, count do
    if bit(mask, nth - 1) == value then found[#found + 1] = nth end
  end
  return found
end

-- A name and its text, unless the text is empty.
local function fact(name, text)
  return text == "" and name or name .. ": " .. text
end

-- Adds a field for each joint or servo.
local function each(fields, count, key, make)
  for nth = 1, count do
    fields[key .. nth] = make(nth)
  end
end

-- Damage: the reasons why bytes are not a frame.

local function truncated(missing)
  return { kind = "truncated", text = string.format("no whole frame, %d bytes missing", missing) }
end

local function stray()
  return { kind = "stray", text = "no frame starts here" }
end

local function wrong_length(got, min, max)
  return { kind = "length", text = string.format("length field is %d, must be %d..=%d", got, min, max) }
end

local function wrong_byte(at, got, expected)
  return { kind = "byte", text = string.format("byte %d is 0x%02x, expected %s", at, got, expected) }
end

local function wrong_tail(got, expected)
  return { kind = "tail", text = string.format("end mark 0x%02x, expected 0x%02x", got, expected) }
end

-- Damage of a frame of `total` bytes, or nothing. It ends with a checksum of the bytes from `from` on, and a terminator.
local function verify(view, total, from, checksum, tail)
  if view.len < total then return truncated(total - view.len) end
  if view:byte(total - 1) ~= tail then return wrong_tail(view:byte(total - 1), tail) end
  local got, expected = view:byte(total - 2), checksum(view:part(from, total - 2 - from))
  if got == expected then return nil, total end
  return { kind = "checksum", text = string.format("checksum 0x%02x, expected 0x%02x", got, expected) }
end

-- A protocol: `scan` returns the damage of a packet's bytes, or nothing and the length of a frame at their beginning;
-- `message` fills the tree and returns the meaning of a frame, or nothing, and whether the arm refused or failed.

local function protocol(name, title, fields, functions)
  local proto = Proto(name, title)
  fields.direction = ProtoField.uint8(name .. ".direction", "Direction", base.DEC, DIRECTIONS)
  fields.message = ProtoField.string(name .. ".message", "Message")
  fields.damage = ProtoField.string(name .. ".damage", "Damage")
  fields.damaged = ProtoField.bytes(name .. ".damaged", "Damaged bytes")
  proto.fields = fields
  local expert_of = function(kind, text, group, severity)
    return ProtoExpert.new(name .. ".expert." .. kind, text, expert.group[group], expert.severity[severity])
  end
  local experts = {
    stray = expert_of("stray", "No frame starts here", "MALFORMED", "WARN"),
    truncated = expert_of("truncated", "Frame is not complete", "MALFORMED", "ERROR"),
    length = expert_of("length", "Wrong length", "MALFORMED", "ERROR"),
    byte = expert_of("byte", "Byte is not one of the allowed values", "MALFORMED", "ERROR"),
    tail = expert_of("end_mark", "Wrong end mark", "MALFORMED", "ERROR"),
    checksum = expert_of("checksum", "Wrong checksum", "CHECKSUM", "ERROR"),
    unknown = expert_of("unknown", "Not a message of the protocol", "UNDECODED", "WARN"),
    failed = expert_of("failed", "The arm refused or failed", "RESPONSE_CODE", "WARN"),
  }
  proto.experts = experts
  functions.proto, functions.fields, functions.experts = proto, fields, experts
  return functions
end

-- Filler between frames, which is not an error.
local function show_padding(view, pinfo, tree)
  pinfo.cols.info = "padding"
  tree:append_text(string.format(", padding: %d bytes", view.len))
end

local function show_damage(arm, view, damage, pinfo, tree)
  local text = "noise: " .. damage.text
  tree:append_text(", " .. text)
  tree:add(arm.fields.damage, view:range(0, view.len), text)
  tree:add(arm.fields.damaged, view:range(0, view.len)):add_proto_expert_info(arm.experts[damage.kind], damage.text)
  pinfo.cols.info = text
end

local function show_message(arm, view, direction, pinfo, tree)
  local text, is_failure = arm.message(view, direction, tree, pinfo)
  local item = tree:add(arm.fields.message, view:range(0, view.len), text or "no message")
  if not text then item:add_proto_expert_info(arm.experts.unknown) end
  if is_failure then item:add_proto_expert_info(arm.experts.failed) end
  tree:append_text(", " .. (text or "no message"))
  pinfo.cols.info = text or "no message: " .. view:hex()
end

-- One frame, or damaged bytes.
local function show(arm, view, direction, pinfo, tree)
  pinfo.cols.protocol = arm.name
  tree:add(arm.fields.direction, direction):set_generated()
  local damage, len = arm.scan(view, direction, pinfo)
  if damage and damage.kind == "padding" then return show_padding(view, pinfo, tree) end
  if not damage and len < view.len then
    damage = { kind = "length", text = string.format("%d bytes after the frame", view.len - len) }
  end
  if damage then return show_damage(arm, view, damage, pinfo, tree) end
  show_message(arm, view, direction, pinfo, tree)
end

-- Packets of a recording.
local function dissect_recorded(arm)
  return function(tvb, pinfo, root)
    local direction = tvb:len() > 1 and tvb:range(0, 1):uint()
    if not DIRECTIONS[direction] then
      pinfo.cols.protocol, pinfo.cols.info = arm.name, "not a packet of a recording"
      local text = "a packet is 0, 1 or 2 and at least one byte of the line"
      root:add(arm.proto):add_proto_expert_info(arm.experts.byte, text)
      return
    end
    local tree = root:add(arm.proto, tvb:range())
    pinfo.cols.src, pinfo.cols.dst = SOURCES[direction], DESTINATIONS[direction]
    show(arm, View.new(tvb, 1, tvb:len() - 1), direction, pinfo, tree)
  end
end

-- Ling / Alicia-D: AA, command, function, length, data, checksum, FF (docs/protocols/ling.md).

local JOINTS, CENTRE, TICKS = 6, 2048, 4096
local MAX_TICKS, MAX_SPEED, MAX_OPENING = 4095, 5000, 1000
local STROKES = { [0] = 50, [1] = 75, [2] = 100 }
local STATUS = {
  [0x00] = "idle",
  [0x01] = "locked",
  [0x10] = "syncing",
  [0x11] = "syncing, locked",
  [0xE1] = "overheating",
  [0xE2] = "overheat protection",
}
-- Servos of a leader and of a follower.
local LEADER, FOLLOWER = 6, 10

-- A force-feedback leader.
local MODES = { [0] = "position", [1] = "current" }
local MODE_RESULTS = { [0] = "accepted", [1] = "invalid", [2] = "unsupported or not queued" }
local FORCES = {
  { "residual_torque", "residual torque", "Nm" },
  { "requested_current", "requested current", "A" },
  { "output_current", "output current", "A" },
  { "measured_current", "measured current", "A" },
}
local INHIBIT = {
  [0] = "not in teleoperation",
  [2] = "link or sample older than 30 ms",
  [3] = "hardware fault",
  [4] = "unsupported",
}

local ling_fields = {
  command = ProtoField.uint8("ling.command", "Command", base.HEX),
  func = ProtoField.uint8("ling.function", "Function", base.HEX),
  length = ProtoField.uint8("ling.length", "Length"),
  checksum = ProtoField.uint8("ling.checksum", "Checksum", base.HEX),
  parity = ProtoField.uint8("ling.parity", "Parity of the data"),
  torque = ProtoField.bool("ling.torque", "Torque"),
  stroke = ProtoField.uint8("ling.stroke", "Gripper stroke (mm)"),
  limit = ProtoField.uint8("ling.temperature_limit", "Temperature limit (°C)"),
  gripper = ProtoField.uint16("ling.gripper", "Gripper opening (thousandths)"),
  gripper_speed = ProtoField.uint16("ling.gripper.speed", "Gripper speed (ticks/s)"),
  status = ProtoField.uint8("ling.status", "Motion status", base.HEX, STATUS),
  extra = ProtoField.bytes("ling.extra", "Bytes after the documented fields"),
  serial = ProtoField.string("ling.serial", "Serial number"),
  hardware = ProtoField.string("ling.hardware", "Hardware version"),
  firmware = ProtoField.string("ling.firmware", "Firmware version"),
  mode = ProtoField.uint8("ling.mode", "Control mode", nil, MODES),
  mode_result = ProtoField.uint8("ling.mode.result", "Result of the requested mode", nil, MODE_RESULTS),
  blocked = ProtoField.uint8("ling.mode.blocked", "Blocked joints", base.HEX),
  valid = ProtoField.uint8("ling.mode.valid", "Joints with valid values", base.HEX),
  feedback_requested = ProtoField.bool("ling.force_feedback.requested", "Force feedback is requested"),
  feedback_effective = ProtoField.bool("ling.force_feedback.effective", "Force feedback is effective"),
  feedback_inhibit = ProtoField.uint8("ling.force_feedback.inhibit", "Reasons against force feedback", base.HEX),
  feedback_sync = ProtoField.bool("ling.force_feedback.sync", "Synchronization is active"),
  feedback_torque = ProtoField.bool("ling.force_feedback.torque", "Torque is on"),
  feedback_torque_requested = ProtoField.bool("ling.force_feedback.torque_requested", "Torque is requested"),
  feedback_transition = ProtoField.uint8("ling.force_feedback.transition", "Transition (diagnostic)"),
  feedback_grip = ProtoField.uint8("ling.force_feedback.grip", "Grip (raw, diagnostic)"),
  feedback_mode = ProtoField.uint8("ling.force_feedback.requested_mode", "Requested mode (diagnostic)"),
  older_gripper = ProtoField.uint16("ling.older.gripper", "Gripper's servo (raw)"),
  potentiometer = ProtoField.uint16("ling.older.potentiometer", "Potentiometer (raw)"),
  sync_button = ProtoField.uint8("ling.older.sync_button", "Sync button"),
  attitude_button = ProtoField.uint8("ling.older.attitude_button", "Attitude button"),
}
each(ling_fields, JOINTS, "ticks", function(n)
  return ProtoField.uint16("ling.joint" .. n .. ".ticks", "Joint " .. n .. " (ticks)")
end)
each(ling_fields, JOINTS, "rad", function(n)
  return ProtoField.double("ling.joint" .. n .. ".rad", "Joint " .. n .. " (rad)")
end)
each(ling_fields, JOINTS, "speed", function(n)
  return ProtoField.uint16("ling.joint" .. n .. ".speed", "Joint " .. n .. " speed (ticks/s)")
end)
each(ling_fields, FOLLOWER, "temperature", function(n)
  return ProtoField.uint8("ling.servo" .. n .. ".temperature", "Servo " .. n .. " temperature (°C)")
end)
each(ling_fields, FOLLOWER, "velocity", function(n)
  return ProtoField.uint16("ling.servo" .. n .. ".velocity", "Servo " .. n .. " velocity (ticks/s)")
end)
each(ling_fields, FOLLOWER, "normal", function(n)
  return ProtoField.bool("ling.servo" .. n .. ".normal", "Servo " .. n .. " is normal")
end)
each(ling_fields, 9, "servo", function(n)
  return ProtoField.uint16("ling.servo" .. n .. ".ticks", "Servo " .. n .. " (ticks)")
end)

for _, force in ipairs(FORCES) do
  each(ling_fields, JOINTS, force[1], function(n)
    local label = "Joint " .. n .. " " .. force[2] .. " (" .. force[3] .. ")"
    return ProtoField.double("ling.joint" .. n .. "." .. force[1], label)
  end)
end

local xor = (_G.bit or _G.bit32 or {}).bxor or load("return function(a, b) return a ~ b end")()

-- CRC-32/ISO-HDLC of each byte.
local CRC = {}
for byte = 0, 255 do
  local crc = byte
  for _ = 1, 8 do
    local shifted = math.floor(crc / 2)
    crc = crc % 2 == 0 and shifted or xor(shifted, 0xEDB88320) % 2 ^ 32
  end
  CRC[byte] = math.floor(crc)
end

local function ling_checksum(view)
  local crc = 0xFFFFFFFF
  for at = 0, view.len - 1 do
    local byte = xor(crc % 256, view:byte(at))
    crc = math.floor(xor(math.floor(crc / 256), CRC[byte]) % 2 ^ 32)
  end
  return 255 - crc % 256
end

local function ling_parity(view)
  return view:sum() % 2
end

local function degrees(ticks)
  return ticks * 360 / TICKS
end

-- The angle of a position.
local function angle(ticks)
  return string.format("%+.2f°", degrees(ticks - CENTRE))
end

local function add_joint(tree, range, nth, ticks)
  tree:add(ling_fields["ticks" .. nth], range, ticks)
  tree:add(ling_fields["rad" .. nth], range, (ticks - CENTRE) / TICKS * 2 * math.pi):set_generated()
end

-- Positions of the joints at these offsets.
local function ling_joints(data, tree, offset)
  return "joints: " .. list(JOINTS, function(nth)
    local ticks = data:le16(offset(nth))
    add_joint(tree, data:range(offset(nth), 2), nth, ticks)
    return angle(ticks) .. (ticks > MAX_TICKS and " (out of range)" or "")
  end)
end

local function no_value(text)
  return function(data)
    return data.len == 1 and data:byte(0) == 0xFE and text or nil
  end
end

local function set_stroke(mm)
  return no_value("set gripper stroke " .. mm .. " mm")
end

local function set_torque(data, tree)
  if data.len ~= 1 or data:byte(0) > 1 then return nil end
  local is_on = data:byte(0) == 1
  tree:add(ling_fields.torque, data:range(0, 1), is_on)
  return is_on and "torque on" or "torque off"
end

local function temperature(data, tree)
  if data.len ~= 1 then return nil end
  local celsius = data:byte(0)
  if celsius == 0xFE then return "read temperatures" end
  tree:add(ling_fields.limit, data:range(0, 1), celsius)
  return "set temperature limit " .. celsius .. " °C"
end

local function move(data, tree)
  if data.len ~= 4 * (JOINTS + 1) then return nil end
  for nth = 1, JOINTS do
    if data:le16(4 * nth - 4) > MAX_TICKS or data:le16(4 * nth - 2) > MAX_SPEED then return nil end
  end
  local opening, gripper_speed = data:le16(4 * JOINTS), data:le16(4 * JOINTS + 2)
  if opening > MAX_OPENING then return nil end
  local joints = list(JOINTS, function(nth)
    local ticks, speed = data:le16(4 * nth - 4), data:le16(4 * nth - 2)
    add_joint(tree, data:range(4 * nth - 4, 2), nth, ticks)
    tree:add(ling_fields["speed" .. nth], data:range(4 * nth - 2, 2), speed)
    return string.format("%s at %.1f°/s", angle(ticks), degrees(speed))
  end)
  tree:add(ling_fields.gripper, data:range(4 * JOINTS, 2), opening)
  tree:add(ling_fields.gripper_speed, data:range(4 * JOINTS + 2, 2), gripper_speed)
  return string.format("move %s, gripper %.1f %% at %d ticks/s", joints, opening / 10, gripper_speed)
end

-- The document prints this request with length 0 and one data byte. It is well-formed with length 0 or 1.
local function self_check_request(data)
  if data.len == 0 then return "self-check" end
  return no_value("self-check")(data)
end

local function ling_version(data, at)
  local version = data:le32(at)
  return string.format("v%d.%02d", math.floor(version / 100), version % 100)
end

local function information(data, tree)
  if data.len ~= 24 then return nil end
  local serial = data:part(0, 16):text(true)
  local kind = ({ ADL = "Ling leader", ADF = "Ling follower" })[data:part(0, 3):text()]
  local hardware, firmware = ling_version(data, 16), ling_version(data, 20)
  tree:add(ling_fields.serial, data:range(0, 16), serial)
  tree:add(ling_fields.hardware, data:range(16, 4), hardware)
  tree:add(ling_fields.firmware, data:range(20, 4), firmware)
  kind = kind or "Ling, of unknown kind"
  return string.format("arm: %s, %s, hardware: %s, firmware: %s", kind, fact("serial", serial), hardware, firmware)
end

local function stroke(data, tree)
  local mm = data.len == 1 and STROKES[data:byte(0)]
  if not mm then return nil end
  tree:add(ling_fields.stroke, data:range(0, 1), mm)
  return "stroke: " .. mm .. " mm"
end

-- The status of another robot: an Alicia-D answers with 15 data bytes, or 16. Nothing for an Alicia-D.
local ROBOTS = { [33] = "Bessica-D" }
local function foreign(total)
  if total == 15 or total == 16 then return nil end
  local robot = ROBOTS[total] and " but a " .. ROBOTS[total] or ""
  return string.format("not an Alicia-D%s (%d data bytes)", robot, total)
end

local function joint_state(data, tree, total)
  if data.len ~= 2 * JOINTS + 3 then return nil end
  local joints = ling_joints(data, tree, function(nth) return 2 * nth - 2 end)
  local gripper, status = data:le16(12), data:byte(14)
  tree:add(ling_fields.gripper, data:range(12, 2), gripper)
  tree:add(ling_fields.status, data:range(14, 1), status)
  local opening = gripper > MAX_OPENING and "(out of range)" or "open"
  local status_text = foreign(total) or STATUS[status] or string.format("unknown status 0x%02x", status)
  return string.format("%s, gripper: %.1f %% %s, status: %s", joints, gripper / 10, opening, status_text)
end

local function temperatures(data, tree)
  if data.len ~= LEADER and data.len ~= FOLLOWER then return nil end
  return "temperatures: " .. list(data.len, function(nth)
    tree:add(ling_fields["temperature" .. nth], data:range(nth - 1, 1), data:byte(nth - 1))
    return tostring(data:byte(nth - 1))
  end) .. " °C"
end

local function velocities(data, tree)
  if data.len ~= 2 * LEADER and data.len ~= 2 * FOLLOWER then return nil end
  return "velocities: " .. list(data.len / 2, function(nth)
    local ticks = data:le16(2 * nth - 2)
    tree:add(ling_fields["velocity" .. nth], data:range(2 * nth - 2, 2), ticks)
    return string.format("%.1f", degrees(ticks))
  end) .. " °/s"
end

local function self_check(data, tree)
  if data.len ~= 2 then return nil end
  local mask = data:le16(0)
  for nth = 1, FOLLOWER do
    tree:add(ling_fields["normal" .. nth], data:range(0, 2), bit(mask, nth - 1))
  end
  local faulty = bits(mask, FOLLOWER, false)
  if #faulty == 0 then return string.format("self-check: all %d servos normal", FOLLOWER) end
  local lacks_rest = math.floor(mask / 2 ^ LEADER) % 2 ^ (FOLLOWER - LEADER) == 0
  local hint = lacks_rest and " (a leader has none of 7 to 10)" or ""
  return "self-check: servos not normal: " .. table.concat(faulty, ", ") .. hint
end

local function set_mode(data, tree)
  local mode = data.len == 1 and MODES[data:byte(0)]
  if not mode then return nil end
  tree:add(ling_fields.mode, data:range(0, 1), data:byte(0))
  return "set control mode " .. mode
end

local function force_feedback_request(data)
  local texts = { [0] = "force feedback off", [1] = "force feedback on", [0xFE] = "read force feedback" }
  return data.len == 1 and texts[data:byte(0)] or nil
end

local function mode_reply(data, tree)
  if data.len ~= 3 or data:byte(0) ~= 1 then return nil end
  local mode, result = data:byte(1), MODE_RESULTS[data:byte(2)]
  if not result then return nil end
  tree:add(ling_fields.mode, data:range(1, 1), mode)
  tree:add(ling_fields.mode_result, data:range(2, 1), data:byte(2))
  return string.format("requested mode: %s, result: %s", MODES[mode] or string.format("0x%02x", mode), result)
end

-- The numbers of the joints in a mask.
local function joint_numbers(mask)
  local numbers = bits(mask, 8, true)
  return #numbers > 0 and table.concat(numbers, " ") or "none"
end

local function mode_state(data, tree)
  if data.len ~= 4 + 8 * JOINTS or data:byte(0) ~= 1 then return nil end
  local mode = MODES[data:byte(1)]
  if not mode then return nil end
  tree:add(ling_fields.mode, data:range(1, 1), data:byte(1))
  tree:add(ling_fields.blocked, data:range(2, 1), data:byte(2))
  tree:add(ling_fields.valid, data:range(3, 1), data:byte(3))
  local blocked, valid = joint_numbers(data:byte(2)), joint_numbers(data:byte(3))
  local text = string.format("mode: %s, blocked: %s, valid: %s", mode, blocked, valid)
  for place, force in ipairs(FORCES) do
    local values = list(JOINTS, function(nth)
      local at = 4 + 8 * (nth - 1) + 2 * (place - 1)
      local value = (data:le16(at) + 0x8000) % 0x10000 - 0x8000
      tree:add(ling_fields[force[1] .. nth], data:range(at, 2), value / 1000)
      local sign, size = value < 0 and "-" or "", math.abs(value)
      return string.format("%s%d.%03d", sign, math.floor(size / 1000), size % 1000)
    end)
    text = string.format("%s, %ss: %s %s", text, force[2], values, force[3])
  end
  return text
end

-- The reasons against force feedback.
local function inhibition(mask)
  local reasons, rest = {}, mask
  for nth = 0, 4 do
    if INHIBIT[nth] and bit(mask, nth) then
      reasons[#reasons + 1] = INHIBIT[nth]
      rest = rest - math.floor(2 ^ nth)
    end
  end
  if rest > 0 then reasons[#reasons + 1] = string.format("unknown 0x%02x", rest) end
  return #reasons > 0 and table.concat(reasons, "; ") or "none"
end

local function force_feedback(data, tree)
  if data.len ~= 10 or data:byte(0) ~= 2 then return nil end
  for _, at in ipairs({ 1, 2, 4, 5, 6 }) do
    if data:byte(at) > 1 then return nil end
  end
  local function switch(name, at)
    tree:add(ling_fields["feedback_" .. name], data:range(at, 1), data:byte(at) == 1)
    return data:byte(at) == 1 and "on" or "off"
  end
  local function add(name, at)
    tree:add(ling_fields["feedback_" .. name], data:range(at, 1), data:byte(at))
    return data:byte(at)
  end
  local requested, effective = switch("requested", 1), switch("effective", 2)
  local inhibit, sync = inhibition(add("inhibit", 3)), switch("sync", 4)
  local torque, torque_requested = switch("torque", 5), switch("torque_requested", 6)
  local text = "requested: %s, effective: %s, inhibit: %s, sync: %s, torque: %s, requested torque: %s, "
  text = string.format(text, requested, effective, inhibit, sync, torque, torque_requested)
  local transition, grip, mode = add("transition", 7), add("grip", 8), add("mode", 9)
  return text .. string.format("transition: %d, raw grip: %d, requested mode: %d", transition, grip, mode)
end

-- Messages by command * 256 + function. Each takes the data, the tree and the number of all data bytes, and returns the
-- meaning, or nothing for data of another length or value.
local LING = {
  [HOST] = {
    [0x0100] = no_value("read information"),
    [0x0300] = no_value("set zero position"),
    [0x0400] = set_stroke(50),
    [0x0401] = set_stroke(75),
    [0x0402] = set_stroke(100),
    [0x040E] = no_value("read gripper stroke"),
    [0x0500] = set_torque,
    [0x0501] = set_mode,
    [0x0600] = no_value("read joints"),
    [0x0601] = temperature,
    [0x0602] = no_value("read velocities"),
    [0x0603] = move,
    [0x0620] = force_feedback_request,
    [0x0624] = no_value("read control mode"),
    [0xFE00] = self_check_request,
  },
  [ARM] = {
    [0x0100] = information,
    [0x040E] = stroke,
    [0x0501] = mode_reply,
    [0x0600] = joint_state,
    [0x0601] = temperatures,
    [0x0602] = velocities,
    [0x0620] = force_feedback,
    [0x0624] = mode_state,
    [0xFE00] = self_check,
  },
  [UNKNOWN] = {},
}

local LENGTHS = {
  [0x0100] = 24,
  [0x040E] = 1,
  [0x0501] = 3,
  [0x0600] = 2 * JOINTS + 3,
  [0x0620] = 10,
  [0x0624] = 4 + 8 * JOINTS,
  [0xFE00] = 2,
}

-- The length of the documented fields in an answer of `len` bytes. Arms may send more.
local function documented_length(key, len)
  if key == 0x0601 then return len < FOLLOWER and LEADER or FOLLOWER end
  if key == 0x0602 then return 2 * (len < 2 * FOLLOWER and LEADER or FOLLOWER) end
  return LENGTHS[key] or len
end

-- The older generation: AA, command, length, data, parity, FF. It only sends. Nine servos move six joints.
local OLDER_JOINTS = { 1, 3, 5, 7, 8, 9 }

local function older_joints(data, tree)
  for nth = 1, 9 do
    tree:add(ling_fields["servo" .. nth], data:range(2 * nth - 2, 2), data:le16(2 * nth - 2))
  end
  return ling_joints(data, tree, function(nth) return 2 * OLDER_JOINTS[nth] - 2 end)
end

local function older_gripper(data, tree)
  tree:add(ling_fields.older_gripper, data:range(1, 2), data:le16(1))
  tree:add(ling_fields.potentiometer, data:range(3, 2), data:le16(3))
  tree:add(ling_fields.sync_button, data:range(5, 1), data:byte(5))
  tree:add(ling_fields.attitude_button, data:range(6, 1), data:byte(6))
  local text = "gripper: %d, potentiometer: %d, sync button: %d, attitude button: %d"
  return string.format(text, data:le16(1), data:le16(3), data:byte(5), data:byte(6))
end

-- Messages by command * 256 + length. No message of the current generation begins with these bytes.
local OLDER = {
  [0x0412] = older_joints,
  [0x1412] = older_joints,
  [0x0207] = older_gripper,
  [0x1207] = older_gripper,
}

local function older_message(view)
  return view.len >= 3 and OLDER[view:be16(1)]
end

local MAX_DATA = 64

local function scan_ling(view)
  if view:byte(0) ~= 0xAA then return stray() end
  if view.len < 4 then return truncated(4 - view.len) end
  if older_message(view) then return verify(view, view:byte(2) + 5, 3, ling_parity, 0xFF) end
  local len = view:byte(3)
  if len > MAX_DATA then return wrong_length(len, 0, MAX_DATA) end
  -- The self-check as printed in the document: length 0, and one data byte.
  if view.len > 4 and view:be32(1) == 0xFE0000FE then len = 1 end
  return verify(view, len + 6, 1, ling_checksum, 0xFF)
end

local function ling_message(view, direction, tree)
  tree:add(ling_fields.command, view:range(1, 1), view:byte(1))
  local older = older_message(view)
  if older then
    tree:add(ling_fields.length, view:range(2, 1), view:byte(2))
    tree:add(ling_fields.parity, view:range(view.len - 2, 1), view:byte(view.len - 2))
    return older(view:part(3, view.len - 5), tree)
  end
  tree:add(ling_fields.func, view:range(2, 1), view:byte(2))
  tree:add(ling_fields.length, view:range(3, 1), view:byte(3))
  tree:add(ling_fields.checksum, view:range(view.len - 2, 1), view:byte(view.len - 2))
  -- The arm's error frame. The sources contradict each other on its content.
  if direction == ARM and view:byte(1) == 0xEE then return "error frame " .. view:hex() end
  local message, data = LING[direction][view:be16(1)], view:part(4, view.len - 6)
  if not message then return nil end
  local len = direction == ARM and math.min(documented_length(view:be16(1), data.len), data.len) or data.len
  local text, rest = message(data:part(0, len), tree, data.len), data.len - len
  if not text or rest == 0 then return text end
  tree:add(ling_fields.extra, data:range(len, rest))
  return text .. ", extra: " .. data:part(len, rest):hex()
end

local ling = protocol("ling", "Ling / Alicia-D robot arm", ling_fields, {
  name = "Ling",
  scan = scan_ling,
  message = ling_message,
})

-- UFACTORY xArm: transaction, protocol id and length, big-endian; then register, state in answers, and parameters
-- (docs/protocols/xarm.md).

local MODBUS, HEARTBEAT, LAST_ID = 0, 1, 3
local XARM_HEADER, MAX_BODY = 6, 254
local INVALID = 3
local STATES = { [3] = "invalid", [4] = "not ready to move", [5] = "warning", [6] = "error" }
local POSITIONS, CODES, AXES = 42, 15, 7
local POSE = { "x (mm)", "y (mm)", "z (mm)", "roll (rad)", "pitch (rad)", "yaw (rad)" }

local xarm_fields = {
  transaction = ProtoField.uint16("xarm.transaction", "Transaction"),
  id = ProtoField.uint16("xarm.protocol_id", "Protocol id"),
  length = ProtoField.uint16("xarm.length", "Length"),
  register = ProtoField.uint8("xarm.register", "Register"),
  state = ProtoField.uint8("xarm.state", "State", base.HEX),
  parameters = ProtoField.bytes("xarm.parameters", "Parameters"),
  extra = ProtoField.bytes("xarm.extra", "Bytes after the documented parameters"),
  text = ProtoField.string("xarm.text", "Text"),
  joint = ProtoField.uint8("xarm.joint", "Joint"),
  source = ProtoField.uint8("xarm.torque_source", "Torque source", base.DEC, { [0] = "torque", [1] = "current" }),
  radius = ProtoField.float("xarm.rotation_radius", "Rotation radius (mm)"),
  control = ProtoField.uint8("xarm.control", "System control", base.DEC, { [1] = "shut down", [2] = "reboot" }),
  unit = ProtoField.uint8("xarm.modbus.unit", "Modbus unit"),
  func = ProtoField.uint8("xarm.modbus.function", "Modbus function"),
  report_length = ProtoField.uint32("xarm.report.length", "Length of the report"),
  report_state = ProtoField.uint8("xarm.report.state", "Motion state"),
  report_mode = ProtoField.uint8("xarm.report.mode", "Mode"),
  report_commands = ProtoField.uint16("xarm.report.commands", "Commands in the queue"),
  report_rest = ProtoField.bytes("xarm.report.rest", "Rest of the report"),
}
each(xarm_fields, AXES, "rad", function(n)
  return ProtoField.float("xarm.joint" .. n .. ".rad", "Joint " .. n .. " (rad)")
end)
each(xarm_fields, AXES, "effort", function(n)
  return ProtoField.float("xarm.joint" .. n .. ".torque", "Joint " .. n .. " torque")
end)
each(xarm_fields, #POSE, "pose", function(n)
  return ProtoField.float("xarm.pose." .. POSE[n]:match("^%a+"), "Pose " .. POSE[n])
end)

local function state_text(state)
  local texts, known = {}, 0
  for nth = INVALID, 6 do
    if bit(state, nth) then
      texts[#texts + 1], known = STATES[nth], known + 2 ^ nth
    end
  end
  if state ~= known then texts[#texts + 1] = string.format("other bits 0x%02x", state - known) end
  return #texts > 0 and table.concat(texts, ", ") or "ok"
end

local function read(text)
  return function(params)
    return params.len == 0 and text or nil
  end
end

local function read_radius(params, tree)
  if params.len ~= 1 or params:byte(0) < 1 or params:byte(0) > AXES then return nil end
  tree:add(xarm_fields.joint, params:range(0, 1), params:byte(0))
  return "read rotation radius of joint " .. params:byte(0)
end

local function control(params, tree)
  local text = params.len == 1 and ({ "shut down", "reboot" })[params:byte(0)]
  if not text then return nil end
  tree:add(xarm_fields.control, params:range(0, 1), params:byte(0))
  return text
end

-- The reason why a text is not a version; or nothing.
local function version_error(text)
  if text:find("[^ -~]") then return "the version is not printable ASCII" end
  local _, commas = text:gsub(",", ",")
  if commas ~= 4 then
    return string.format("the version has %d fields, expected axes,type,arm,control box,firmware", commas + 1)
  end
  local axes, kind = text:match("^(%d+),"), text:match("^[^,]*,(%d+),")
  if not axes or tonumber(axes) > 255 then return "the number of axes in the version is not a number up to 255" end
  if not kind or tonumber(kind) > 255 then return "the type in the version is not a number up to 255" end
end

-- The parts of a version: axes, type, arm, control box, firmware.
local function xarm_version(params, tree)
  local escaped, text = params:text(true), params:range(0, params.len):raw():match("^[^\0]*")
  tree:add(xarm_fields.text, params:range(0, params.len), escaped)
  local error = version_error(text)
  if error then return "arm: xArm, " .. fact("version", string.format("%s (%s)", escaped, error)) end
  local axes, kind, arm, box, firmware = text:match("^(%d+),(%d+),([^,]*),([^,]*),([^,]*)$")
  local parts = { fact("hardware", arm), fact("control box", box), fact("firmware", firmware) }
  return string.format("arm: xArm, %d axes, type %d, %s", axes, kind, table.concat(parts, ", "))
end

-- Two texts, separated and padded with NUL. The second ends with a line feed.
local function serials(params, tree)
  local arm = params:text(true)
  local first = 0
  while first < params.len and params:byte(first) ~= 0 do
    first = first + 1
  end
  local rest = math.min(first + 1, params.len)
  local box = params:part(rest, params.len - rest):text(true):gsub("\\n$", "")
  local text = arm:gsub("\\n$", "") .. ", control box " .. box
  tree:add(xarm_fields.text, params:range(0, params.len), text)
  return "serial: " .. text
end

local TORQUE_SOURCES = { [0] = "the joints' torque, computed", [1] = "the servos' current, measured" }

local function torque_source(params, tree)
  local text = params.len == 1 and TORQUE_SOURCES[params:byte(0)]
  if not text then return nil end
  tree:add(xarm_fields.source, params:range(0, 1), params:byte(0))
  return "torque: " .. text
end

local function radius(params, tree)
  if params.len ~= 4 then return nil end
  tree:add(xarm_fields.radius, params:range(0, 4), params:float(0))
  return "rotation radius: " .. micrometres(params:float(0) * 1000) .. " m"
end

local function control_value(params)
  return params.len == 2 and "system control: value " .. params:be16(0) or nil
end

-- Registers of the document: a request, an answer, and the name of an answer without a value. All others are raw.
local REGISTERS = {
  [1] = { request = read("read version"), answer = xarm_version, empty = "version", none = "no value" },
  [2] = { request = read("read serial numbers"), answer = serials, empty = "serial", none = "no value" },
  [4] = { request = read("reload dynamics"), len = 0, empty = "reload dynamics", none = "done" },
  [5] = { request = read("read torque source"), answer = torque_source, len = 1, empty = "torque", none = "no value" },
  [6] = { request = read_radius, answer = radius, len = 4, empty = "rotation radius", none = "no value" },
  [10] = { request = control, answer = control_value, len = 2, empty = "system control", none = "done" },
}

-- The length of a reply's documented parameters, of so many. Texts and undocumented registers have none. Register 10
-- is documented without parameters, and with a number.
local function documented_parameters(register, len)
  local known = REGISTERS[register]
  if register == 10 and len < known.len then return 0 end
  return math.min(known and known.len or len, len)
end

local function add_floats(data, tree, key, at, count)
  for nth = 1, count do
    tree:add(xarm_fields[key .. nth], data:range(at + 4 * nth - 4, 4), data:float(at + 4 * nth - 4))
  end
end

local function raw(register, params, tree, separator)
  if params.len == 0 then return "register " .. register .. separator .. "no value" end
  tree:add(xarm_fields.parameters, params:range(0, params.len))
  if register == POSITIONS and params.len == 4 * AXES then add_floats(params, tree, "rad", 0, AXES) end
  return "register " .. register .. separator .. params:hex()
end

-- The errors that have a meaning.
local ERRORS = {
  [1] = "emergency stop button of the control box is pressed",
  [2] = "emergency input of the control box is triggered",
  [3] = "emergency stop button of the three-state switch is pressed",
  [10] = "servo motor error",
  [11] = "servo motor 1 error",
  [12] = "servo motor 2 error",
  [13] = "servo motor 3 error",
  [14] = "servo motor 4 error",
  [15] = "servo motor 5 error",
  [16] = "servo motor 6 error",
  [17] = "servo motor 7 error",
  [18] = "no communication with the force torque sensor",
  [19] = "no communication with the end effector",
  [21] = "kinematic error",
  [22] = "self-collision",
  [23] = "joint angle exceeds its limit",
  [24] = "speed exceeds its limit",
  [25] = "planning error",
  [26] = "Linux real-time error",
  [27] = "error in the reply to a command",
  [28] = "no communication with the end module",
  [30] = "measured speed exceeds its limit",
  [31] = "abnormal current, caused by a collision",
  [32] = "three points define no circle",
  [33] = "error of the control box's inputs and outputs",
  [34] = "recording exceeds its maximum duration",
  [35] = "safety boundary reached",
  [36] = "too many delayed commands",
  [37] = "abnormal motion in manual mode",
  [38] = "abnormal joint angle",
  [39] = "no communication between the two processors of the power board",
  [40] = "no solution for the joint trajectory",
  [41] = "invalid friction file",
  [42] = "invalid calibration file",
  [50] = "force torque sensor cannot be read",
  [51] = "mode of the force torque sensor cannot be set",
  [52] = "zero of the force torque sensor cannot be set",
  [53] = "force torque sensor is overloaded",
  [60] = "linear speed exceeds its limit in servo mode",
  [110] = "no communication with the arm's base board",
  [111] = "no communication with an RS-485 device at the control box",
}
-- The warnings that have a meaning.
local WARNINGS = {
  [11] = "command queue is full",
  [12] = "invalid parameter of a command",
  [13] = "unknown command",
  [14] = "no solution for a command",
  [15] = "Modbus command queue is full",
}

local function code(number, meanings)
  if number == 0 then return "none" end
  local meaning = meanings[number]
  return meaning and string.format("%d (%s)", number, meaning) or tostring(number)
end

local function xarm_request(register, params, tree)
  local known = REGISTERS[register]
  if known then return known.request(params, tree) end
  return raw(register, params, tree, ", ")
end

local function xarm_reply(register, state, params, tree)
  local known = REGISTERS[register]
  local with_state = ", state: " .. state_text(state)
  if not known then
    local text = raw(register, params, tree, ": ")
    if register == CODES and params.len >= 2 then
      local error, warning = code(params:byte(0), ERRORS), code(params:byte(1), WARNINGS)
      text = string.format("%s (error: %s, warning: %s)", text, error, warning)
    end
    return text .. with_state
  end
  local text = known.empty .. ": " .. known.none
  if params.len > 0 then text = known.answer(params, tree) end
  if not text then return nil end
  -- A refusal has no value, whatever its parameters are.
  if bit(state, INVALID) then return string.format("%s: not reported (state %s)", known.empty, state_text(state)) end
  return text .. with_state
end

local function xarm_answer(register, body, tree)
  if body.len < 2 then return nil end
  local state = body:byte(1)
  tree:add(xarm_fields.state, body:range(1, 1), state):append_text(" " .. state_text(state))
  local len = documented_parameters(register, body.len - 2)
  local text, rest = xarm_reply(register, state, body:part(2, len), tree), body.len - 2 - len
  if not text then return nil end
  if rest > 0 then
    tree:add(xarm_fields.extra, body:range(2 + len, rest))
    text = text .. ", extra: " .. body:part(2 + len, rest):hex()
  end
  return text, bit(state, INVALID)
end

-- Standard Modbus TCP has the same header. An arm supports none of its functions.
local function xarm_modbus(body, direction, tree)
  local unit, func = body:byte(0), body:byte(1)
  tree:add(xarm_fields.unit, body:range(0, 1), unit)
  tree:add(xarm_fields.func, body:range(1, 1), func)
  if direction == HOST or func < 0x80 or body.len ~= 3 or body:byte(2) ~= 1 then return nil end
  return string.format("refused: no standard Modbus function %d, unit %d", func % 0x80, unit)
end

local function xarm_envelope(transaction, id)
  if id == MODBUS then return string.format(" (transaction %d)", transaction) end
  return string.format(" (transaction %d, protocol id %d)", transaction, id)
end

local function scan_xarm(view, direction)
  if view.len < XARM_HEADER then return truncated(XARM_HEADER - view.len) end
  if view:byte(2) ~= 0 then return wrong_byte(2, view:byte(2), "0x00") end
  local id, len = view:byte(3), view:be16(4)
  if id > LAST_ID then return wrong_byte(3, id, "0x00 or 0x01 or 0x02 or 0x03") end
  local is_request = id > HEARTBEAT and direction == HOST
  local min, max = is_request and 1 or 2, is_request and MAX_BODY - 1 or MAX_BODY
  if id == HEARTBEAT then max = 2 end
  if len < min or len > max then return wrong_length(len, min, max) end
  local total = XARM_HEADER + len
  if view.len < total then return truncated(total - view.len) end
  if id ~= HEARTBEAT then return nil, total end
  for at = 0, total - 1 do
    local expected = ({ [3] = 1, [5] = 2 })[at] or 0
    if view:byte(at) ~= expected then return wrong_byte(at, view:byte(at), "0x00") end
  end
  return nil, total
end

local function xarm_message(view, direction, tree)
  local transaction, id, register = view:be16(0), view:be16(2), view:byte(XARM_HEADER)
  tree:add(xarm_fields.transaction, view:range(0, 2), transaction)
  tree:add(xarm_fields.id, view:range(2, 2), id)
  tree:add(xarm_fields.length, view:range(4, 2), view:be16(4))
  if id == HEARTBEAT then return "heartbeat" end
  local body = view:part(XARM_HEADER, view.len - XARM_HEADER)
  local text, is_refusal
  if id == MODBUS then
    text = xarm_modbus(body, direction, tree)
  else
    tree:add(xarm_fields.register, body:range(0, 1), register)
    if direction == HOST then
      text = xarm_request(register, body:part(1, body.len - 1), tree)
    else
      text, is_refusal = xarm_answer(register, body, tree)
    end
  end
  return text and text .. xarm_envelope(transaction, id), is_refusal
end

local xarm = protocol("xarm", "UFACTORY xArm", xarm_fields, {
  name = "xArm",
  scan = scan_xarm,
  message = xarm_message,
})

-- xArm on TCP: frames on port 502, which is also that of standard Modbus; reports on ports 30000 to 30003.

local CONTROL_PORT, REPORT_PORTS = 502, { 30000, 30001, 30002, 30003 }
local REPORT_HEADER, MIN_REPORT, MAX_REPORT = 4, 87, 1024

-- Bytes that do not begin a frame are shown to the end of the segment: TCP loses no byte, and the stream is broken.
local function frame_len(tvb, _, offset)
  local view = View.new(tvb, offset, XARM_HEADER)
  if view:byte(2) ~= 0 or view:byte(3) > LAST_ID then return tvb:reported_length_remaining(offset) end
  return XARM_HEADER + view:be16(4)
end

local function report_len(tvb, _, offset)
  local len = tvb:range(offset, REPORT_HEADER):uint()
  local is_report = len >= MIN_REPORT and len <= MAX_REPORT
  return is_report and len or tvb:reported_length_remaining(offset)
end

local modbus = DissectorTable.get("tcp.port"):get_dissector(CONTROL_PORT)

local function dissect_frame(tvb, pinfo, root)
  local is_modbus = modbus and tvb:len() > 3 and tvb:range(2, 2):uint() == MODBUS
  if is_modbus then return modbus:call(tvb, pinfo, root) end
  local direction = pinfo.dst_port == pinfo.match_uint and HOST or ARM
  show(xarm, View.new(tvb, 0, tvb:len()), direction, pinfo, root:add(xarm.proto, tvb:range()))
  return tvb:len()
end

local function dissect_report(tvb, pinfo, root)
  local tree, view = root:add(xarm.proto, tvb:range()), View.new(tvb, 0, tvb:len())
  pinfo.cols.protocol = xarm.name
  if view.len < MIN_REPORT or view:be32(0) ~= view.len then
    show_damage(xarm, view, { kind = "length", text = "no report" }, pinfo, tree)
    return view.len
  end
  local state, mode = view:byte(4) % 16, math.floor(view:byte(4) / 16)
  tree:add(xarm_fields.report_length, view:range(0, 4), view.len)
  tree:add(xarm_fields.report_state, view:range(4, 1), state)
  tree:add(xarm_fields.report_mode, view:range(4, 1), mode)
  tree:add(xarm_fields.report_commands, view:range(5, 2), view:be16(5))
  add_floats(view, tree, "rad", 7, AXES)
  add_floats(view, tree, "pose", 35, #POSE)
  add_floats(view, tree, "effort", 59, AXES)
  if view.len > MIN_REPORT then tree:add(xarm_fields.report_rest, view:range(MIN_REPORT, view.len - MIN_REPORT)) end
  local joints = list(AXES, function(nth) return string.format("%+.2f°", math.deg(view:float(4 * nth + 3))) end)
  local text = string.format("report: joints %s, state %d, mode %d", joints, state, mode)
  tree:append_text(", " .. text)
  tree:add(xarm_fields.message, view:range(0, view.len), text)
  pinfo.cols.info = text
  return view.len
end

local xarm_tcp = Proto("xarm_tcp", "UFACTORY xArm on TCP")
local xarm_report = Proto("xarm_report", "UFACTORY xArm report")

function xarm_tcp.dissector(tvb, _, root)
  dissect_tcp_pdus(tvb, root, XARM_HEADER, frame_len, dissect_frame)
  return tvb:len()
end

function xarm_report.dissector(tvb, _, root)
  dissect_tcp_pdus(tvb, root, REPORT_HEADER, report_len, dissect_report)
  return tvb:len()
end

-- UBTECH Alpha1: a header of two bytes with swapped nibbles, data, checksum, ED (docs/protocols/alpha1.md).

local TAIL, SUCCESS, FAILURE = 0xED, 0xAA, 0xEE
local ALPHA1_SERVOS, MAX_ANGLE, MAX_SERVO = 20, 240, 240
local OUTCOMES = { [SUCCESS] = "success", [FAILURE] = "failure" }

local alpha1_fields = {
  row = ProtoField.uint8("alpha1.row", "Row of the document", base.HEX),
  check = ProtoField.uint8("alpha1.check", "Check", base.HEX),
  outcome = ProtoField.uint8("alpha1.outcome", "Outcome", base.HEX, OUTCOMES),
  text = ProtoField.string("alpha1.text", "Text"),
  servos = ProtoField.uint32("alpha1.servos", "Running servos", base.HEX),
  time = ProtoField.double("alpha1.time", "Time of the move (s)"),
  interval = ProtoField.double("alpha1.interval", "Time to the next action (s)"),
  tool = ProtoField.bool("alpha1.offset_tool", "Offset tool"),
  usb = ProtoField.uint8("alpha1.usb", "USB type", base.DEC, { [1] = "disk", [2] = "serial port", [3] = "HID" }),
  servo = ProtoField.uint8("alpha1.servo", "Servo"),
  angle = ProtoField.uint16("alpha1.angle", "Angle (°)"),
  target = ProtoField.uint16("alpha1.target", "Target (°)"),
  lock = ProtoField.double("alpha1.completion_time", "Completion time (s)"),
  led = ProtoField.uint8("alpha1.led", "LED"),
  id = ProtoField.uint8("alpha1.new_id", "New id"),
  was = ProtoField.uint8("alpha1.old_id", "Old id"),
  offset = ProtoField.double("alpha1.offset", "Offset (°)"),
  version = ProtoField.bytes("alpha1.version", "Version"),
}
each(alpha1_fields, ALPHA1_SERVOS, "angle", function(n)
  return ProtoField.uint8("alpha1.servo" .. n .. ".angle", "Servo " .. n .. " (°)")
end)

-- Lengths of the data by row. The first byte of a counted text is its length, including itself. A status has no checksum.
local COUNTED, STATUS_ONLY = "counted", "status"
local LAYOUTS = {
  [HOST] = {
    [0xF1] = 6,
    [0xEF] = 6,
    [0xF2] = 6,
    [0xF5] = 6,
    [0xFB] = 29,
    [0xF4] = 6,
    [0xF9] = 6,
    [0xF3] = COUNTED,
    [0xFA] = 6,
    [0xFC] = 6,
  },
  [ARM] = {
    [0xF1] = COUNTED,
    [0xEF] = 4,
    [0xF2] = STATUS_ONLY,
    [0xF5] = 11,
    [0xFB] = 6,
    [0xF4] = STATUS_ONLY,
    [0xF9] = STATUS_ONLY,
    [0xF3] = STATUS_ONLY,
    [0xFA] = 6,
    [0xFC] = 6,
  },
}
LAYOUTS[UNKNOWN] = LAYOUTS[ARM]

local function alpha1_checksum(view)
  return view:sum() % 256
end

local function seconds(units)
  return units * 0.02
end

local function as_angle(byte)
  return byte <= MAX_ANGLE and byte .. "°" or byte .. " (out of range)"
end

-- A request whose data is `first` and zeros.
local function plain(first, text)
  return function(data)
    return data:byte(0) == first and data:is_zero(1) and text or nil
  end
end

local function act(data, tree)
  if data:byte(0) ~= 1 or data:part(1, 5):sum() > 0 then return nil end
  local angles = list(ALPHA1_SERVOS, function(nth)
    local byte = data:byte(5 + nth)
    if byte == 0xFF then return "-" end
    tree:add(alpha1_fields["angle" .. nth], data:range(5 + nth, 1), byte)
    return as_angle(byte)
  end)
  local time, interval = seconds(data:byte(26)), seconds(data:be16(27))
  tree:add(alpha1_fields.time, data:range(26, 1), time)
  tree:add(alpha1_fields.interval, data:range(27, 2), interval)
  return string.format("act %s in %s s, next after %s s", angles, number(time), number(interval))
end

local function offset_tool(data, tree)
  local text = ({ [0] = "disconnect the offset tool", [1] = "connect the offset tool" })[data:byte(1)]
  if data:byte(0) ~= 1 or not text or not data:is_zero(2) then return nil end
  tree:add(alpha1_fields.tool, data:range(1, 1), data:byte(1) == 1)
  return text
end

local function usb_type(data, tree)
  local text = ({ "be a disk on USB", "be a serial port on USB", "be a HID device on USB" })[data:byte(0)]
  if not text or not data:is_zero(1) then return nil end
  tree:add(alpha1_fields.usb, data:range(0, 1), data:byte(0))
  return text
end

-- A text after its count.
local function counted(data, tree)
  local text = data:part(1, data.len - 1):text()
  if data.len > 1 then tree:add(alpha1_fields.text, data:range(1, data.len - 1), text) end
  return text
end

local function play(data, tree)
  return "play '" .. counted(data, tree) .. "'"
end

-- Servos: requests by command, in frames FA AF. Each takes the data from the servo's id on, and the name of the servo.

local function servo_move(data, tree, servo)
  if data:byte(2) == 0xFF then return "release " .. servo end
  local time, lock = seconds(data:byte(3)), seconds(data:be16(4))
  tree:add(alpha1_fields.angle, data:range(2, 1), data:byte(2))
  tree:add(alpha1_fields.time, data:range(3, 1), time)
  tree:add(alpha1_fields.lock, data:range(4, 2), lock)
  local words = "move %s to %s in %s s, completion time %s s"
  return string.format(words, servo, as_angle(data:byte(2)), number(time), number(lock))
end

local function servo_led(data, tree, servo)
  if not data:is_zero(3) then return nil end
  tree:add(alpha1_fields.led, data:range(2, 1), data:byte(2))
  return "light of " .. servo .. " to " .. data:byte(2)
end

local function servo_read_angles(data, _, servo)
  return data:is_zero(2) and "read angles of " .. servo .. ", and release it" or nil
end

local function is_servo(id)
  return id >= 1 and id <= MAX_SERVO
end

local function servo_change_id(data, tree, servo)
  if data:byte(2) > 0 or not data:is_zero(4) or not is_servo(data:byte(3)) then return nil end
  tree:add(alpha1_fields.id, data:range(3, 1), data:byte(3))
  return "change id of " .. servo .. " to " .. data:byte(3)
end

local function add_offset(data, tree)
  local thirds = data:range(4, 2):int()
  tree:add(alpha1_fields.offset, data:range(4, 2), thirds / 3)
  return thirds
end

local function servo_set_offset(data, tree, servo)
  if data:byte(2) + data:byte(3) > 0 or math.abs(data:range(4, 2):int()) > 90 then return nil end
  return string.format("set offset of %s to %+.2f°", servo, add_offset(data, tree) / 3)
end

local function servo_read_offset(_, _, servo)
  return "read offset of " .. servo
end

-- Answers to them, in the same order of arguments.

local function servo_angles(data, tree)
  tree:add(alpha1_fields.target, data:range(2, 2), data:be16(2))
  tree:add(alpha1_fields.angle, data:range(4, 2), data:be16(4))
  return string.format("released, at %d°, sent to %d°", data:be16(4), data:be16(2))
end

local function servo_id_changed(data, tree)
  tree:add(alpha1_fields.was, data:range(3, 1), data:byte(3))
  return "was " .. data:byte(3)
end

local function servo_offset_set()
  return "offset set"
end

local function servo_offset(data, tree)
  return string.format("offset %+.2f°", add_offset(data, tree) / 3)
end

-- Moves and LED settings are for one servo or all, and answered by one byte. The others are for one servo.
local SERVO = {
  [0x01] = { request = servo_move, is_for_all = true },
  [0x04] = { request = servo_led, is_for_all = true },
  [0x02] = { request = servo_read_angles, answer = servo_angles },
  [0xCD] = { request = servo_change_id, answer = servo_id_changed },
  [0xD2] = { request = servo_set_offset, answer = servo_offset_set },
  [0xD4] = { request = servo_read_offset, answer = servo_offset },
}

local function servo_request(data, tree)
  local id, known = data:byte(0), SERVO[data:byte(1)]
  if not known or not (is_servo(id) or (id == 0 and known.is_for_all)) then return nil end
  tree:add(alpha1_fields.servo, data:range(0, 1), id)
  return known.request(data, tree, id == 0 and "all servos" or "servo " .. id)
end

local function version_request(data, tree)
  if data:byte(1) ~= 1 or not data:is_zero(2) or not is_servo(data:byte(0)) then return nil end
  tree:add(alpha1_fields.servo, data:range(0, 1), data:byte(0))
  return "read version of servo " .. data:byte(0)
end

-- A servo's answer does not repeat the command: the last request before it determines its meaning.
local last_request
local answered = {}

-- The request that a packet answers, stored in the first pass, when packets are read in order.
local function request_of(pinfo)
  if not pinfo.visited then answered[pinfo.number] = last_request end
  return answered[pinfo.number]
end

local function remember_request(row, data, pinfo)
  if pinfo.visited then return end
  last_request = row == 0xFA and { id = data:byte(0), command = data:byte(1), new_id = data:byte(3) } or nil
end

-- True for the answer to a request. A changed id is that of the answer.
local function is_answer_to(request, data)
  local id, outcome = data:byte(0), data:byte(1)
  if request.command ~= 0xCD then return id == request.id end
  if outcome == SUCCESS then return id == request.new_id and data:byte(3) == request.id end
  return id == request.id or id == request.new_id
end

local function servo_answer(data, tree, pinfo)
  local id, outcome, request = data:byte(0), data:byte(1), request_of(pinfo)
  if not is_servo(id) or not OUTCOMES[outcome] then return nil end
  tree:add(alpha1_fields.servo, data:range(0, 1), id)
  tree:add(alpha1_fields.outcome, data:range(1, 1), outcome)
  local answer = request and is_answer_to(request, data) and (SERVO[request.command] or {}).answer
  if not answer then
    return string.format("no message: an answer of servo %d, ambiguous: its request is not before it", id)
  end
  return "servo " .. id .. ": " .. (outcome == FAILURE and "failed" or answer(data, tree)), outcome == FAILURE
end

local function servo_version(data, tree)
  local id, outcome = data:byte(0), data:byte(1)
  if not is_servo(id) or not OUTCOMES[outcome] then return nil end
  tree:add(alpha1_fields.servo, data:range(0, 1), id)
  tree:add(alpha1_fields.outcome, data:range(1, 1), outcome)
  tree:add(alpha1_fields.version, data:range(2, 4))
  local text = outcome == FAILURE and "failed" or "version " .. data:part(2, 4):hex()
  return "servo " .. id .. ": " .. text, outcome == FAILURE
end

-- Answers of the robot.

local function status(name, at)
  return function(data, tree)
    local outcome = data:byte(at)
    if not OUTCOMES[outcome] or (at > 0 and not data:is_zero(at + 1)) then return nil end
    tree:add(alpha1_fields.outcome, data:range(at, 1), outcome)
    return name .. (outcome == SUCCESS and ": done" or ": failed"), outcome == FAILURE
  end
end

local function hardware_version(data, tree)
  return "arm: Alpha1, " .. fact("hardware", counted(data, tree))
end

local function running(data, tree)
  local mask = data:be32(0)
  tree:add(alpha1_fields.servos, data:range(0, 4), mask)
  local servos = bits(mask, 32, true)
  return "servos that run: " .. (#servos > 0 and table.concat(servos, " ") or "none")
end

local OLDEST_FIRMWARE = "2015121519"

local function firmware_version(data, tree)
  local outcome, text = data:byte(0), data:part(1, 10):text()
  if not OUTCOMES[outcome] then return nil end
  tree:add(alpha1_fields.outcome, data:range(0, 1), outcome)
  if outcome == FAILURE then return "firmware: not reported, the robot failed", true end
  tree:add(alpha1_fields.text, data:range(1, 10), text)
  local is_older = data:range(1, 10):raw() < OLDEST_FIRMWARE
  return "firmware: " .. text .. (is_older and ", before " .. OLDEST_FIRMWARE .. ", the first for this protocol" or "")
end

-- Messages by row. Each takes the data, the tree and the packet's information.
local ALPHA1 = {
  [HOST] = {
    [0xF1] = plain(0, "read hardware version"),
    [0xEF] = plain(0, "read servo states"),
    [0xF2] = plain(0, "stop"),
    [0xF5] = plain(1, "read firmware version"),
    [0xFB] = act,
    [0xF4] = offset_tool,
    [0xF9] = usb_type,
    [0xF3] = play,
    [0xFA] = servo_request,
    [0xFC] = version_request,
  },
  [ARM] = {
    [0xF1] = hardware_version,
    [0xEF] = running,
    [0xF2] = status("stop", 0),
    [0xF5] = firmware_version,
    [0xFB] = status("act", 1),
    [0xF4] = status("offset tool", 0),
    [0xF9] = status("USB type", 0),
    [0xF3] = status("play", 0),
    [0xFA] = servo_answer,
    [0xFC] = servo_version,
  },
}
ALPHA1[UNKNOWN] = ALPHA1[ARM]

-- The byte of a servo that acknowledges the last request.
local function is_acknowledgement(view, direction, pinfo)
  if direction == HOST or view.len ~= 1 then return false end
  local request = request_of(pinfo)
  local is_pending = request and is_servo(request.id) and (SERVO[request.command] or {}).is_for_all
  return is_pending and view:byte(0) == (request.id + 0xAA) % 256
end

local function scan_status(view)
  if view.len < 4 then return truncated(4 - view.len) end
  if not OUTCOMES[view:byte(2)] then return wrong_byte(2, view:byte(2), "0xaa or 0xee") end
  if view:byte(3) ~= TAIL then return wrong_tail(view:byte(3), TAIL) end
  return nil, 4
end

-- Frames of the robot's Bluetooth protocol have the header FB BF, followed by their length instead of 01.
local function is_bluetooth(view)
  return view:byte(0) == 0xFB and view:byte(2) ~= 1
end

local function scan_bluetooth(view)
  if view:byte(2) < 6 then return wrong_byte(2, view:byte(2), "0x01") end
  return verify(view, view:byte(2) + 1, 2, alpha1_checksum, TAIL)
end

local function scan_counted(view)
  if view:byte(2) == 0 then return wrong_length(0, 1, 255) end
  return verify(view, view:byte(2) + 4, 2, alpha1_checksum, TAIL)
end

local function scan_alpha1(view, direction, pinfo)
  if is_acknowledgement(view, direction, pinfo) then return nil, 1 end
  if view:is_zero(0) then return { kind = "padding" } end
  local first = view:byte(0)
  local layout = LAYOUTS[direction][first]
  if not layout then return stray() end
  if view.len > 1 and view:byte(1) ~= first % 16 * 16 + math.floor(first / 16) then return stray() end
  if view.len < 3 then return truncated(1) end
  if is_bluetooth(view) then return scan_bluetooth(view) end
  if layout == STATUS_ONLY then return scan_status(view) end
  if layout == COUNTED then return scan_counted(view) end
  return verify(view, layout + 4, 2, alpha1_checksum, TAIL)
end

local function alpha1_message(view, direction, tree, pinfo)
  if view.len == 1 then return "servo " .. request_of(pinfo).id .. ": understood" end
  local row = view:byte(0)
  tree:add(alpha1_fields.row, view:range(0, 1), row)
  if is_bluetooth(view) then return nil end
  local has_check = LAYOUTS[direction][row] ~= STATUS_ONLY
  if has_check then tree:add(alpha1_fields.check, view:range(view.len - 2, 1), view:byte(view.len - 2)) end
  local data = view:part(2, view.len - (has_check and 4 or 3))
  if direction == HOST then remember_request(row, data, pinfo) end
  return ALPHA1[direction][row](data, tree, pinfo)
end

local alpha1 = protocol("alpha1", "UBTECH Alpha1", alpha1_fields, {
  name = "Alpha1",
  scan = scan_alpha1,
  message = alpha1_message,
})

function alpha1.proto.init()
  last_request, answered = nil, {}
end

-- Registration.

local encapsulations = DissectorTable.get("wtap_encap")
for encapsulation, arm in pairs({ [wtap.USER0] = ling, [wtap.USER1] = xarm, [wtap.USER2] = alpha1 }) do
  arm.proto.dissector = dissect_recorded(arm)
  encapsulations:add(encapsulation, arm.proto)
end

local ports = DissectorTable.get("tcp.port")
ports:add(CONTROL_PORT, xarm_tcp)
for _, port in ipairs(REPORT_PORTS) do
  ports:add(port, xarm_report)
end
