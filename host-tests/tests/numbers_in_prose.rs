//! The pages state the numbers of the code.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

/// The numbers: a line of a file, below it, indented, the text before a number in that file, and below that the places in
/// pages.
const NUMBERS: &str = include_str!("numbers_in_prose.txt");

/// A number of a file, as a page writes it in this unit.
fn written(number: &str, unit: &str) -> String {
    if unit == "text" {
        return number.to_owned();
    }
    let value: f64 = number.replace('_', "").parse().unwrap_or_else(|_| panic!("{number}"));
    let ticks_per_turn = 4_096.0;
    let degrees = value * 360.0 / ticks_per_turn;
    let radians = value * TAU / ticks_per_turn;
    let word = |number: f64| ["no", "one", "two", "three", "four", "five", "six", "seven"][number as usize].to_owned();
    match unit {
        "number" => value.to_string(),
        "twice" => (2.0 * value).to_string(),
        "word" => word(value),
        // Of seconds.
        "minutes" => word(value / 60.0),
        // Of milliseconds.
        "s" => (value / 1_000.0).to_string(),
        "fifth" => (value / 5_000.0).to_string(),
        "hz" => (1_000.0 / value).to_string(),
        // Of microseconds.
        "us_in_s" => (value / 1e6).to_string(),
        // Of metres.
        "mm" => (value * 1_000.0).to_string(),
        // Of ticks.
        "deg" => format!("{degrees:.0}"),
        "deg.1" => format!("{degrees:.1}"),
        "deg.2" => format!("{degrees:.2}"),
        "rad" if radians < 1.0 => format!("{radians:.4}"),
        "rad" => format!("{radians:.2}"),
        // Of ticks/s, in Hz: steps of 56 ticks are as fast from this rate on.
        "least_rate" => (value / 56.0).ceil().to_string(),
        // The bytes of a void, which are more than the highest length by this number.
        "void" => (value + f64::from(u8::MAX)).to_string(),
        _ => panic!("unknown unit {unit}"),
    }
}

/// The number behind this text, if there is exactly one.
fn number_behind<'a>(text: &'a str, before: &str) -> Option<&'a str> {
    let number = |rest: &'a str| {
        let rest = rest.trim_start();
        let end = rest.find(|c: char| !c.is_ascii_digit() && c != '_' && c != '.');
        let number = rest[..end.unwrap_or(rest.len())].trim_end_matches('.');
        number.starts_with(|c: char| c.is_ascii_digit()).then_some(number)
    };
    let mut numbers = text.split(before).skip(1).filter_map(number);
    numbers.next().filter(|_| numbers.next().is_none())
}

/// Files of the repository, with one space for each gap.
#[derive(Default)]
struct Files(BTreeMap<String, String>);

impl Files {
    fn text(&mut self, path: &str) -> &str {
        self.0.entry(path.to_owned()).or_insert_with(|| {
            let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
            let text = fs::read_to_string(root.join(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
            text.split_whitespace().collect::<Vec<_>>().join(" ")
        })
    }
}

#[test]
fn pages_state_the_numbers_of_the_code() {
    let (mut files, mut wrong) = (Files::default(), Vec::new());
    let (mut file, mut number) = ("", None);
    for line in NUMBERS.lines().filter(|line| !line.starts_with('#')) {
        match line.len() - line.trim_start().len() {
            0 => file = line,
            2 => {
                let before = line.trim();
                number = number_behind(files.text(file), before).map(str::to_owned);
                if number.is_none() {
                    wrong.push(format!("{file} has not one number behind: {before}"));
                }
            }
            _ => {
                let (place, sentence) = line.trim().split_once(": ").unwrap();
                let (page, unit) = place.split_once(' ').unwrap();
                let Some(number) = &number else { continue };
                let sentence = sentence.replace("{}", &written(number, unit));
                // A number in words may begin a sentence.
                let capital = sentence[..1].to_uppercase() + &sentence[1..];
                let text = files.text(page);
                if !text.contains(&sentence) && !text.contains(&capital) {
                    wrong.push(format!("{page} does not say: {sentence}"));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn number_is_the_only_one_behind_its_text() {
    let text = "const A: u8 = 1_000; const B: u8 = 2; const A: u8 = 3; version = \"1.18.4\"";
    assert_eq!(number_behind(text, "B: u8 ="), Some("2"));
    assert_eq!(number_behind(text, "version = \""), Some("1.18.4"));
    for before in ["A: u8 =", "C: u8 =", "const"] {
        assert_eq!(number_behind(text, before), None, "{before}");
    }
}
