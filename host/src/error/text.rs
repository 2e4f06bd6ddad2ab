//! Text with places for remedies.

use crate::describe::{Protocol, escaped};
use std::fmt;

/// Something that helps, which each program offers in its own way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Remedy {
    /// The port is one of this arm, and was opened for another.
    OpenAs(Protocol),
    /// The arm may be this one.
    TryAs(Protocol),
    /// The port may need another baud rate.
    TryBaud,
    /// The arm may be [listened](crate::Connection::legacy) to.
    Listen,
    /// Torque-on lets the arm move.
    TorqueOn,
    /// The arm may be stopped.
    Stop,
    /// The pose in which an arm lies may be saved.
    SaveParkPose,
    /// A program reserves the adapter's line, and may end that.
    EndReservation,
    /// The control port of the adapter may be named.
    NameControl,
}

/// Text for a user, with a place for the words of a program at each remedy. It is displayed without them. Text from outside
/// in it is escaped, as by [`Outside`](crate::Outside).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Text {
    text: String,
    /// Each remedy, and its place in bytes. The places grow.
    remedies: Vec<(usize, Remedy)>,
}

impl Text {
    /// The text with `words` at the place of each remedy. Words for people begin with a space, or with a comma.
    pub fn with(&self, words: impl Fn(Remedy) -> String) -> String {
        let mut text = self.text.clone();
        for &(place, remedy) in self.remedies.iter().rev() {
            text.insert_str(place, &words(remedy));
        }
        escaped(&text)
    }

    /// The remedies, in their order.
    pub fn remedies(&self) -> impl Iterator<Item = Remedy> {
        self.remedies.iter().map(|&(_, remedy)| remedy)
    }

    /// Appends text.
    pub(crate) fn and(mut self, more: &str) -> Self {
        self.text += more;
        self
    }

    /// Appends a place for a remedy.
    pub(crate) fn remedy(mut self, remedy: Remedy) -> Self {
        self.remedies.push((self.text.len(), remedy));
        self
    }

    /// Appends text with its remedies.
    pub(crate) fn append(mut self, more: &Self) -> Self {
        let place = self.text.len();
        self.remedies
            .extend(more.remedies.iter().map(|&(at, remedy)| (place + at, remedy)));
        self.text += &more.text;
        self
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        let remedies = Vec::new();
        Self { text, remedies }
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&escaped(&self.text))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_program_stand_at_their_places() {
        let other = Text::from("an Alpha1").remedy(Remedy::TryAs(Protocol::Alpha1));
        let text = Text::from("is it ")
            .append(&other)
            .and("?")
            .remedy(Remedy::EndReservation);
        assert_eq!(text.to_string(), "is it an Alpha1?");
        assert_eq!(
            text.with(|remedy| format!(" [{remedy:?}]")),
            "is it an Alpha1 [TryAs(Alpha1)]? [EndReservation]"
        );
        assert_eq!(
            text.remedies().collect::<Vec<_>>(),
            [Remedy::TryAs(Protocol::Alpha1), Remedy::EndReservation]
        );
    }
}
