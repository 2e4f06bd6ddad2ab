//! The earliest of several instants.

use armwire::Micros;

/// The earliest of those that there are.
// Not inlined: it is asked for everywhere, and what iterators make of instants in 64 bits is long.
#[inline(never)]
pub(crate) fn earliest(instants: &[Option<Micros>]) -> Option<Micros> {
    let mut earliest = None;
    for &instant in instants {
        if earliest.is_none() || instant.is_some() && instant < earliest {
            earliest = instant;
        }
    }
    earliest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn none_is_never() {
        let [a, b] = [Some(Micros(1)), Some(Micros(2))];
        assert_eq!(earliest(&[]), None);
        assert_eq!(earliest(&[None, None]), None);
        for instants in [[a, b, None], [None, b, a], [b, None, a]] {
            assert_eq!(earliest(&instants), a);
        }
    }
}
