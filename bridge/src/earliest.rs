//! The earliest of several instants.

use armwire::Micros;

/// The earliest of those that there are.
#[inline]
pub(crate) fn earliest<const N: usize>(instants: [Option<Micros>; N]) -> Option<Micros> {
    let mut earliest = None;
    for instant in instants {
        earliest = match (earliest, instant) {
            (Some(a), Some(b)) if b < a => instant,
            (None, _) => instant,
            _ => earliest,
        };
    }
    earliest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn none_is_never() {
        let [a, b] = [Some(Micros(1)), Some(Micros(2))];
        assert_eq!(earliest([]), None);
        assert_eq!(earliest([None, None]), None);
        for instants in [[a, b, None], [None, b, a], [b, None, a]] {
            assert_eq!(earliest(instants), a);
        }
    }
}
