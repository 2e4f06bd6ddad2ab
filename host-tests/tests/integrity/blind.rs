//! Single-bit errors that Ling's checksum does not detect.

use armwire::ling;

/// Number of other bytes in the checksum: command, function and length.
const HEAD: usize = 3;

/// A bit, counted from the checksum back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    /// 1 is the last byte before the checksum.
    pub(crate) back: usize,
    /// 0 is the lowest.
    pub(crate) bit: u8,
}

/// Undetected bits in a frame with this number of data bytes.
///
/// The checksum is linear: the detection of a flip depends only on its place, not on the content of the frame.
pub(crate) fn places(data: usize) -> Vec<Place> {
    let mut body = vec![0; HEAD + data];
    let sum = ling::checksum(&body);
    let mut places = Vec::new();
    for back in 1..=body.len() {
        for bit in 0..8 {
            let at = body.len() - back;
            body[at] = 1 << bit;
            if ling::checksum(&body) == sum {
                places.push(Place { back, bit });
            }
            body[at] = 0;
        }
    }
    places
}

/// The table of all undetected bits.
pub(crate) fn table() -> String {
    let mut table = String::from("| Bytes before the checksum | Bit | Field, with n data bytes |\n|---|---|---|\n");
    for Place { back, bit } in places(ling::MAX_DATA) {
        // The byte exists in frames with this number of data bytes.
        let data = format!("data, if n ≥ {back}");
        let head = (1..=HEAD).filter(|head| back > *head).map(|head| {
            let field = ["length", "function", "command"][head - 1];
            format!("{field}, if n = {}", back - head)
        });
        let fields: Vec<_> = (back <= ling::MAX_DATA)
            .then_some(data)
            .into_iter()
            .chain(head)
            .collect();
        table += &format!("| {back} | {bit} | {} |\n", fields.join("; "));
    }
    table
}
