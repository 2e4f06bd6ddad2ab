//! A line without known framing.
//!
//! This layer is for firmware, monitors and implementations of other arms. It is less stable than the
//! [client](crate::Client): see [Stability](crate#stability).

use crate::correlation::{Correlation, Effect, InfoOf, RequestInfo};
use crate::framing::{Framing, Reason, Scan};

/// A line without frames: every byte is stray, and no request is answered.
///
/// ```
/// use armwire::decoder::{Decoder, Kind};
/// use armwire::framing::Reason;
/// use armwire::raw::Raw;
///
/// let mut decoder = Decoder::<Raw, 8>::new();
/// assert!(decoder.push(&[1, 2, 3]).is_empty());
/// let item = decoder.next(&Raw, ()).unwrap();
/// assert_eq!((item.kind, item.bytes), (Kind::Noise(Reason::Stray), &[1, 2, 3][..]));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Raw;

impl Framing for Raw {
    type Expect = ();

    fn scan(&self, window: &[u8], (): ()) -> Scan {
        match window.len() {
            0 => Scan::Need(1),
            n => Scan::Noise(n, Reason::Stray),
        }
    }

    fn terminator(&self, (): ()) -> Option<u8> {
        None
    }

    fn shortest(&self, (): ()) -> usize {
        1
    }

    fn requests(&self) {}

    fn unsolicited(&self) {}
}

impl Correlation for Raw {
    type Key = ();

    fn request(&self, frame: &[u8]) -> Option<InfoOf<Self>> {
        (!frame.is_empty()).then_some(RequestInfo {
            key: (),
            expect: (),
            response: None,
            effect: Effect::Setting,
        })
    }

    fn is_response_to(&self, (): (), _frame: &[u8]) -> bool {
        false
    }
}
