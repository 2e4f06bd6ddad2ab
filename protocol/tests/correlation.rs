//! Classification of frames as requests and responses, and their matching.

#[allow(dead_code, unreachable_pub, reason = "it is shared with other tests")]
mod vectors;

use std::fmt::Debug;

use armwire::alpha1::{self, Alpha1, Expect, ServoAnswer, ServoId};
use armwire::correlation::{Correlation, Effect};
use armwire::framing::Scan;
use armwire::ling::{self, Ling, legacy::Legacy};
use armwire::raw::Raw;
use armwire::time::Duration;
use armwire::xarm::{self, Direction, XArm};
use vectors::{Vector, hex};

/// The effect of each request and the longest answer to it, in bytes.
fn effects<D: Correlation>(correlation: &D, requests: &[Vector]) -> Vec<(&'static str, Effect, Option<u16>)> {
    let of = |vector: &Vector| {
        let info = correlation.request(&vector.bytes).unwrap();
        (vector.name, info.effect, info.response.map(|response| response.longest))
    };
    requests.iter().map(of).collect()
}

#[test]
fn ling_requests_have_documented_effect_and_response() {
    use Effect::{Motion, Read, Setting, Torque};
    let expected = [
        ("read information", Read, Some(30)),
        ("set zero", Setting, None),
        ("set stroke 100 mm", Setting, None),
        ("set stroke 50 mm", Setting, None),
        ("set stroke 75 mm", Setting, None),
        ("read stroke", Read, Some(30)),
        ("torque off", Torque, None),
        ("torque on", Torque, None),
        ("read joints", Read, Some(30)),
        ("read temperatures", Read, Some(30)),
        ("set temperature limit", Setting, None),
        ("read velocities", Read, Some(30)),
        ("move, gripper half open", Motion, None),
        ("move, gripper open", Motion, None),
        ("self-check", Read, Some(30)),
        // In position mode again, the torque stays off.
        ("set position mode", Torque, Some(70)),
        // The motors may push the joints: force feedback may have been requested before.
        ("set current mode", Motion, Some(70)),
        ("read mode", Read, Some(70)),
        ("force feedback off", Torque, Some(70)),
        ("force feedback on", Motion, Some(70)),
        ("read force feedback", Read, Some(70)),
    ];
    assert_eq!(effects(&Ling, &vectors::ling_requests()), expected);
}

#[test]
fn alpha1_requests_have_documented_effect_and_response() {
    use Effect::{Motion, Read, Setting, Torque};
    let expected = [
        ("F1 hardware version", Read, Some(259)),
        ("EF servo states", Read, Some(8)),
        ("F2 stop", Setting, Some(4)),
        ("F5 firmware version", Read, Some(15)),
        ("FB act", Motion, Some(10)),
        ("F4 connect", Setting, Some(4)),
        ("F4 disconnect", Setting, Some(4)),
        ("F9 disk", Setting, Some(4)),
        ("F9 serial port", Setting, Some(4)),
        ("F9 HID", Setting, Some(4)),
        ("F3 play", Motion, Some(4)),
        ("F3 play nothing", Motion, Some(4)),
        ("FA 01 move", Motion, Some(1)),
        ("FA 01 move all", Motion, None),
        ("FA 01 release", Torque, Some(1)),
        ("FA 04 LED 1", Setting, Some(1)),
        ("FA 04 LED 0", Setting, Some(1)),
        ("FA 02 read angles", Torque, Some(10)),
        ("FA CD change id", Setting, Some(10)),
        ("FA D2 set offset", Setting, Some(10)),
        ("FA D4 read offset", Read, Some(10)),
        ("FC 01 version", Read, Some(10)),
    ];
    assert_eq!(effects(&Alpha1, &vectors::alpha1_requests()), expected);
}

#[test]
fn xarm_requests_have_documented_effect_and_response() {
    use Effect::{Read, Setting};
    let expected = [
        ("register 1", Read, Some(260)),
        ("register 2", Read, Some(260)),
        ("register 4", Setting, Some(260)),
        ("register 5", Read, Some(260)),
        ("register 6", Read, Some(260)),
        ("register 10, shut down", Setting, Some(260)),
        ("register 10, reboot", Setting, Some(260)),
        ("register 1, protocol 3", Read, Some(260)),
        ("register 19", Setting, Some(260)),
        ("heartbeat", Setting, None),
    ];
    assert_eq!(effects(&XArm::PRIVATE, &vectors::xarm_requests()), expected);
}

/// Each answer of the vectors matches its request, whose `expect` accepts it, and no request with another key.
fn each_answer_is_to_its_request<D: Correlation + Debug>(correlation: &D, requests: Vec<Vector>, answers: Vec<Vector>) {
    for answer in answers.iter().filter(|answer| answer.request.is_some()) {
        let request = correlation.request(answer.request.as_ref().unwrap()).unwrap();
        let verdict = correlation.scan_idle(&answer.bytes, request.expect);
        assert_eq!(verdict, Scan::Frame(answer.bytes.len()), "{}", answer.name);
        assert!(
            correlation.is_response_to(request.key, &answer.bytes),
            "{}",
            answer.name
        );
        for other in &requests {
            let other = correlation.request(&other.bytes).unwrap();
            if other.key != request.key && other.expect == request.expect {
                assert!(
                    !correlation.is_response_to(other.key, &answer.bytes),
                    "{} to {other:?}",
                    answer.name
                );
            }
        }
    }
    // A line may echo a request.
    for request in requests.iter().filter(|_| !D::LOSSLESS) {
        for other in &requests {
            let key = correlation.request(&other.bytes).unwrap().key;
            assert!(!correlation.is_response_to(key, &request.bytes), "{}", request.name);
        }
    }
}

/// A request that a host's decoder takes for a frame is recognised by its form, and no answer is.
fn each_request_has_its_form<D: Correlation>(correlation: &D, requests: Vec<Vector>, answers: Vec<Vector>) {
    for request in requests {
        let verdict = correlation.scan(&request.bytes, correlation.unsolicited());
        let is_frame = verdict == Scan::Frame(request.bytes.len());
        assert!(!is_frame || correlation.is_request(&request.bytes), "{}", request.name);
    }
    for answer in answers {
        assert!(!correlation.is_request(&answer.bytes), "{}", answer.name);
    }
}

#[test]
fn requests_differ_from_answers_in_form() {
    each_request_has_its_form(&Ling, vectors::ling_requests(), vectors::ling_answers());
    let answers = [vectors::alpha1_answers(), vectors::alpha1_servo_answers()].concat();
    each_request_has_its_form(&Alpha1, vectors::alpha1_requests(), answers);
    assert!(!Ling.is_request(&hex("AA EE 00 01 FE 00 FF")), "an error frame");
}

#[test]
fn each_answer_belongs_to_its_request_alone() {
    each_answer_is_to_its_request(&Ling, vectors::ling_requests(), vectors::ling_answers());
    let answers = [vectors::alpha1_answers(), vectors::alpha1_servo_answers()].concat();
    each_answer_is_to_its_request(&Alpha1, vectors::alpha1_requests(), answers);
    each_answer_is_to_its_request(&XArm::PRIVATE, vectors::xarm_requests(), vectors::xarm_answers());
}

#[test]
fn servo_answer_must_match_the_requested_servo() {
    let key = |request: &str| Alpha1.request(&hex(request)).unwrap().key;
    let moves = key("FA AF 01 01 5A 32 00 32 C0 ED");
    assert!(Alpha1.is_response_to(moves, &[0xAB]) && !Alpha1.is_response_to(moves, &[0xAC]));
    let angles = key("FA AF 01 02 00 00 00 00 03 ED");
    assert!(!Alpha1.is_response_to(angles, &hex("FA AF 02 AA 00 5A 00 5A 60 ED")));
    // An answer with an invalid status still matches.
    assert!(Alpha1.is_response_to(angles, &hex("FA AF 01 55 00 5A 00 5A 0A ED")));
}

#[test]
fn id_change_succeeds_as_new_fails_as_either() {
    let key = Alpha1.request(&hex("FA AF 01 CD 00 02 00 00 D0 ED")).unwrap().key;
    assert_eq!(key, alpha1::Key::ChangeId { from: 1, to: 2 });
    assert!(Alpha1.is_response_to(key, &hex("FA AF 02 AA 00 01 00 00 AD ED")));
    assert!(!Alpha1.is_response_to(key, &hex("FA AF 01 AA 00 02 00 00 AD ED")));
    assert!(!Alpha1.is_response_to(key, &hex("FA AF 02 AA 00 03 00 00 AF ED")));
    for from in [1, 2] {
        assert!(Alpha1.is_response_to(key, &[0xFA, 0xAF, from, 0xEE, 0, 0, 0, 0, 0xEE + from, 0xED]));
    }
    assert!(!Alpha1.is_response_to(key, &hex("FA AF 03 EE 00 00 00 00 F1 ED")));
}

#[test]
fn servo_request_determines_the_expected_answer() {
    let servo = ServoId::new(1).unwrap();
    let expected = [
        (
            "FA AF 01 01 5A 32 00 32 C0 ED",
            Some(ServoAnswer::Acknowledgement(servo)),
        ),
        ("FA AF 00 01 5A 32 00 32 BF ED", None),
        ("FA AF 01 02 00 00 00 00 03 ED", Some(ServoAnswer::Angles)),
        ("FA AF 01 CD 00 02 00 00 D0 ED", Some(ServoAnswer::IdChanged)),
        ("FA AF 01 D2 00 00 FF A6 78 ED", Some(ServoAnswer::OffsetSet)),
        ("FA AF 01 D4 00 00 00 00 D5 ED", Some(ServoAnswer::Offset)),
        ("FC CF 01 01 00 00 00 00 02 ED", Some(ServoAnswer::Version)),
        ("F2 2F 00 00 00 00 00 00 00 ED", None),
    ];
    for (request, answer) in expected {
        let info = Alpha1.request(&hex(request)).unwrap();
        assert_eq!(info.expect, Expect::Responses(answer), "{request}");
    }
    let timing = Alpha1.request(&hex("FA AF 01 02 00 00 00 00 03 ED")).unwrap().response;
    assert_eq!(timing.unwrap().turnaround, Duration::from_micros(400));
}

#[test]
fn bluetooth_frame_does_not_answer_an_action() {
    let key = Alpha1.request(&vectors::alpha1_requests()[4].bytes).unwrap().key;
    assert_eq!(key, alpha1::Key::Row(0xFB));
    assert!(Alpha1.is_response_to(key, &hex("FB BF 01 AA 00 00 00 00 AB ED")));
    assert!(!Alpha1.is_response_to(key, &hex("FB BF 09 18 22 DD 01 50 71 ED")));
}

#[test]
fn unknown_ling_request_is_a_setting_with_response() {
    let info = Ling.request(&hex("AA 07 00 01 05 00 FF")).unwrap();
    assert_eq!((info.effect, info.response.is_some()), (Effect::Setting, true));
    assert_eq!(
        info.key,
        ling::Key {
            command: 7,
            function: 0
        }
    );
    assert!(Ling.is_response_to(info.key, &hex("AA 07 00 02 05 06 00 FF")));
}

#[test]
fn answers_of_the_leader_match_their_requests() {
    let rows = [
        ("AA 05 01 01 01 CE FF", "AA 05 01 03 01 01 00 38 FF"),
        ("AA 06 24 01 FE A6 FF", "AA 06 24 34 01 01 06 3F 00 FF"),
        ("AA 06 20 01 00 61 FF", "AA 06 20 0A 02 00 00 00 00 FF"),
        ("AA 06 20 01 01 F7 FF", "AA 06 20 0A 02 01 00 05 00 FF"),
        ("AA 06 20 01 FE 7A FF", "AA 06 20 0A 02 01 00 05 00 FF"),
    ];
    for (request, answer) in rows {
        let key = Ling.request(&hex(request)).unwrap().key;
        assert!(Ling.is_response_to(key, &hex(answer)), "{request}");
        for (other, _) in rows {
            assert!(!Ling.is_response_to(key, &hex(other)), "{request}, {other}");
        }
    }
}

#[test]
fn answer_with_invalid_value_still_matches() {
    let stroke = Ling.request(&hex("AA 04 0E 01 FE 1B FF")).unwrap().key;
    assert!(Ling.is_response_to(stroke, &hex("AA 04 0E 01 03 BA FF")));
    let temperatures = Ling.request(&hex("AA 06 01 01 FE AD FF")).unwrap().key;
    assert!(Ling.is_response_to(temperatures, &hex("AA 06 01 07 01 02 03 04 05 06 07 00 FF")));
}

#[test]
fn every_self_check_encoding_is_a_request() {
    for request in ["AA FE 00 00 FE 93 FF", "AA FE 00 00 C8 FF", "AA FE 00 01 FE D2 FF"] {
        let info = Ling.request(&hex(request)).unwrap();
        assert_eq!(
            info.response.unwrap().turnaround,
            Duration::from_millis(500),
            "{request}"
        );
        assert!(!Ling.is_response_to(info.key, &hex(request)), "{request}");
        assert!(
            Ling.is_response_to(info.key, &hex("AA FE 00 02 FF 03 87 FF")),
            "{request}"
        );
    }
}

#[test]
fn number_is_stamped_into_numbered_requests_only() {
    let arm = XArm::PRIVATE;
    let mut call = hex("00 01 00 02 00 02 06 06");
    arm.stamp(&mut call, 0x1234);
    assert_eq!(call, hex("12 34 00 02 00 02 06 06"));
    let key = xarm::Key {
        transaction: 0x1234,
        protocol: 2,
        register: 6,
    };
    assert_eq!(arm.request(&call).unwrap().key, key);

    let mut heartbeat = xarm::HEARTBEAT;
    arm.stamp(&mut heartbeat, 0x1234);
    assert_eq!(heartbeat, xarm::HEARTBEAT);

    let mut joints = hex("AA 06 00 01 FE 9A FF");
    Ling.stamp(&mut joints, 0x1234);
    assert_eq!(joints, hex("AA 06 00 01 FE 9A FF"));
}

#[test]
fn xarm_answer_repeats_transaction_protocol_and_register() {
    let arm = XArm::PRIVATE;
    let key = arm.request(&hex("00 01 00 02 00 01 04")).unwrap().key;
    assert!(arm.is_response_to(key, &hex("00 01 00 02 00 02 04 10")));
    for other in [
        "00 02 00 02 00 02 04 10",
        "00 01 00 03 00 02 04 10",
        "00 01 00 02 00 02 05 10",
    ] {
        assert!(!arm.is_response_to(key, &hex(other)), "{other}");
    }
    let modbus = arm.request(&hex("00 07 00 00 00 06 01 03 00 00 00 02")).unwrap();
    assert_eq!(
        modbus.key,
        xarm::Key {
            transaction: 7,
            protocol: 0,
            register: 3
        }
    );
    assert!(arm.is_response_to(modbus.key, &hex("00 07 00 00 00 03 01 83 01")));
    assert_eq!(modbus.expect, Direction::Responses);
}

#[test]
fn legacy_and_raw_lines_have_no_requests() {
    assert_eq!(Legacy.request(&vectors::legacy()[0].bytes), None);
    let info = Raw.request(&[1, 2, 3]).unwrap();
    assert_eq!((info.effect, info.response), (Effect::Setting, None));
    assert_eq!(Raw.request(&[]), None);
    assert!(!Raw.is_response_to((), &[1]));
}

#[test]
fn bytes_without_a_frame_are_no_request() {
    for short in [&[][..], &[0xAA], &[0xAA, 6, 0, 1]] {
        assert_eq!(Ling.request(short), None);
        assert_eq!(XArm::PRIVATE.request(short), None);
        assert!(
            Ling.request(short).is_none()
                && !Ling.is_response_to(
                    ling::Key {
                        command: 6,
                        function: 0
                    },
                    short
                )
        );
    }
    assert_eq!(Alpha1.request(&[0xF2]), None);
    assert_eq!(Alpha1.request(&[0xC0, 0x0C, 0, 0, 0, 0, 0, 0, 0, 0xED]), None);
}
