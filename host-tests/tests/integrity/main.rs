//! Outcome of every frame of the documents under every single error: `docs/integrity.md` has the tables.
//!
//! A damaged frame is decoded and interpreted as by a client or a device, first with silence after it, then with the
//! same frame, intact, right behind it. The second test shows if the intact frame is delivered.

mod blind;
mod document;
mod errors;
mod outcome;

use std::fmt::Write;
use std::thread;

use armwire::alpha1::{self, Alpha1};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::xarm::{self, XArm};
use armwire_host_tests::reference::vectors::{self, Vector};
use strum::VariantArray;

use blind::Place;
use errors::Kind;
use outcome::{Outcome, Subject};

/// Number of each outcome for one kind of error, and number of losses of the next frame.
#[derive(Clone, Copy, Default)]
struct Count {
    tried: u64,
    outcomes: [u64; Outcome::VARIANTS.len()],
    next_lost: u64,
}

impl Count {
    fn of(&self, outcome: Outcome) -> u64 {
        self.outcomes[outcome as usize]
    }

    fn add(&mut self, other: Self) {
        self.tried += other.tried;
        self.next_lost += other.next_lost;
        for (mine, theirs) in self.outcomes.iter_mut().zip(other.outcomes) {
            *mine += theirs;
        }
    }
}

/// Outcomes of all errors of a kind for a frame.
fn count<P: Messages + Default, const N: usize>(subject: &Subject<P>, kind: Kind) -> Count {
    let mut count = Count::default();
    kind.each(&subject.bytes, |damaged| {
        count.tried += 1;
        count.outcomes[subject.outcome::<N>(damaged) as usize] += 1;
        count.next_lost += u64::from(!subject.spares_the_next::<N>(damaged));
    });
    count
}

/// Outcomes of each kind of error for all these frames. Each kind has a thread.
fn measure<P, const N: usize>(vectors: &[Vector], subject: fn(&Vector) -> Subject<P>) -> Vec<(Kind, Count)>
where
    P: Messages + Default,
{
    let all = |kind| {
        let mut sum = Count::default();
        for vector in vectors {
            sum.add(count::<P, N>(&subject(vector), kind));
        }
        (kind, sum)
    };
    thread::scope(|scope| {
        let threads: Vec<_> = Kind::VARIANTS
            .iter()
            .map(|&kind| scope.spawn(move || all(kind)))
            .collect();
        threads
            .into_iter()
            .map(|thread| thread.join().expect("it does not panic"))
            .collect()
    })
}

/// The table of the outcomes on one line.
fn table(counts: &[(Kind, Count)]) -> String {
    let mut table = String::from("| Error | Tried |");
    for outcome in Outcome::VARIANTS {
        write!(table, " {outcome} |").expect("it is a string");
    }
    table += " next lost |\n|---|";
    table += &"--:|".repeat(Outcome::VARIANTS.len() + 2);
    for (kind, count) in counts {
        write!(table, "\n| {kind} | {} |", count.tried).expect("it is a string");
        for &outcome in Outcome::VARIANTS {
            write!(table, " {} |", count.of(outcome)).expect("it is a string");
        }
        write!(table, " {} |", count.next_lost).expect("it is a string");
    }
    table + "\n"
}

/// The undetected bits, each with its byte from the start of the frame.
fn undetected_bits<P: Messages + Default, const N: usize>(subject: &Subject<P>) -> Vec<(usize, u8)> {
    let mut bits = (0..subject.bytes.len()).flat_map(|byte| (0..8).map(move |bit| (byte, bit)));
    let mut undetected = Vec::new();
    Kind::OneBit.each(&subject.bytes, |damaged| {
        let bit = bits.next().expect("as many as are tried");
        if subject.outcome::<N>(damaged) == Outcome::Undetected {
            undetected.push(bit);
        }
    });
    undetected
}

/// The table of the frames of Ling in which a flipped bit passes.
fn undetected_bits_of_ling() -> String {
    let mut table = String::from("| Frame | Data bytes | Byte of the frame, bit |\n|---|--:|---|\n");
    for (vector, subject) in ling_subjects() {
        let undetected = undetected_bits::<Ling, { ling::MAX_FRAME }>(&subject);
        if !undetected.is_empty() {
            let undetected: Vec<_> = undetected.iter().map(|(byte, bit)| format!("{byte}, {bit}")).collect();
            let data = vector.bytes.len() - ling::OVERHEAD;
            writeln!(table, "| {} | {data} | {} |", vector.name, undetected.join("; ")).expect("it is a string");
        }
    }
    table
}

fn ling_subjects() -> impl Iterator<Item = (Vector, Subject<Ling>)> {
    let of = |subject: fn(&Vector) -> Subject<Ling>| move |vector| (subject(&vector), vector);
    let requests = vectors::ling_requests().into_iter().map(of(Subject::request));
    let answers = vectors::ling_answers().into_iter().map(of(Subject::response));
    requests.chain(answers).map(|(subject, vector)| (vector, subject))
}

#[test]
fn documented_tables_match_the_measurements() {
    const XARM: usize = xarm::MAX_FRAME;
    const ALPHA1: usize = alpha1::MAX_FRAME;
    let lines = [
        (
            "Ling requests",
            measure::<Ling, { ling::MAX_FRAME }>(&vectors::ling_requests(), Subject::request),
        ),
        (
            "Ling answers",
            measure::<Ling, { ling::MAX_FRAME }>(&vectors::ling_answers(), Subject::response),
        ),
        (
            "Ling, older generation",
            measure::<Legacy, { legacy::MAX_FRAME }>(&vectors::legacy(), Subject::response),
        ),
        (
            "Alpha1 requests",
            measure::<Alpha1, ALPHA1>(&vectors::alpha1_requests(), Subject::request),
        ),
        (
            "Alpha1 answers",
            measure::<Alpha1, ALPHA1>(&vectors::alpha1_answers(), Subject::response),
        ),
        (
            "Alpha1 servos' answers",
            measure::<Alpha1, ALPHA1>(&vectors::alpha1_servo_answers(), Subject::response),
        ),
        (
            "xArm requests",
            measure::<XArm, XARM>(&vectors::xarm_requests(), Subject::request),
        ),
        (
            "xArm answers",
            measure::<XArm, XARM>(&vectors::xarm_answers(), Subject::response),
        ),
    ];
    let mut tables: Vec<_> = lines.iter().map(|(name, counts)| (*name, table(counts))).collect();
    tables.push(("unseen bits", blind::table()));
    tables.push(("frames with unseen bits", undetected_bits_of_ling()));
    for (name, table) in &tables {
        println!("{name}\n\n{table}");
    }
    document::holds(&tables);
}

#[test]
fn flipped_bit_passes_only_at_checksum_blind_spots() {
    for (vector, subject) in ling_subjects() {
        let bytes = subject.bytes.len();
        let data = bytes - ling::OVERHEAD;
        let blind = blind::places(data);
        for (byte, bit) in undetected_bits::<Ling, { ling::MAX_FRAME }>(&subject) {
            let place = Place {
                back: bytes - 2 - byte,
                bit,
            };
            assert!(blind.contains(&place), "{}: bit {bit} of byte {byte}", vector.name);
        }
    }
}

#[test]
fn checksum_blind_spots_do_not_depend_on_prefix() {
    let longest = blind::places(ling::MAX_DATA);
    for data in 0..ling::MAX_DATA {
        let within = |place: &&Place| place.back <= data + 3;
        assert_eq!(
            blind::places(data),
            longest.iter().filter(within).copied().collect::<Vec<_>>()
        );
    }
}

#[test]
fn no_flipped_bit_passes_in_an_alpha1_frame() {
    for vector in vectors::alpha1_requests() {
        assert_eq!(
            undetected_bits::<Alpha1, { alpha1::MAX_FRAME }>(&Subject::request(&vector)),
            [],
            "{}",
            vector.name
        );
    }
    for vector in vectors::alpha1_answers()
        .into_iter()
        .chain(vectors::alpha1_servo_answers())
    {
        assert_eq!(
            undetected_bits::<Alpha1, { alpha1::MAX_FRAME }>(&Subject::response(&vector)),
            [],
            "{}",
            vector.name
        );
    }
}
