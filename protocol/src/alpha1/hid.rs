//! Reports of 64 bytes for an Alpha1 on USB HID: frames, padded with zeros.
//!
//! A report has no header of its own. Pass the bytes of a received report to a [`Decoder`](crate::decoder::Decoder)
//! unchanged: the zeros between frames become padding items, and a frame longer than a report continues in the next
//! one. The operating system may require a report number before the bytes of a write, as Linux's hidraw does: it is 0.

/// Length of a report, in bytes.
pub const REPORT: usize = 64;

/// The reports of a frame: one, or up to five for a long name.
///
/// ```
/// use armwire::alpha1::{Alpha1, Expect, hid};
/// use armwire::decoder::{Decoder, Kind};
///
/// let stop = [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED];
/// let mut decoder = Decoder::<Alpha1, 260>::new();
/// for report in hid::reports(&stop) {
///     assert!(decoder.push(&report).is_empty());
/// }
/// let frame = decoder.next(&Alpha1, Expect::Requests).unwrap();
/// assert_eq!((frame.kind, frame.bytes), (Kind::Frame, &stop[..]));
/// let zeros = decoder.next(&Alpha1, Expect::Requests).unwrap();
/// assert_eq!((zeros.kind, zeros.bytes.len()), (Kind::Padding, 54));
/// ```
pub fn reports(frame: &[u8]) -> impl Iterator<Item = [u8; REPORT]> {
    frame.chunks(REPORT).map(|chunk| {
        let mut report = [0; REPORT];
        for (to, from) in report.iter_mut().zip(chunk) {
            *to = *from;
        }
        report
    })
}
