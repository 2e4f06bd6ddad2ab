//! The fuzz corpus has every frame of the documents, and a file of every format that `armwire decode` reads.
//!
//! `ARMWIRE_WRITE=1 cargo test --test fuzz_corpus` writes the files.

use std::path::Path;
use std::{env, fs};

use armwire_host_tests::reference::vectors::{
    Vector, alpha1_answers, alpha1_requests, alpha1_servo_answers, legacy, ling_answers, ling_requests, xarm_answers,
    xarm_requests,
};

/// The bytes of an input to `decode` before those of a line: the protocol, and what the reader expects where there is a
/// choice.
const LING: &[u8] = &[0];
const LEGACY: &[u8] = &[1];
const ALPHA1_REQUESTS: &[u8] = &[2, 0];
const ALPHA1_RESPONSES: &[u8] = &[2, 1];
const SERVO_ACKNOWLEDGES: &[u8] = &[2, 2, 0, 0];
const SERVO_ANGLES: &[u8] = &[2, 2, 1];
const XARM_REQUESTS: &[u8] = &[3, 0];
const XARM_RESPONSES: &[u8] = &[3, 1];

fn inputs() -> Vec<(String, Vec<u8>)> {
    let mut inputs = Vec::new();
    let mut add = |name: &str, start: &[u8], vectors: Vec<Vector>| {
        for (nth, vector) in vectors.iter().enumerate() {
            inputs.push((format!("document-{name}-{nth}"), [start, &vector.bytes].concat()));
        }
    };
    add("ling-request", LING, ling_requests());
    add("ling-response", LING, ling_answers());
    add("legacy", LEGACY, legacy());
    add("alpha1-request", ALPHA1_REQUESTS, alpha1_requests());
    add("alpha1-response", ALPHA1_RESPONSES, alpha1_answers());
    add("servo-acknowledges", SERVO_ACKNOWLEDGES, alpha1_servo_answers());
    add("servo-angles", SERVO_ANGLES, alpha1_servo_answers());
    add("xarm-request", XARM_REQUESTS, xarm_requests());
    add("xarm-response", XARM_RESPONSES, xarm_answers());
    inputs
}

/// The byte before a recording in an input to `armwire_decode`: the arm.
const FILE_OF_LING: u8 = 0;
const FILE_OF_SERVO_BUS: u8 = 4;

/// The test files of `armwire decode`.
fn files() -> Vec<(String, Vec<u8>)> {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../cli/tests");
    let mut files = Vec::new();
    for folder in ["texts", "logs"] {
        for entry in fs::read_dir(tests.join(folder)).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            let arm = match name.starts_with("servo-bus") {
                true => FILE_OF_SERVO_BUS,
                false => FILE_OF_LING,
            };
            files.push((
                format!("document-file-{name}"),
                [&[arm], &fs::read(entry.path()).unwrap()[..]].concat(),
            ));
        }
    }
    files
}

/// Compares inputs with the corpus of a target, or writes them.
fn check(target: &str, inputs: Vec<(String, Vec<u8>)>) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    for (name, input) in inputs {
        let path = corpus.join(&name);
        if env::var_os("ARMWIRE_WRITE").is_some() {
            fs::write(&path, &input).unwrap();
        }
        assert_eq!(fs::read(&path).unwrap_or_default(), input, "{name}");
    }
}

#[test]
fn corpus_has_every_frame_of_the_documents() {
    let inputs = inputs();
    assert!(inputs.len() > 100, "{} frames", inputs.len());
    check("decode", inputs);
}

#[test]
fn corpus_has_a_file_of_every_format() {
    let files = files();
    assert!(files.len() > 25, "{} files", files.len());
    check("armwire_decode", files);
}
